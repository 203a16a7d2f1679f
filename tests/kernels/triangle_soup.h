// Triangles that tests put together and spoil.
#pragma once
#include <cstdint>
#include <utility>
#include <vector>

#include "kernels/shapes/primitives.h"

namespace knead {

struct TriangleSoup {
  std::vector<Vec3f> points;
  std::vector<uint32_t> triangles;

  TriangleSoup() = default;
  explicit TriangleSoup(const Surface& surface) { add(surface); }
  TriangleSoup& add(const Surface& surface, const Vec3f& shift = {0, 0, 0}, bool turned = false) {
    const uint32_t first = static_cast<uint32_t>(points.size());
    for (const Vec3f& p : surface.points.host()) points.push_back(p + shift);
    for (const uint32_t v : surface.topology->triangles) triangles.push_back(first + v);
    for (size_t t = triangles.size() - surface.topology->triangles.size(); turned && t < triangles.size(); t += 3) turn(t / 3);
    return *this;
  }
  void turn(size_t t) { std::swap(triangles[3 * t + 1], triangles[3 * t + 2]); }
  Surface surface() const { return make_triangle_surface(points, triangles); }
};

}  // namespace knead
