// Generalised winding numbers of a triangle soup: a bounding hierarchy whose distant nodes act as a dipole and its first moment (Barill et al. 2018, two
// terms). Near triangles are summed exactly. The error stays about or below 0.1, plenty for telling inside (1) from outside (0).
#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "kernels/vec.h"

namespace knead {

// Signed solid angle of a triangle seen from the origin, in steradians; positive when its corners turn clockwise for the viewer (seen from behind).
double solid_angle(const Vec3d& a, const Vec3d& b, const Vec3d& c);

class SolidAngleTree {
 public:
  SolidAngleTree() = default;
  SolidAngleTree(std::span<const Vec3d> points, std::span<const uint32_t> triangles);

  // Sum of solid angles over 4 pi: 1 inside a closed surface whose faces point outwards, 0 outside. Thread-safe.
  double winding_number(const Vec3d& p) const;

 private:
  struct Node {
    Vec3d centre, dipole;  // area-weighted centroid; sum of area vectors
    double moment[9];      // sum over triangles of area vector times (centroid - centre), row-major
    double radius = 0;
    uint32_t first = 0, count = 0;  // triangles of a leaf
    uint32_t second = 0;            // an inner node's second child; the first one follows it
  };
  uint32_t build(uint32_t first, uint32_t count, const std::vector<Vec3d>& centroids);
  std::vector<Vec3d> corners_;  // 3 per triangle, in tree order
  std::vector<uint32_t> order_;
  std::vector<Node> nodes_;
};

}  // namespace knead
