// Any triangle soup as the closed, outward-facing boundary of a solid, so that "inside" has a meaning for colliders that are open, inside-out,
// inconsistently oriented or torn into separate triangles. What had to be assumed comes back in numbers, for warnings.
//
// Steps: weld equal positions; drop triangles without area; turn neighbours the same way; turn whole pieces outwards (a piece inside another keeps
// its orientation relative to that one, so that a reversed inner shell stays a cavity); close what is left open by a cone over each rim to the rim's
// centre. The result is closed as a chain: every edge is used as often one way as the other, so its winding number is a whole number everywhere.
#pragma once
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "kernels/vec.h"

namespace knead {

struct ClosedMesh {
  std::vector<Vec3f> points;
  std::vector<uint32_t> triangles;
  size_t dropped = 0;        // triangles given that have no area or a non-finite corner
  size_t turned = 0;         // triangles turned to agree with their neighbours
  size_t pieces_turned = 0;  // whole pieces that faced inwards
  size_t rims = 0;           // openings closed by a cone
  size_t rim_edges = 0;
  size_t own_triangles = 0;     // the first ones: without those of cones
  double own_area = 0;          // of these
  double openings_area = 0;     // of the cones
  double volume = 0, area = 0;  // of the result; overlaps count twice
  Vec3d lower{0, 0, 0}, upper{0, 0, 0};

  // One sentence on what was assumed, "" when nothing was.
  std::string assumptions() const;
};

ClosedMesh close_mesh(std::span<const Vec3f> points, std::span<const uint32_t> triangles);

}  // namespace knead
