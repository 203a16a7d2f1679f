// What presses a body in one frame (kernels/equilibrium/equilibrium.h): the samples of M against the colliders, each with a multiplier (an augmented Lagrangian; the
// node calls the multiplier a memory), and the volume that M encloses, which has a multiplier too.
#pragma once
#include <span>
#include <vector>

#include "kernels/equilibrium/contact_samples_body.h"
#include "kernels/equilibrium/energy_sums.h"
#include "kernels/equilibrium/met_colliders.h"
#include "kernels/equilibrium/rest_tables.h"
#include "kernels/equilibrium/rows.h"
#include "kernels/equilibrium/sample_density.h"
#include "kernels/loop/approach.h"

namespace knead {

class EquilibriumContacts {
 public:
  EquilibriumContacts(Executor& executor, const EquilibriumRest& rest, const Similarity& placement, std::span<const Sdf* const> colliders,
                      const EquilibriumSettings& settings, EquilibriumSums* sums, const EquilibriumSums& seen);

  // Forces with H displaced by u, and their energy to `sums`, where `travelled` says how far any vertex of H has gone since the last call of
  // list_samples, or more. `sums` is in the executor's memory; what the host has last seen of it is in `seen`. `again`: u is as it was the last time.
  void evaluate(const Row4* u, bool again);
  // Contact forces by permuted vertex of H. Null on a device, where every vertex gathers the forces of its samples.
  const Row4* forces_on_h() const { return on_host() ? force_on_h_.host().data() : nullptr; }
  // Forces by sample, in addition: on the host the forces on all vertices of M, when the enclosed volume is kept. Null when no vertex gathers.
  const Row4* forces() const { return keeps_volume() || !on_host() ? force_.view(executor_.device()).data() : nullptr; }

  // Finds the samples that may come in contact before H has travelled skin(). `travelled`: how far it has since the last call, or more, cells; negative:
  // there was none yet, or colliders have moved since.
  void list_samples(const Row4* u, float travelled);
  float skin() const { return skin_; }
  // Takes in the colliders that have come near, where `moved` is how far H has moved from rest, or more, cells. Whether there are new ones: then what was listed
  // and evaluated is to be done again.
  bool meet(double moved);
  bool all_met() const { return met_.all_met(); }

  // Where colliders came in: by `given` (world; zero: not given), else as kernels/loop/approach.h finds it: these can stand back. Else by the normals of what is
  // inside, if these agree: its samples are held by the way in, not by the nearest way out. Whether there is one; call at rest, after evaluate.
  bool find_entries(const Vec3d& given);
  size_t undecided() const { return undecided_; }  // colliders of which neither says where they came in
  size_t enclosed() const;                         // colliders that lie in M as it is at rest and touch nothing; call after evaluate
  double longest_way() const;                      // of those that can stand back, cells
  double steps_in(double stride) const;  // for these ways, of `stride`, cells, or a part of the collider's half thickness; not a whole number
  bool stand_free() const;               // none of them is in deeper than that part; after evaluate
  void stand_back(double share);         // by this share of their ways
  bool by_entries() const { return body_.exits != nullptr; }
  void forget_entries() { body_.exits = nullptr; }

  // The contact that an update of the multipliers would change most: its collider and its place on M at rest, M's local space; no collider where none would.
  UnsettledContact most_unsettled() const;  // after evaluate

  // Pressures to begin with, and those of now, as EquilibriumState has them. To begin with friction, call find_entries at rest, then stick where samples have a force.
  void set_pressures(std::span<const float> contacts, double volume);
  Buffer<float> pressures() const;  // after evaluate
  double volume_pressure() const { return seen_.volume.stiffness * (seen_.volume.multiplier + seen_.volume.error); }
  void stick();

  // On each collider, of shear modulus times cells^2, in tet space; after evaluate.
  std::vector<Vec3d> forces_on_colliders() const;

  // Every multiplier becomes its contact's force, after evaluate; the same for the volume.
  void update_multipliers();
  // Stiffer contacts under the same forces.
  void stiffen(float by);

  // What the samples with a force add to the diagonal of a metric: blocks by permuted vertex (kernels/multigrid/multigrid_body.h), in the executor's memory.
  void make_blocks(float* blocks) const;

  bool keeps_volume() const { return !rest_.link_edges.empty(); }
  double volume_error() const { return seen_.volume.error; }
  double volume_stiffness() const;   // kb
  double volume_compliance() const;  // the inverse of the enclosed volume's second derivative along its gradient
  // The gradient of the enclosed volume by permuted vertex of H, of the last evaluate.
  void volume_gradient(Row4* to) const;

  // The samples that there are, where kernels read them.
  const SamplesThere& samples_there() const { return samples_there_; }
  // Takes more samples where, with H displaced by u, a face is deeper in a collider than `tolerance`, cells. Whether there were such; then multipliers of M's
  // vertices stay, and everything has to be evaluated again.
  bool refine_where_pierced(const Row4* u, double tolerance);
  // Whether, with contacts as deep as this, flesh may get past the middle of a thin collider, and what helps. After find_entries.
  bool slips(float deepest) const;
  void stiffen_for_thin();

 private:
  void refine_samples(const std::vector<uint8_t>& steps);  // the sides of triangle t are cut into steps[t]
  std::vector<uint8_t> density_for(const std::vector<ColliderView>& views) const;
  std::vector<ColliderSize> sizes(const std::vector<ColliderView>& views, std::vector<Sdf>& fields) const;
  Vec3d against_patch(const float* distance) const;             // to one collider
  void find_beginnings(uint32_t collider, const Vec3d& entry);  // for friction
  void add_volume();
  void scatter_forces();
  size_t samples() const { return samples_->size(); }
  void use_samples(const SampleTable& samples, const SamplesThere& there);
  size_t shared_samples() const { return samples_ == &rest_.samples ? samples() : samples_->vertices; }  // with rest_.samples
  bool on_host() const { return executor_.device() == Device{}; }
  std::vector<float> read(const float* values, size_t n) const;
  double most_at_a_time(size_t slot) const;
  double half_thickness(size_t slot) const;  // of a collider, cells
  void make_room();                          // for the colliders met since
  std::vector<WayIn> ways_of_met() const;
  bool find_entry(uint32_t slot, const Vec3d& given, const WayIn& way, const float* distance);
  std::vector<float> distances() const { return read(body_.distance, body_.count * samples()); }

  Executor& executor_;
  const EquilibriumRest& rest_;
  const SampleTable* samples_ = nullptr;  // those of `rest_`, or finer_
  SamplesThere samples_there_{};
  SampleTable finer_;
  std::vector<uint8_t> steps_;  // of finer_
  DeviceTables finer_there_;
  const Similarity placement_;
  const std::span<const Sdf* const> colliders_;
  const EquilibriumSettings& settings_;
  EquilibriumSums* const sums_;
  const EquilibriumSums& seen_;
  ContactEnergy body_{};
  Buffer<Row4> force_, force_on_h_, now_, volume_gradient_;
  Buffer<float> multiplier_, distance_;
  Buffer<Row4> normal_, stuck_;
  Buffer<float> began_;
  MetColliders met_;         // the kernels' colliders, by slot
  std::vector<Vec3d> ways_;  // by slot: along which the colliders come to their places
  Buffer<float> slack_, exits_;
  std::vector<uint32_t> list_;    // on the host: the samples that may have a force
  std::vector<uint32_t> loaded_;  // on the host: the vertices of H with a force in force_on_h_
  float skin_;
  size_t undecided_ = 0;
  double stiffer_for_thin_ = 1;
  double thinnest_ = 1e30;  // half thickness of the thinnest collider in which M is at rest, cells
};

}  // namespace knead
