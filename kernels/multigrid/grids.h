// The grids of kernels/multigrid/multigrid.h: H's vertices, and over them background grids of twice the spacing each, with trilinear weights between two.
//
// A node of a coarse grid stands for the finer nodes round it, at less than its spacing along every axis. Where these hang together in several parts
// (lips, fingers, pieces of a cell that was copied), the node has a copy for each part: a coarse grid must not weld what H keeps apart.
#pragma once
#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace knead {

// Rows of a sparse matrix, one after the other, columns rising.
struct SparseRows {
  std::vector<uint32_t> offsets{0}, index;
  std::vector<float> value;
  uint32_t rows() const { return static_cast<uint32_t>(offsets.size() - 1); }
  size_t bytes() const { return 4 * (offsets.size() + index.size() + value.size()); }
};

SparseRows transposed(const SparseRows& a, uint32_t columns);

using GridPosition = std::array<int32_t, 3>;
inline constexpr int32_t kGridUnit = 8;  // positions count eighths of the finest cell

struct CoarseGrid {
  std::vector<GridPosition> positions;
  SparseRows up;    // by finer node: weights of this grid's nodes
  SparseRows down;  // its transpose
};

// `joined`: which nodes hang together. Those that are not `free` get no weights.
CoarseGrid coarsen(const std::vector<GridPosition>& positions, const SparseRows& joined, std::span<const float> free, const GridPosition& origin,
                   int32_t spacing);

// Where grids of twice the spacing are to begin so that as many of `positions` as can be are nodes of it, coordinate by coordinate.
GridPosition origin_of_next(const std::vector<GridPosition>& positions, const GridPosition& origin, int32_t spacing);

// A space-filling order: neighbours in memory are neighbours in space.
std::vector<uint32_t> order_in_space(const std::vector<GridPosition>& positions);

}  // namespace knead
