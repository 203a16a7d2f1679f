// The metric of the equilibrium's L-BFGS: one symmetric multigrid cycle that applies, nearly, the inverse of a matrix with a block of three by three per edge
// and per vertex of H (kernels/equilibrium/hessian_body.h, and the contacts).
//
// The grids are of kernels/multigrid/grids.h, the coarse matrices Galerkin's, P^T A P. The smoother is a polynomial in D^-1 A, Chebyshev's of the fourth
// kind (Lottes 2022), with D the diagonal's blocks. Memory and time are proportional to the vertices. Grids belong to the rest shape; everything else is
// made where the executor runs, for one shape and its contacts.
#pragma once
#include <array>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "kernels/device_tables.h"
#include "kernels/multigrid/grids.h"
#include "kernels/multigrid/multigrid_body.h"

namespace knead {

struct EnergySimd;

// A grid as a cycle sees it, where the executor runs; the finest first, and the coarsest without `up` and `down`.
struct MultigridLevel {
  uint32_t size = 0;
  MatrixRows a{};
  GridWeights up{}, down{};  // from and to the next coarser grid
  size_t entries = 0;        // beside the diagonal
  const uint32_t *product = nullptr, *product_terms = nullptr,
                 *coarse_terms = nullptr;  // as ProductRow and CoarseRow have them, for the next coarser grid
  const uint16_t *product_places = nullptr, *coarse_places = nullptr;
  size_t products = 0;  // blocks of A P
  float largest = 1;    // eigenvalue of D^-1 A
  static size_t padded(size_t rows) { return (rows + 15) / 16 * 16; }
};

struct Hessian;

// What belongs to the rest shape.
class MultigridGrids {
 public:
  // `edges`: lower vertex first, rising. Vertices that are not `free` must have no entries; they stay at zero when they are zero.
  MultigridGrids(Executor& host, const std::vector<GridPosition>& positions, std::span<const std::array<uint32_t, 2>> edges,
                 std::span<const float> free, const std::function<void()>& check = {});
  // Where `executor` runs: to be called before anything else is made of them.
  void make_device_tables(Executor& executor);

  const std::vector<MultigridLevel>& levels() const { return levels_; }  // without values
  const SparseRows& pattern() const { return grids_.front().matrix; }    // of the finest, beside the diagonal
  size_t solve_rows() const { return MultigridLevel::padded(levels_.front().size); }
  size_t work_rows() const;                                     // what a cycle takes beside
  double bytes() const;                                         // of these, of one matrix for all frames and of a frame's own
  static double expected_bytes(size_t vertices, size_t edges);  // of a body that is thick, roughly: measured

  // The largest eigenvalues, from the matrix at rest, on the host; without it no cycle is any good.
  void measure(Executor& host, const EnergySimd& lanes, const Hessian& rest);

 private:
  struct Grid {
    SparseRows matrix;    // which entries there are beside the diagonal; without values
    SparseRows up, down;  // to and from the next coarser grid; none on the coarsest, as what follows
    SparseRows product;   // A P
    std::vector<uint32_t> product_terms, coarse_terms;
    std::vector<uint16_t> product_places, coarse_places;
  };
  static SparseRows find_products(Grid& fine);
  std::vector<Grid> grids_;  // H's vertices first
  std::vector<MultigridLevel> levels_;
  DeviceTables device_tables_;
};

// A matrix without contacts: on the finest grid, blocks as `pattern` has the entries, and on the next.
struct Hessian {
  Buffer<float> entries, diagonal, coarse_entries, coarse_diagonal;
};
Hessian make_hessian(Executor& executor, const MultigridGrids& grids, Buffer<float> entries, Buffer<float> diagonal);
// After rows of the finest grid have changed: `changed` by row, in the executor's memory; null: all have. No metric may hold it meanwhile.
void renew_coarse(Executor& executor, const MultigridGrids& grids, Hessian& hessian, const uint8_t* changed);

class Multigrid {
 public:
  // `added`: blocks by vertex that go onto the diagonal, in the executor's memory; may be null. `grids` must stay.
  Multigrid(Executor& executor, const MultigridGrids& grids, const Hessian& hessian, const float* added);

  // x <- M x. `x` has solve_rows() rows; `work`: work_rows() of them. Of grids coarser than the finest: x is what that grid, and not a finer one, can tell.
  void solve(Executor& executor, const EnergySimd& lanes, Row4* x, Row4* work, size_t grid = 0) const;
  const std::vector<MultigridLevel>& levels() const { return levels_; }

 private:
  struct Values {
    Buffer<float> entries, diagonal, inverse;
  };
  void invert_coarsest(Executor& executor);
  void solve_coarsest(Executor& executor, const EnergySimd& lanes, Row4* x, Row4* work) const;
  void cycle(Executor& executor, const EnergySimd& lanes, size_t level, Row4* x, Row4* work) const;

  std::vector<Values> values_;
  std::vector<MultigridLevel> levels_;
  Buffer<double> inverse_;  // of the coarsest matrix; none where that is large
};

}  // namespace knead
