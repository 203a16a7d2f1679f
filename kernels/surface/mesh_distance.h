// Exact signed distance to the solid that a triangle mesh bounds. Embree finds the candidates in float; every distance is evaluated in double.
//
// Inside is where the winding number is above one half. The sign comes from the angle-weighted pseudonormal (Baerentzen and Aanaes 2005) of the
// nearest face, edge or vertex where the mesh is a clean manifold, and from the winding number elsewhere. Where the solid overlaps itself, the
// triangles that lie inside it do not count as surface. The mesh should be closed (kernels/surface/closed_mesh.h closes any): an open one answers by
// its winding number near its rim.
#pragma once
#include <cstdint>
#include <limits>
#include <memory>
#include <span>

#include "graph/api.h"
#include "kernels/surface/exact_distance.h"
#include "kernels/vec.h"

namespace knead {

class Executor;

class KNEAD_API MeshDistance final : public ExactDistance {
 public:
  // Copies what it needs. Triangles without area and those with a non-finite corner are passed over. Throws Error(kInput) when none is left or an
  // index is out of range. An executor makes the preparation parallel.
  MeshDistance(std::span<const Vec3f> points, std::span<const uint32_t> triangles, Executor* executor = nullptr);
  MeshDistance(std::span<const Vec3d> points, std::span<const uint32_t> triangles, Executor* executor = nullptr);
  ~MeshDistance() override;
  MeshDistance(const MeshDistance&) = delete;
  MeshDistance& operator=(const MeshDistance&) = delete;

  SignedDistance signed_distance(const Vec3d& p, double radius = std::numeric_limits<double>::infinity()) const override;
  SignedDistance signed_distance_near(const Vec3d& p, uint32_t& hint) const override;
  double winding_number(const Vec3d& p) const;  // approximate, see kernels/surface/winding_number.h
  bool inside(const Vec3d& p) const { return winding_number(p) > 0.5; }

  // Distance to the first triangle met from `origin` along the unit `direction`, or infinity. Float accuracy.
  double first_hit(const Vec3d& origin, const Vec3d& direction) const;

  bool closed() const;       // every edge has as many triangles one way as the other way
  bool overlapping() const;  // parts of the surface lie inside the solid
  double diagonal() const;   // of the bounding box
  Vec3d lower() const;
  Vec3d upper() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// The nearest point of a triangle and what it lies on: 0..2 a corner, 3..5 the edge from corner k - 3 to the next, 6 the face (Ericson 2005, 5.1.5).
struct TrianglePoint {
  Vec3d point;
  int feature;
};
TrianglePoint closest_point_on_triangle(const Vec3d& p, const Vec3d& a, const Vec3d& b, const Vec3d& c);

}  // namespace knead
