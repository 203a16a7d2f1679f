#include "kernels/equilibrium/minimiser.h"

#include <algorithm>
#include <cmath>

namespace knead {
namespace {

constexpr int kMostAttempts = 12;      // A search that needs more finds nothing that float32 can see.
constexpr double kLeastShorter = 0.1;  // The parabola's step is kept above this part of the step before,
constexpr double kMostShorter = 0.5;   // and below this part (Nocedal and Wright, chapter 3).
constexpr double kLeastScale = 0.1;    // The metric's scale stays above this, so that a direction is not lost in rounding.

}  // namespace

EquilibriumMinimiser::EquilibriumMinimiser(Executor& executor, const EquilibriumRest& rest, const EquilibriumConstants& constants,
                                           EquilibriumEnergy& energy, EquilibriumFigures& figures)
    : executor_(executor),
      rest_(rest),
      constants_(constants),
      energy_(energy),
      figures_(figures),
      u_(executor, rest.rows),
      trial_(executor, rest.rows),
      gradient_(executor, rest.rows),
      trial_gradient_(executor, rest.rows),
      direction_(executor, rest.grids->solve_rows()),
      lbfgs_(executor, rest),
      blocks_(kBlock * size_t{rest.vertices}, executor.memory()),
      work_(rest.grids->work_rows(), executor.memory()) {}

void EquilibriumMinimiser::renew_metric() {
  {
    ScopedTime time(figures_.renewal_seconds);
    float* blocks = blocks_.data_for_write();
    energy_.contacts().make_blocks(blocks);
    metric_ = std::make_unique<Multigrid>(executor_, *rest_.grids, deformed_.gradients.empty() ? rest_.hessian : deformed_.now, blocks);
    energy_.place().renew(*metric_, energy_.simd(), work_.data_for_write());
    ++figures_.metrics;
  }
  renew_volume_term();
}

void EquilibriumMinimiser::renew_for_shape() {
  {
    ScopedTime time(figures_.renewal_seconds);
    metric_.reset();
    rest_.follow(executor_, u_.data(), static_cast<float>(constants_.metric.tolerance), deformed_);
    scale_ = 1;
  }
  renew_metric();
}

void EquilibriumMinimiser::renew_volume_term() {
  volume_term_at_ = figures_.iterations;
  if (energy_.contacts().keeps_volume()) lbfgs_.renew_volume_term(metric(), energy_.contacts());
}

void EquilibriumMinimiser::make_direction() {
  ScopedTime time(figures_.direction_seconds);
  lbfgs_.make(metric(), static_cast<float>(scale_), gradient_, direction_, &energy_.sums().slope);
}

bool EquilibriumMinimiser::search(const Evaluation& now, Evaluation& next) {
  const LineSearchConstants& c = constants_.line_search;
  const bool on_host = executor_.device() == Device{};
  double along = 1;
  for (int attempt = 0; attempt < kMostAttempts; ++attempt) {
    if (on_host && !(energy_.sums().slope < 0)) return false;
    parallel_for(executor_, rest_.vertices, CombineRows{trial_.data(), u_.data(), direction_.data(), static_cast<float>(along)});
    energy_.measure(trial_, u_, &energy_.sums().step);
    next = energy_.evaluate(trial_, trial_gradient_);
    const double slope = energy_.seen().slope;
    if (!(slope < 0)) return false;
    const bool lower = next.energy <= now.energy + c.sufficient_decrease * along * slope + c.energy_rounding * std::abs(now.energy);
    if (lower) {
      along_ = along;
      scale_ = attempt > 0 ? std::max(kLeastScale, c.shorter * scale_) : std::min(1.0, c.longer * scale_);
      return true;
    }
    // The parabola through both energies and the slope.
    const double curved = 2 * (next.energy - now.energy - along * slope);
    const double best = curved > 0 ? -slope * along * along / curved : kMostShorter * along;
    along = std::clamp(best, kLeastShorter * along, kMostShorter * along);
  }
  return false;
}

bool EquilibriumMinimiser::iterate(Evaluation& now) {
  for (bool fresh = !lbfgs_.remembers();; fresh = true) {
    make_direction();
    Evaluation next;
    if (search(now, next)) {
      ++figures_.iterations;
      figures_.step = energy_.seen().step / rest_.diagonal;
      lbfgs_.remember(u_, trial_, gradient_, trial_gradient_, along_);
      std::swap(u_, trial_);
      std::swap(gradient_, trial_gradient_);
      now = next;
      return true;
    }
    lbfgs_.forget();
    now = evaluate();
    if (fresh) return false;
  }
}

void EquilibriumMinimiser::begin_on_coarse_grid(const StartConstants& start) {
  const std::vector<MultigridLevel>& grids = rest_.grids->levels();
  grid_ = 0;
  if (rest_.vertices <= start.small_vertices) return;
  while (grid_ + 1 < grids.size() && grids[grid_].size > start.first_nodes) ++grid_;
}

}  // namespace knead
