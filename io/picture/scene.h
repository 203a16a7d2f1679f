// Triangles to look at and the rays that find them: the part of pictures that knows Embree. float32 in a space where the picture's box is about 2
// wide.
#pragma once
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "kernels/vec.h"

namespace knead {

struct RenderMesh {
  std::vector<Vec3f> points;
  std::vector<uint32_t> triangles;    // 3 each; those with a point that is not finite must be left out
  std::vector<Vec3f> corner_normals;  // unit, 3 per triangle
  std::vector<float> values;          // per vertex, or empty
};

// Angle-weighted normals at every corner over the neighbouring triangles that meet it at less than `crease_degrees`; vertices in one place count as
// one, so that a soup of triangles shades like the surface it draws. Corners of triangles without area take what their neighbours have.
std::vector<Vec3f> smooth_corner_normals(std::span<const Vec3f> points, std::span<const uint32_t> triangles, double crease_degrees);

struct RenderHit {
  int mesh = -1;  // in the order of adding; -1: nothing
  float distance = 0;
  Vec3f place{0, 0, 0};
  Vec3f facet{0, 0, 0};   // unit normal of the triangle, towards the ray's origin
  Vec3f normal{0, 0, 0};  // smooth normal, unit, on the same side
  Vec3f lifted{0, 0, 0};  // `place` moved to the smooth surface that the triangle stands for: shadow rays from here show no facets (Hanika 2021)
  float value = 0;
};

class RenderScene {
 public:
  RenderScene();
  ~RenderScene();
  RenderScene(const RenderScene&) = delete;
  void add(RenderMesh mesh);
  void commit();  // once, after the last mesh
  bool empty() const;

  RenderHit first_hit(const Vec3f& origin, const Vec3f& direction) const;  // direction is a unit vector
  // One bit per ray that meets something within `reach`: up to 8 directions from one place.
  uint32_t blocked(const Vec3f& origin, const Vec3f* directions, int count, float reach) const;

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace knead
