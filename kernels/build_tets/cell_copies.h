// Copies of cells, one for each connected piece of material in them, and the faces over which copies hold together (Molino et al. 2004; Nesme et al.
// 2009).
#pragma once
#include <cstdint>
#include <vector>

#include "kernels/build_tets/cells.h"

namespace knead {

// Two copies of face-adjacent cells that hold together. `face` is 2 * axis + (1 on the upper side) of the first cell, which is the smaller one; of
// two equal cells it is the lower one.
struct CopyLink {
  uint32_t first, second;
  uint8_t face;
};

struct Copies {
  std::vector<uint32_t> first;       // cells + 1: copies of cell c are first[c] .. first[c + 1]
  std::vector<uint32_t> cell;        // of each copy
  std::vector<uint32_t> entry_copy;  // beside Cells::triangles: the copy whose material the triangle bounds
  std::vector<CopyLink> links;       // those that share material first, then those that only close a crack
  size_t count() const { return cell.size(); }
};

// One copy a cell, every pair of face neighbours linked.
Copies whole_cells(const Octree& octree, const Cells& cells);

// Cuts the material of each cell into its connected pieces. A cell with more than kMostPatches separate patches of surface is not cut: that is a
// soup, not a gap.
constexpr size_t kMostPatches = 16;
Copies split_cells(const Octree& octree, const Cells& cells, const SoftBody& body, const WindingNumber& winding, Executor& executor);

}  // namespace knead
