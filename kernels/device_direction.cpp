#include "kernels/device_direction.h"

#include "kernels/parallel.h"

namespace knead {

DeviceDirection::DeviceDirection(Executor& executor, const EquilibriumRest& rest)
    : executor_(executor),
      rest_(rest),
      steps_(size_t{History::kMost} * rest.places, executor.memory()),
      changes_(steps_.size(), executor.memory()),
      history_(1, executor.memory()),
      bulk_(executor, rest.rows),
      bulk_solved_(executor, rest.grids->solve_rows()) {}

PairRows DeviceDirection::pairs() {
  return {steps_.data_for_write(), changes_.data_for_write(), rest_.places};
}

void DeviceDirection::remember(const Ring& ring, Rows& before, Rows& after, Rows& gradient_before, Rows& gradient_after) {
  const size_t at = size_t{ring.newest} * rest_.places;
  reduce(executor_, rest_.places,
         RememberPair{pairs(), ring, before.data(), after.data(), gradient_before.data(), gradient_after.data(), steps_.data_for_write() + at,
                      changes_.data_for_write() + at, history_.data_for_write()});
}

void DeviceDirection::renew_bulk(const Multigrid& metric, const EnergyLanes& lanes, const EquilibriumContacts& contacts, Row4* work) {
  keeps_volume_ = true;
  contacts.volume_gradient(bulk_.data());
  executor_.launch(CopyQuads{bulk_.data(), bulk_solved_.data()}, rest_.places);
  metric.solve(executor_, lanes, bulk_solved_.data(), work);
  reduce(executor_, rest_.places, BulkOver{bulk_.data(), bulk_solved_.data(), contacts.volume_compliance(), history_.data_for_write()});
}

void DeviceDirection::make(const Ring& ring, const Multigrid& metric, const EnergyLanes& lanes, float scale, Rows& gradient, Rows& direction, double* slope,
                           Row4* work) {
  const size_t n = rest_.places;
  History* history = history_.data_for_write();
  Row4 *g = gradient.data(), *d = direction.data();
  reduce(executor_, n, FirstLoop{pairs(), ring, g, history});
  executor_.launch(WithoutChanges{pairs(), ring, g, history, d}, n);
  metric.solve(executor_, lanes, d, work);
  if (keeps_volume_) reduce(executor_, n, BulkAlong{bulk_.data(), d, history});
  reduce(executor_, n, SecondLoop{pairs(), ring, keeps_volume_ ? bulk_solved_.data() : nullptr, d, history, scale});
  reduce(executor_, n, Downhill{pairs(), ring, history, g, d, slope});
}

}  // namespace knead
