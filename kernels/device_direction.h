// The directions of the equilibrium's descent on a device (kernels/history_body.h): everything that L-BFGS remembers stays there.
#pragma once
#include "kernels/equilibrium_contacts.h"
#include "kernels/history_body.h"
#include "kernels/metric.h"
#include "kernels/rows.h"

namespace knead {

class DeviceDirection {
 public:
  DeviceDirection(Executor& executor, const EquilibriumRest& rest);

  // The pair of the newest slot.
  void remember(const Ring& ring, Rows& before, Rows& after, Rows& gradient_before, Rows& gradient_after);
  // What the enclosed volume adds to `metric`.
  void renew_bulk(const Metric& metric, const EnergyLanes& lanes, const EquilibriumContacts& contacts, float* scratch);
  // direction <- -(metric of the pairs) gradient; `slope`: their product, in the device's memory.
  void make(const Ring& ring, const Metric& metric, const EnergyLanes& lanes, float scale, Rows& gradient, Rows& direction, double* slope,
            float* scratch);

 private:
  PairRows pairs();

  Executor& executor_;
  const EquilibriumRest& rest_;
  Buffer<Row4> steps_, changes_;  // [kMost][places]
  Buffer<History> history_;
  Rows bulk_, bulk_solved_;
  bool keeps_volume_ = false;
};

}  // namespace knead
