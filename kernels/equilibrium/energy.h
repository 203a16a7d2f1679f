// The energy of the equilibrium and its gradient (method.md 4): the elastic body, the hold, the contacts and the enclosed volume. What minimises the energy is
// in kernels/equilibrium/equilibrium.cpp.
#pragma once
#include <chrono>
#include <span>
#include <vector>

#include "kernels/equilibrium/contacts.h"
#include "kernels/equilibrium/energy_simd.h"
#include "kernels/equilibrium/energy_sums.h"
#include "kernels/equilibrium/keep_place.h"
#include "kernels/equilibrium/rows.h"

namespace knead {

// Adds the time of its life to a sum of seconds.
class ScopedTime {
 public:
  explicit ScopedTime(double& to) : sum_(to) {}
  ~ScopedTime() { sum_ += std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count(); }
  ScopedTime(const ScopedTime&) = delete;
  ScopedTime& operator=(const ScopedTime&) = delete;

 private:
  double& sum_;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

// What the host sees of an evaluation.
struct Evaluation {
  double energy = 0;
  double gradient = 0;     // the gradient's length
  double load = 0;         // the length of the contact forces
  float least_volume = 1;  // the smallest V / V0 of a tet
  ContactSum contact;
  double relative_gradient() const { return load > 0 ? gradient / load : 0; }
};

class EquilibriumEnergy {
 public:
  EquilibriumEnergy(Executor& executor, const EquilibriumRest& rest, const Similarity& placement, std::span<const Sdf* const> colliders,
                    const EquilibriumSettings& settings, EquilibriumFigures& figures);

  // The energy with H displaced by u, and its gradient.
  Evaluation evaluate(Rows& u, Rows& gradient);
  // The same at the u of the last call of evaluate, where only contacts have changed. `again`: no more than multipliers have.
  Evaluation evaluate_contacts(Rows& u, Rows& gradient, bool again = false);
  // Colliders or H have moved in a way that `evaluate` cannot know: all samples are looked at again.
  void forget_list() { listed_ = false; }

  // How far any vertex of H is in `to` from where the vertex is in `from`, to `farthest`, cells.
  void measure(Rows& from, Rows& to, float* farthest) { reduce(executor_, rest_.vertices, Farthest{from.data(), to.data(), farthest}); }

  EquilibriumContacts& contacts() { return contacts_; }
  KeepPlace& place() { return place_; }
  EquilibriumSums& sums() { return *sums_.data_for_write(); }  // in the executor's memory
  const EquilibriumSums& seen() const { return seen_; }        // what the host last saw of the sums
  const EnergySimd& simd() const { return simd_; }

 private:
  bool on_host() const { return executor_.device() == Device{}; }
  void add_contacts(Rows& u, bool again);
  void list_contacts(Rows& u, float travelled);
  void add_elastic(Rows& u);
  void gather(Rows& u, Rows& gradient);
  void look();

  Executor& executor_;
  const EquilibriumRest& rest_;
  EquilibriumFigures& figures_;
  const EnergySimd& simd_;
  Buffer<EquilibriumSums> sums_;
  EquilibriumSums seen_;
  EquilibriumContacts contacts_;
  KeepPlace place_;
  Rows forces_, listed_at_;
  std::vector<ElasticSum> parts_;
  bool listed_ = false;
};

}  // namespace knead
