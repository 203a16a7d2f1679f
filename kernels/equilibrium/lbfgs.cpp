#include "kernels/equilibrium/lbfgs.h"

#include <algorithm>

#include "kernels/parallel.h"

namespace knead {

Descent::Descent(Executor& executor, const EquilibriumRest& rest)
    : executor_(executor),
      rest_(rest),
      steps_(size_t{History::kMost} * rest.places, executor.memory()),
      changes_(steps_.size(), executor.memory()),
      history_(1, executor.memory()),
      bulk_(executor, rest.rows),
      bulk_solved_(executor, rest.grids->solve_rows()) {}

PairRows Descent::pairs() {
  return {steps_.data_for_write(), changes_.data_for_write(), rest_.places};
}

void Descent::remember(Rows& before, Rows& after, Rows& gradient_before, Rows& gradient_after, double along) {
  ring_ = {std::min(ring_.pairs + 1, History::kMost), (ring_.newest + 1) % History::kMost};
  const size_t at = size_t{ring_.newest} * rest_.places;
  reduce(executor_, rest_.places,
         RememberPair{pairs(), ring_, before.data(), after.data(), gradient_before.data(), gradient_after.data(), steps_.data_for_write() + at,
                      changes_.data_for_write() + at, history_.data_for_write(), along});
  parallel_for(executor_, rest_.places, "damp_pair", DampPair{changes_.data_for_write() + at, gradient_before.data(), history_.data_for_write()});
}

void Descent::renew_bulk(const Multigrid& metric, const EnergySimd& lanes, const EquilibriumContacts& contacts, size_t grid, Row4* work) {
  keeps_volume_ = true;
  contacts.volume_gradient(bulk_.data());
  parallel_for(executor_, rest_.places, "copy_quads", CopyQuads{bulk_.data(), bulk_solved_.data()});
  metric.solve(executor_, lanes, bulk_solved_.data(), work, grid);
  reduce(executor_, rest_.places, BulkOver{bulk_.data(), bulk_solved_.data(), contacts.volume_compliance(), history_.data_for_write()});
}

void Descent::make(const Multigrid& metric, const EnergySimd& lanes, size_t grid, float scale, Rows& gradient, Rows& direction, double* slope,
                   Row4* work) {
  const size_t n = rest_.places;
  History* history = history_.data_for_write();
  Row4 *g = gradient.data(), *d = direction.data();
  reduce(executor_, n, FirstLoop{pairs(), ring_, g, history});
  parallel_for(executor_, n, "history_apply", WithoutChanges{pairs(), ring_, g, history, d});
  metric.solve(executor_, lanes, d, work, grid);
  if (keeps_volume_) reduce(executor_, n, BulkAlong{bulk_.data(), d, history});
  reduce(executor_, n, SecondLoop{pairs(), ring_, keeps_volume_ ? bulk_solved_.data() : nullptr, d, history, scale});
  reduce(executor_, n, Downhill{pairs(), ring_, history, g, d, slope});
}

}  // namespace knead
