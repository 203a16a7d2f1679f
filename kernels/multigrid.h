// One symmetric multigrid cycle as a metric (kernels/metric.h): where a factor would be too large, or its triangular solves too serial.
//
// The grids are of kernels/multigrid_grids.h, the coarse matrices Galerkin's, P^T A P. The smoother is a polynomial in D^-1 A, Chebyshev's of the
// fourth kind (Lottes 2022), with D the sums of the rows' magnitudes, so that no eigenvalue of D^-1 A is above 1 whatever contacts add, and the cycle
// is positive definite without an estimate. Memory and time are proportional to the vertices; a diagonal is renewed in proportion to what changes.
#pragma once
#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "kernels/metric.h"
#include "kernels/multigrid_body.h"
#include "kernels/multigrid_grids.h"
#include "kernels/sparse_cholesky.h"

namespace knead {

// A grid as a cycle sees it, where the executor runs; the finest first, and the coarsest without `up` and `down`.
struct MultigridLevel {
  uint32_t size;
  MatrixRows a;
  GridWeights up{}, down{};  // from and to the next coarser grid
  static size_t padded(size_t rows) { return (rows + 15) / 16 * 16; }
};

// x <- M x, in place. `coarsest` solves on the coarsest grid, in place too.
void multigrid_cycle(Executor& executor, const EnergyLanes& lanes, std::span<const MultigridLevel> levels,
                     FunctionRef<void(Row4* x, Row4* work)> coarsest, Row4* x, Row4* work);
// Rows of work that a cycle takes, beside what `coarsest` does.
size_t multigrid_work(std::span<const MultigridLevel> levels);
// `degree` steps of the smoother from zero towards A^-1 right; the result is in `now`.
void smooth_from_zero(Executor& executor, const EnergyLanes& lanes, const MultigridLevel& level, int degree, const Row4* right, Row4*& now, Row4*& other);

class Multigrid : public Metric {
 public:
  // Of the matrix with these entries, by edge, and this diagonal. `edges`: lower vertex first, rising. Vertices that are not `free` must have no
  // entries; they stay at zero when they are zero.
  Multigrid(Executor& executor, const EnergyLanes& lanes, const std::vector<GridPlace>& places, std::span<const std::array<uint32_t, 2>> edges,
            std::span<const float> free, std::span<const float> entries, std::span<const float> diagonal, const std::function<void()>& check = {});

  std::unique_ptr<Metric> renewed(Executor& executor, const EnergyLanes& lanes, std::span<const float> diagonal,
                                  const std::function<void()>& check) const override;
  std::unique_ptr<Metric> remade(Executor& executor, const EnergyLanes& lanes, std::span<const float> entries, std::span<const float> diagonal,
                                 const std::function<void()>& check) const override;
  void solve(Executor& executor, const EnergyLanes& lanes, Row4* x, float* scratch) const override;
  size_t solve_rows() const override { return padded(grids_->front().size()); }
  size_t scratch_floats() const override;

  size_t levels() const { return grids_->size(); }
  size_t size(size_t level) const { return (*grids_)[level].size(); }
  double bytes() const;  // without what a solve needs
  // What a metric of so many vertices and edges takes at most, roughly, with what a solve needs.
  static double expected_bytes(size_t vertices, size_t edges) { return 400.0 * static_cast<double>(vertices) + 24.0 * static_cast<double>(edges); }

 private:
  friend class DeviceMultigrid;
  static constexpr float kShift = 1e-5f;  // of the coarsest diagonal: trilinear weights may be linearly dependent
  struct Grid {
    SparseRows matrix;    // which entries there are beside the diagonal; without values
    SparseRows up, down;  // to and from the next coarser grid; none on the coarsest
    uint32_t size() const { return matrix.rows(); }
  };
  struct Values {
    std::shared_ptr<const std::vector<float>> entries;
    std::vector<float> diagonal, inverse;
  };
  struct Coarsest {
    std::vector<uint32_t> place;  // in the factor's elimination order
    std::vector<std::array<uint32_t, 2>> edges;
    std::shared_ptr<const FactorPlan> plan;
  };

  Multigrid() = default;
  static size_t padded(size_t rows) { return MultigridLevel::padded(rows); }
  MatrixRows matrix(size_t level) const;
  std::vector<MultigridLevel> views() const;
  static std::vector<float> by_row(const SparseRows& pattern, std::span<const float> by_edge);
  void set_fine(std::span<const float> entries, std::span<const float> diagonal);
  SparseRows galerkin(Executor& executor, size_t level) const;
  void take(size_t level, const SparseRows& product, bool first);
  void make_inverse(Executor& executor, size_t level);
  void factor_coarsest(Executor& executor, const EnergyLanes& lanes, const std::function<void()>& check);
  void add_to_coarse(size_t level, std::span<const uint32_t> changed, std::span<const float> by);

  std::shared_ptr<std::vector<Grid>> grids_;  // H's vertices first
  std::shared_ptr<Coarsest> coarsest_;
  std::vector<Values> values_;  // by grid
  std::shared_ptr<const SparseCholesky> factor_;
};

}  // namespace knead
