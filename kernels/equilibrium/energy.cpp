#include "kernels/equilibrium/energy.h"

#include <algorithm>
#include <cmath>

namespace knead {
namespace {

constexpr size_t kTetsPerPiece = 1024;  // A piece of the tets is tens of microseconds of work.
constexpr size_t kMostPieces = 4096;    // Larger pieces bound the partial sums of a large body.

}  // namespace

EquilibriumEnergy::EquilibriumEnergy(Executor& executor, const EquilibriumRest& rest, const Similarity& placement,
                                     std::span<const Sdf* const> colliders, const EquilibriumSettings& settings, EquilibriumFigures& figures)
    : executor_(executor),
      rest_(rest),
      figures_(figures),
      simd_(energy_simd(executor)),
      sums_(1, executor.memory()),
      contacts_(executor, rest, placement, colliders, settings, sums_.data_for_write(), seen_),
      place_(executor, rest),
      forces_(executor, 4 * rest.stride),
      listed_at_(executor, rest.rows) {
  seen_.volume.stiffness = contacts_.volume_stiffness();
  executor.copy(&seen_, Device{}, sums_.data_for_write(), executor.device(), sizeof seen_);
}

Evaluation EquilibriumEnergy::evaluate(Rows& u, Rows& gradient) {
  ++figures_.evaluations;
  add_elastic(u);
  return evaluate_contacts(u, gradient);
}

// A device has not told how far H has travelled since contacts were listed: where that was too far, the contacts are listed and evaluated again. So they are
// where H has come near another collider.
Evaluation EquilibriumEnergy::evaluate_contacts(Rows& u, Rows& gradient, bool again) {
  for (;;) {
    const bool fresh = !listed_;
    add_contacts(u, again);
    gather(u, gradient);
    look();
    if (contacts_.meet(seen_.from_rest + seen_.travelled)) {
      again = listed_ = false;
      continue;
    }
    if (on_host() || fresh || seen_.travelled < contacts_.skin()) break;
    listed_ = false;
  }
  Evaluation at;
  at.contact = seen_.contact;
  at.contact.energy += seen_.volume.energy;
  at.gradient = std::sqrt(seen_.forces.squares);
  at.load = std::sqrt(seen_.forces.load);
  at.energy = seen_.elastic.energy + seen_.forces.energy + at.contact.energy;
  at.least_volume = seen_.elastic.least_volume;
  return at;
}

// Samples out of reach are looked at again when H has moved far enough.
void EquilibriumEnergy::add_contacts(Rows& u, bool again) {
  ScopedTime time(figures_.contact_seconds);
  if (!listed_) list_contacts(u, -1);
  measure(u, listed_at_, &sums().travelled);
  if (on_host() && !(sums().travelled < contacts_.skin())) {
    list_contacts(u, sums().travelled);
    sums().travelled = 0;
  }
  contacts_.evaluate(u.data(), again);
}

void EquilibriumEnergy::list_contacts(Rows& u, float travelled) {
  listed_ = true;
  parallel_for(executor_, rest_.vertices, CopyRows{u.data(), listed_at_.data()});
  if (!contacts_.all_met()) reduce(executor_, rest_.vertices, Farthest{u.data(), nullptr, &sums().from_rest});
  contacts_.list_samples(u.data(), travelled);
}

void EquilibriumEnergy::add_elastic(Rows& u) {
  ScopedTime time(figures_.elastic_seconds);
  const RestTables& t = rest_.on;
  const ElasticTets body{u.data(), t.corners, t.shape, t.mu, t.lambda, forces_.data(), rest_.stride, rest_.term, t.guard};
  if (!on_host()) return reduce(executor_, rest_.stride, ElasticEnergy{body, &sums().elastic});
  const size_t grain = std::max(kTetsPerPiece, (rest_.stride / kMostPieces + 15) / 16 * 16);
  parts_.resize(rest_.stride / grain + 1);
  executor_.parallel_ranges(rest_.stride, grain, [&](size_t begin, size_t end) {
    parts_[begin / grain] = simd_.elastic(body, static_cast<uint32_t>(begin), static_cast<uint32_t>(end));
  });
  ElasticSum sum;
  for (size_t piece = 0; piece * grain < rest_.stride; ++piece) sum = ElasticEnergy::combine(sum, parts_[piece]);
  sums().elastic = sum;
}

void EquilibriumEnergy::gather(Rows& u, Rows& gradient) {
  ScopedTime time(figures_.elastic_seconds);
  const RestTables& t = rest_.on;
  const SamplesThere& s = contacts_.samples_there();
  reduce(executor_, rest_.vertices,
         GatherForces{forces_.data(), t.incident_offsets, t.incident_corners, u.data(), t.hold, t.free, t.ghost_offsets, t.ghosts, t.ghost_values,
                      contacts_.forces_on_h(), contacts_.forces(), s.transpose_offsets, s.transpose_samples, s.transpose_weights, gradient.data(),
                      &sums().forces});
  if (!place_.any()) return;
  place_.balance_forces(gradient.data());
  reduce(executor_, rest_.vertices, GradientSquares{gradient.data(), &sums().forces.squares});
}

void EquilibriumEnergy::look() {
  executor_.copy(&sums(), executor_.device(), &seen_, Device{}, sizeof seen_);
  executor_.synchronise();
}

}  // namespace knead
