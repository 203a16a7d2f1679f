// Which leaves of the octree H keeps, which triangles of M touch each, and which are inside.
#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "graph/executor.h"
#include "kernels/build_tets/octree.h"
#include "kernels/build_tets/soft_body.h"
#include "kernels/surface/winding_number.h"

namespace knead {

// Boxes are enlarged by this much of the root's edge when triangles are tested against them: far above rounding, far below what float32 input
// resolves.
constexpr double kTouchSlack = 1e-10;

// Inside for whole-numbered and for broken surfaces of either orientation.
inline bool is_inside(const WindingNumber& winding, const Vec3d& at) {
  return std::abs(winding.at(at)) > 0.5;
}

// Splits every leaf that a triangle of M touches down to `depth`. Throws Error(kMemory) when that takes more cells than H can have.
void refine_along_surface(Octree& octree, const SoftBody& body, int depth);

struct Cells {
  std::vector<uint32_t> nodes;      // octree leaf of each kept cell, in Morton order
  std::vector<uint32_t> of_node;    // cell of an octree node, or Octree::kNone
  std::vector<uint32_t> offsets;    // cells + 1
  std::vector<uint32_t> triangles;  // of M, that touch the cell: from offsets[cell] on; none for a cell deep inside
  size_t count() const { return nodes.size(); }
  std::span<const uint32_t> touching(size_t cell) const { return {triangles.data() + offsets[cell], triangles.data() + offsets[cell + 1]}; }
};

Cells keep_cells(const Octree& octree, const SoftBody& body, const WindingNumber& winding, Executor& executor);

}  // namespace knead
