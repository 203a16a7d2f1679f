#include "kernels/equilibrium/lbfgs.h"

#include <algorithm>

#include "kernels/parallel.h"

namespace knead {

Lbfgs::Lbfgs(Executor& executor, const EquilibriumRest& rest)
    : executor_(executor),
      rest_(rest),
      steps_(size_t{LbfgsSums::kMost} * rest.vertices, executor.memory()),
      changes_(steps_.size(), executor.memory()),
      sums_(1, executor.memory()),
      volume_(executor, rest.rows),
      volume_solved_(executor, rest.grids->solve_rows()) {}

PairRows Lbfgs::pairs() {
  return {steps_.data_for_write(), changes_.data_for_write(), rest_.vertices};
}

void Lbfgs::remember(Rows& before, Rows& after, Rows& gradient_before, Rows& gradient_after, double along) {
  ring_ = {std::min(ring_.pairs + 1, LbfgsSums::kMost), (ring_.newest + 1) % LbfgsSums::kMost};
  const size_t at = size_t{ring_.newest} * rest_.vertices;
  reduce(executor_, rest_.vertices,
         RememberPair{pairs(), ring_, before.data(), after.data(), gradient_before.data(), gradient_after.data(), steps_.data_for_write() + at,
                      changes_.data_for_write() + at, sums_.data_for_write(), along});
  parallel_for(executor_, rest_.vertices, DampPair{changes_.data_for_write() + at, gradient_before.data(), sums_.data_for_write()});
}

void Lbfgs::renew_volume_term(const PlacedMetric& metric, const EquilibriumContacts& contacts) {
  keeps_volume_ = true;
  contacts.volume_gradient(volume_.data());
  parallel_for(executor_, rest_.vertices, CopyRows{volume_.data(), volume_solved_.data()});
  metric.solve(volume_solved_.data());
  reduce(executor_, rest_.vertices, VolumeTermScale{volume_.data(), volume_solved_.data(), contacts.volume_compliance(), sums_.data_for_write()});
}

void Lbfgs::make(const PlacedMetric& metric, float scale, Rows& gradient, Rows& direction, double* slope) {
  const size_t n = rest_.vertices;
  LbfgsSums* sums = sums_.data_for_write();
  Row4 *g = gradient.data(), *d = direction.data();
  reduce(executor_, n, FirstLoop{pairs(), ring_, g, sums});
  parallel_for(executor_, n, WithoutChanges{pairs(), ring_, g, sums, d});
  metric.solve(d);
  if (keeps_volume_) reduce(executor_, n, VolumeTermPart{volume_.data(), d, sums});
  reduce(executor_, n, SecondLoop{pairs(), ring_, keeps_volume_ ? volume_solved_.data() : nullptr, d, sums, scale});
  reduce(executor_, n, Downhill{pairs(), ring_, sums, g, d, slope});
}

}  // namespace knead
