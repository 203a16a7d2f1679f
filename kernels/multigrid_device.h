// The multigrid cycle of kernels/multigrid.h on a device. The host makes the grids, once, and they are kept there; what belongs to a frame is made
// where it is used: a renewed diagonal reaches the coarser grids by products over the fixed pattern, and the coarsest matrix is inverted as a dense one.
#pragma once
#include "kernels/multigrid.h"
#include "kernels/placed.h"

namespace knead {

class DeviceMultigrid : public Metric {
 public:
  DeviceMultigrid(Executor& executor, const Multigrid& made);

  // `diagonal` is in the device's memory.
  std::unique_ptr<Metric> renewed(Executor& executor, const EnergyLanes&, std::span<const float> diagonal,
                                  const std::function<void()>& check) const override;
  // `entries` and `diagonal` are in the host's, as the products of the host's metric are: two transfers.
  std::unique_ptr<Metric> remade(Executor& executor, const EnergyLanes&, std::span<const float> entries, std::span<const float> diagonal,
                                 const std::function<void()>& check) const override;
  void solve(Executor& executor, const EnergyLanes& lanes, Row4* x, float* scratch) const override;
  size_t solve_rows() const override { return MultigridLevel::padded(levels_.front().size); }
  size_t scratch_floats() const override;
  double bytes() const;

 private:
  struct Tables {
    Placed placed;
    SparseRows fine;                      // which entries the finest matrix has; on the host
    std::vector<MultigridLevel> levels;   // without values
    std::vector<const uint32_t*> row;     // of every entry beside the diagonal; of the coarser grids
    std::vector<uint32_t> entries;        // how many
  };
  struct Values {
    Buffer<float> entries, diagonal, inverse;
  };

  DeviceMultigrid() = default;
  void make(Executor& executor);  // all that follows from the finest matrix
  void invert_coarsest(Executor& executor);

  std::shared_ptr<const Tables> tables_;
  std::vector<Values> values_;
  Buffer<double> inverse_;  // of the coarsest matrix; none where that is large
  std::vector<MultigridLevel> levels_;
};

}  // namespace knead
