#include "kernels/multigrid_device.h"

#include <utility>

#include "graph/loop.h"

namespace knead {
namespace {

constexpr uint32_t kMostDense = 1000;  // nodes of a coarsest grid that is inverted; many loose parts leave more, which are smoothed
constexpr int kDegree = 24;            // so many times

}  // namespace

DeviceMultigrid::DeviceMultigrid(Executor& executor, const Multigrid& made) {
  auto tables = std::make_shared<Tables>();
  const auto place = [&](const auto& table) { return tables->placed(executor, table); };
  const auto weights = [&](const SparseRows& rows) { return GridWeights{place(rows.offsets), place(rows.index), place(rows.value)}; };
  for (size_t level = 0; level < made.levels(); ++level) {
    const Multigrid::Grid& grid = (*made.grids_)[level];
    MultigridLevel there{grid.size(), {}};
    there.a.offsets = place(grid.matrix.offsets);
    there.a.index = place(grid.matrix.index);
    if (level + 1 < made.levels()) there.up = weights(grid.up), there.down = weights(grid.down);
    tables->levels.push_back(there);
    tables->entries.push_back(static_cast<uint32_t>(grid.matrix.index.size()));
    std::vector<uint32_t> row;
    for (uint32_t p = 0; level > 0 && p < grid.size(); ++p) row.resize(grid.matrix.offsets[p + 1], p);
    tables->row.push_back(place(row));
  }
  tables->fine = made.grids_->front().matrix;
  tables_ = std::move(tables);
  const Multigrid::Values& fine = made.values_.front();
  values_.resize(1);
  values_[0].entries = placed_copy(executor, std::span(*fine.entries));
  values_[0].diagonal = placed_copy(executor, std::span(fine.diagonal));
  make(executor);
}

void DeviceMultigrid::make(Executor& executor) {
  const Device device = executor.device();
  levels_ = tables_->levels;
  values_.resize(levels_.size());
  for (size_t level = 0; level < levels_.size(); ++level) {
    MultigridLevel& here = levels_[level];
    Values& values = values_[level];
    values.inverse = Buffer<float>(here.size, executor.memory());
    if (level > 0) {
      const MultigridLevel& fine = levels_[level - 1];
      values.entries = Buffer<float>(tables_->entries[level], executor.memory());
      values.diagonal = Buffer<float>(here.size, executor.memory());
      const GalerkinProduct product{fine.a, fine.down, tables_->row[level], here.a.index, values.entries.data_for_write(),
                                    values.diagonal.data_for_write(), here.size};
      executor.launch(product, size_t{here.size} + tables_->entries[level]);
    }
    here.a.value = values.entries.view(device).data();
    here.a.diagonal = values.diagonal.view(device).data();
    here.a.inverse = values.inverse.view(device).data();
    executor.launch(InverseOfRows{here.a, values.inverse.data_for_write()}, here.size);
  }
  if (levels_.back().size <= kMostDense) invert_coarsest(executor);
}

void DeviceMultigrid::invert_coarsest(Executor& executor) {
  const uint32_t n = levels_.back().size;
  const size_t all = size_t{n} * n;
  Buffer<double> other(all, executor.memory());
  inverse_ = Buffer<double>(all, executor.memory());
  double *now = inverse_.data_for_write(), *next = other.data_for_write();
  if (n % 2 == 1) std::swap(now, next);
  executor.launch(DenseRows{levels_.back().a, Multigrid::kShift, now, n}, n);
  for (uint32_t k = 0; k < n; ++k) {
    executor.launch(InvertColumn{now, next, n, k}, all);
    std::swap(now, next);
  }
}

std::unique_ptr<Metric> DeviceMultigrid::renewed(Executor& executor, const EnergyLanes&, std::span<const float> diagonal,
                                                 const std::function<void()>&) const {
  auto made = std::unique_ptr<DeviceMultigrid>(new DeviceMultigrid);
  made->tables_ = tables_;
  made->values_.resize(1);
  Values& fine = made->values_[0];
  fine.entries = values_[0].entries;
  fine.diagonal = Buffer<float>(diagonal.size(), executor.memory());
  const auto* words = reinterpret_cast<const uint32_t*>(diagonal.data());
  executor.launch(CopyWords{words, reinterpret_cast<uint32_t*>(fine.diagonal.data_for_write())}, diagonal.size());
  made->make(executor);
  return made;
}

std::unique_ptr<Metric> DeviceMultigrid::remade(Executor& executor, const EnergyLanes&, std::span<const float> entries,
                                                std::span<const float> diagonal, const std::function<void()>&) const {
  auto made = std::unique_ptr<DeviceMultigrid>(new DeviceMultigrid);
  made->tables_ = tables_;
  made->values_.resize(1);
  const std::vector<float> by_row = Multigrid::by_row(tables_->fine, entries);
  made->values_[0].entries = placed_copy(executor, std::span(by_row));
  made->values_[0].diagonal = placed_copy(executor, diagonal);
  made->make(executor);
  return made;
}

void DeviceMultigrid::solve(Executor& executor, const EnergyLanes& lanes, Row4* x, float* scratch) const {
  const auto coarsest = [&](Row4* right, Row4* work) {
    const MultigridLevel& level = levels_.back();
    Row4 *now = work, *other = work + MultigridLevel::padded(level.size);
    if (inverse_)
      executor.launch(DenseTimes{inverse_.view(executor.device()).data(), level.size, right, now}, level.size);
    else
      smooth_from_zero(executor, lanes, level, kDegree, right, now, other);
    executor.launch(CopyQuads{now, right}, level.size);
  };
  multigrid_cycle(executor, lanes, levels_, coarsest, x, reinterpret_cast<Row4*>(scratch));
}

size_t DeviceMultigrid::scratch_floats() const {
  return 4 * (multigrid_work(levels_) + 2 * MultigridLevel::padded(levels_.back().size));
}

double DeviceMultigrid::bytes() const {
  double sum = tables_->placed.bytes() + static_cast<double>(inverse_.bytes());
  for (const Values& values : values_) sum += static_cast<double>(values.entries.bytes() + values.diagonal.bytes() + values.inverse.bytes());
  return sum;
}

}  // namespace knead
