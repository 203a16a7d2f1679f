// One iteration of the equilibrium's minimisation: a direction by L-BFGS over a multigrid metric, and a step along the direction that takes energy away.
#pragma once
#include <memory>

#include "kernels/equilibrium/energy.h"
#include "kernels/equilibrium/lbfgs.h"

namespace knead {

class EquilibriumMinimiser {
 public:
  EquilibriumMinimiser(Executor& executor, const EquilibriumRest& rest, const EquilibriumConstants& constants, EquilibriumEnergy& energy,
                       EquilibriumFigures& figures);

  Rows& u() { return u_; }
  Rows& gradient() { return gradient_; }

  // The energy at u.
  Evaluation evaluate() { return energy_.evaluate(u_, gradient_); }
  // The same after contacts have changed.
  Evaluation evaluate_contacts(bool again = false) { return energy_.evaluate_contacts(u_, gradient_, again); }

  // One iteration from `now`, which becomes the energy at the new u. False, with u as before, when no step goes down any more.
  bool iterate(Evaluation& now);

  // The metric of the shape that the Hessian was last made for, with the contacts of now.
  void renew_metric();
  // The metric of the shape at u.
  void renew_for_shape();
  // The enclosed volume's part of the metric.
  void renew_volume_term();
  bool has_metric() const { return metric_ != nullptr; }
  double metric_scale() const { return scale_; }  // below 1 where steps were refused
  int iterations_since_volume_term() const { return figures_.iterations - volume_term_at_; }
  void forget_pairs() { lbfgs_.forget(); }

  // The finest grid of the metric that makes directions; 0: H itself.
  size_t grid() const { return grid_; }
  void begin_on_coarse_grid(const StartConstants& start);
  void refine() { --grid_; }

 private:
  void make_direction();
  PlacedMetric metric() { return {executor_, *metric_, energy_.simd(), energy_.place(), grid_, work_.data_for_write()}; }
  bool search(const Evaluation& now, Evaluation& next);

  Executor& executor_;
  const EquilibriumRest& rest_;
  const EquilibriumConstants& constants_;
  EquilibriumEnergy& energy_;
  EquilibriumFigures& figures_;
  Rows u_, trial_, gradient_, trial_gradient_, direction_;
  Lbfgs lbfgs_;
  Buffer<float> blocks_;
  Buffer<Row4> work_;
  double scale_ = 1;  // of the metric
  double along_ = 1;  // the last step over the last direction
  int volume_term_at_ = 0;
  size_t grid_ = 0;
  ShapeHessian deformed_;              // takes the place of the rest shape's Hessian once not empty
  std::unique_ptr<Multigrid> metric_;  // of this frame's contacts
};

}  // namespace knead
