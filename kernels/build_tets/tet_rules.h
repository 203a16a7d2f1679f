// The vertices and tets of H from the kept cells, by the face rules of method.md 2.5, in integers.
//
// A copy of a cell has 27 slots, a 3 x 3 x 3 grid over its box: eight corners and the centre, which are always vertices, and the middles of edges and
// faces, which are vertices where a smaller cell that it holds together with has a corner. Slots of linked copies in the same place are one vertex.
// So a vertex is known by its integer place and its piece, and every copy agrees with itself about its edges: that alone makes the tets conform,
// whatever the links are.
#pragma once
#include <array>
#include <cstdint>
#include <vector>

#include "kernels/build_tets/cell_copies.h"

namespace knead {

constexpr int kPlaceUnit = 8;  // integer places count eighths of the finest cell

constexpr int slot_at(int x, int y, int z) {
  return x + 3 * y + 9 * z;
}  // each 0, 1 or 2
constexpr int kCentreSlot = slot_at(1, 1, 1);
constexpr int corner_slot(int corner) {
  return slot_at(2 * (corner & 1), 2 * (corner >> 1 & 1), 2 * (corner >> 2));
}

// The triangles over one face of a cell whose slots in the mask `active` are vertices: a fan about the face's middle where that is one, else about a
// hanging middle of an edge, else two triangles along the diagonal that the larger neighbour's fan would have. Quadrants in the mask `skipped` (bit:
// upper in the first axis after the face's, plus twice upper in the second) are left out. `octant` is the cell's place in its parent. At most eight.
struct FaceTriangles {
  std::array<std::array<uint8_t, 3>, 8> slots;
  size_t count = 0;
};
FaceTriangles face_triangles(uint32_t active, uint32_t octant, int face, uint32_t skipped);

// The vertices round a face in order, corners and hanging middles.
struct FaceRing {
  std::array<uint8_t, 8> slots;
  size_t count = 0;
};
FaceRing face_ring(uint32_t active, int face);

struct RawTets {
  std::vector<std::array<int32_t, 3>> places;  // per vertex
  std::vector<std::array<uint32_t, 4>> tets;   // positive
  std::vector<uint32_t> slot_vertices;         // 27 per copy; Octree::kNone where a slot is no vertex
  uint32_t active(uint32_t copy) const {       // mask of the slots that are
    uint32_t mask = 0;
    for (uint32_t s = 0; s < 27; ++s) mask |= (slot_vertices[27 * size_t{copy} + s] != Octree::kNone ? 1u : 0u) << s;
    return mask;
  }
};

// Six times the volume, in places^3; positive for dot(cross(b - a, c - a), d - a) > 0.
int64_t six_volumes(const std::array<int32_t, 3>& a, const std::array<int32_t, 3>& b, const std::array<int32_t, 3>& c,
                    const std::array<int32_t, 3>& d);

uint32_t octant_of(const OctreeNode& node);

// `by_place` makes one vertex of all slots in the same place, linked or not.
RawTets make_raw_tets(const Octree& octree, const Cells& cells, const Copies& copies, bool by_place, Executor& executor);

}  // namespace knead
