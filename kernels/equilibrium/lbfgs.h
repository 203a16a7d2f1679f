// The directions of the equilibrium's minimisation (kernels/equilibrium/lbfgs_body.h): everything that L-BFGS remembers stays in the executor's memory.
#pragma once
#include "kernels/equilibrium/contacts.h"
#include "kernels/equilibrium/keep_place.h"
#include "kernels/equilibrium/lbfgs_body.h"
#include "kernels/equilibrium/rows.h"

namespace knead {

class Lbfgs {
 public:
  Lbfgs(Executor& executor, const EquilibriumRest& rest);

  // After make and a step `along` its direction.
  void remember(Rows& before, Rows& after, Rows& gradient_before, Rows& gradient_after, double along);
  void forget() { ring_.pairs = 0; }
  bool remembers() const { return ring_.pairs > 0; }
  // What the enclosed volume adds to `metric`.
  void renew_volume_term(const PlacedMetric& metric, const EquilibriumContacts& contacts);
  // direction <- -(metric of the pairs) gradient; `slope`: their product, in the executor's memory.
  void make(const PlacedMetric& metric, float scale, Rows& gradient, Rows& direction, double* slope);

 private:
  PairRows pairs();

  Executor& executor_;
  const EquilibriumRest& rest_;
  Buffer<Row4> steps_, changes_;  // [kMost][vertices]
  Buffer<LbfgsSums> sums_;
  Rows volume_, volume_solved_;
  LbfgsRing ring_{0, LbfgsSums::kMost - 1};
  bool keeps_volume_ = false;
};

}  // namespace knead
