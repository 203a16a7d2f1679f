// Polygons to triangles, once, for the rest shape. The result depends on topology first and on geometry only where it must (a concave or folded
// corner), so that a moved, scaled or renumbered mesh is cut the same way but for rounding.
#pragma once
#include <cstddef>
#include <span>

#include "kernels/port_types.h"

namespace knead {

struct TriangulationNotes {
  size_t degenerate_faces = 0;   // fewer than three different corners, or no area: they have no triangle
  size_t repeated_corners = 0;   // of those, the faces that name a vertex twice in a row
  size_t dropped_triangles = 0;  // triangles without area inside faces that do have some
  size_t tangled_faces = 0;      // self-crossing or strongly bent polygons that no cut fits; cut anyway
};

// Fills `triangles` and `triangle_faces` from the polygons: a fan from the first corner where every triangle of it faces forward, else the other
// diagonal of a quad, else ear clipping (O(n^2)). Never fails. Corners must be valid indices into `points`.
TriangulationNotes triangulate(std::span<const Vec3f> points, MeshTopology& topology);

// Twice the polygon's area vector (Newell), in double; for triangles the cross product of two edges.
Vec3d area_vector(std::span<const Vec3f> points, std::span<const uint32_t> corners);

}  // namespace knead
