// The equilibrium of a body pressed by colliders: the minimum of one energy over H (method.md 4), by L-BFGS over a multigrid cycle
// (kernels/multigrid/multigrid.h).
#pragma once
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "graph/ended.h"
#include "graph/executor.h"
#include "kernels/equilibrium/constants.h"
#include "kernels/equilibrium/elastic_body.h"
#include "kernels/port_types.h"

namespace knead {

// What belongs to the rest shape. Paint is per vertex of M, null where there is none; it reaches H as kernels/loop/hold.h says.
struct EquilibriumMaterial {
  ElasticTerm term = ElasticTerm::kStableNeoHookean;
  double poisson_ratio = 0.45;  // below 0.5; with `edges` it weighs volume against springs in the same proportion
  double hold = 0;              // pull to rest, of mu over M's diagonal squared
  bool keep_place = true;       // What neither a pin nor the hold keeps has no mean displacement and no mean turn (kernels/equilibrium/keep_place.h).
  const Buffer<float>* stiffness_weights = nullptr;
  const Buffer<float>* volume_weights = nullptr;
  const Buffer<float>* hold_weights = nullptr;
  const Buffer<float>* pins = nullptr;
  const Buffer<float>* inside = nullptr;  // by tet, the part that lies inside M (kernels/build_tets/inside_fraction.h); null: H is flesh throughout
  double outside_stiffness = 0.03;        // of what H has outside M, above 0
  bool keep_volume = true;                // M as a whole keeps the volume that it encloses
  int contact_samples = 0;                // subdivisions of a triangle's sides whose points are kept outside too; below 2: vertices only
  double memory_limit = 8e9;              // bytes for the metric
  std::function<void()> check_cancelled;
  void check() const {
    if (check_cancelled) check_cancelled();
  }
};

// Tables and grids: made once, shared by all frames and threads. The host makes them, from a mesh and a lattice in its memory; a device takes copies.
// Throws Error(kMemory), before it starts, when the metric would need more than the limit; Error(kInput) for paint that is no number or does not fit.
class EquilibriumRest;
std::shared_ptr<const EquilibriumRest> prepare_equilibrium(Executor& executor, const TetMesh& tets, const Lattice& lattice,
                                                           const EquilibriumMaterial& material);

struct RestFigures {
  size_t vertices = 0, tets = 0, samples = 0;
  double metric_bytes = 0;  // the metric and what it keeps for a frame's own
  double metric_seconds = 0, seconds = 0;
};
const RestFigures& figures_of(const EquilibriumRest& rest);

struct MeshTransfer;  // kernels/equilibrium/mesh_transfer.h

// Where a solve ended, in what does not depend on its H, for one on another H of the same M to start from. In the host's memory.
struct EquilibriumState {
  std::shared_ptr<const EquilibriumRest> rest;  // of the H that it is of
  Key key;                                      // of that rest
  Key surface;                                  // of M's points
  Buffer<Vec3f> moved;                          // by permuted vertex of that rest: displacements, M's local space; none where nothing touched
  Buffer<float> pressures;                      // [colliders][samples] of contacts, over the body's stiffness
  double volume_pressure = 0;                   // of the enclosed volume's multiplier, likewise
  size_t undecided = 0, enclosed = 0;
};
template <>
struct PortTraits<EquilibriumState> {
  static constexpr const char* name = "EquilibriumState";
  template <class F>
  static void each_buffer(EquilibriumState& v, F&& f) {
    f(v.moved);
    f(v.pressures);
  }
  template <class F>
  static void each_device_buffer(EquilibriumState&, F&&) {}
  static void hash(const EquilibriumState& v, Hasher& hasher) { hasher.add(v.key).add(v.volume_pressure); }
};

// The parameters of the node `equilibrium`, by their names there.
struct EquilibriumSettings {
  EquilibriumConstants constants;  // for docs/study/constants.cpp
  int max_iterations = 300;        // of all, those in which colliders come in too
  // At rest the sum of forces is below this part of the contact forces,
  double threshold = 3e-4;
  // the last step moved no vertex of H further than this part of M's diagonal,
  double displacement = 2e-5;
  // and no contact is off by more than this part of M's diagonal, nor in the mean (RMS, by area) by more than a part of that (StoppingConstants).
  double penetration = 1e-4;
  double contact = 5;            // stiffness of a contact before its multiplier fills, relative to the body's own
  double contact_gap = 2e-3;     // of M's diagonal: how far outside a collider a contact's force begins, from nothing (ContactLaw)
  double friction = 0;           // the largest force of friction over the contact's force
  int memory_interval = 15;      // Multipliers are updated after this many iterations in any case,
  double memory_gradient = 0.1;  // or when the relative gradient is below this.
  double margin = 0;             // M's local units
  Vec3d entry{0, 0, 0};          // the way that the colliders came in, world; zero: told from the rest shape
  // Where to begin; null: at rest. Contacts begin with its pressures when it has as many colliders and samples, and no collider needs a way in.
  const EquilibriumState* start = nullptr;
  const MeshTransfer* transfer = nullptr;  // from the H of `start` to this one
  // On a device: collider k where the host can read it, to find where the collider came in; asked for only when it touches M at rest.
  std::function<Sdf(size_t)> on_host;
  std::function<void()> check_cancelled;
};

struct UnsettledContact {
  size_t collider = static_cast<size_t>(-1);
  Vec3d at{0, 0, 0};
};

struct EquilibriumFigures {
  Ended ended = Ended::kNoContact;
  int iterations = 0;   // of all, those of the way in too
  int evaluations = 0;  // of the energy
  int updates = 0;      // of the multipliers
  int metrics = 0;      // made for this frame
  int way_in = 0;       // iterations in which colliders came in from outside (kernels/loop/approach.h)
  // Colliders that are in so deep that their side cannot be told: the nearest way out was taken.
  size_t undecided = 0;
  // Colliders that lie inside M at rest without touching M, where nothing says that they should, or that M let through.
  size_t enclosed = 0;
  bool started = false;     // from settings.start
  double gradient = 0;      // the sum of forces over the contact forces
  double step = 0;          // the largest displacement of the last step over M's diagonal
  double penetration = 0;   // of M's samples over M's diagonal, in the fields' own interpolant
  double least_volume = 1;  // the smallest V / V0 of a tet
  double energy = 0;        // of the deformed body, elastic and hold: that of contacts depends on how stiff they have become
  double volume = 0;        // the relative error of the enclosed volume; 0 when the volume is not kept
  size_t contacts = 0;      // contacts with a force
  // On each collider, world directions, over Young's modulus (of where stiffness is not painted) times the square of M's diagonal; none where nothing touches.
  std::vector<Vec3d> forces;
  // Where the solve ended neither at rest nor in rounding: see EquilibriumContacts::most_unsettled.
  UnsettledContact unsettled;
  double elastic_seconds = 0, contact_seconds = 0, direction_seconds = 0, renewal_seconds = 0, seconds = 0;
};

// H's positions in tet space, in the executor's memory; those of rest, with Ended::kNoContact, when nothing is in contact. `rest` is for the same
// executor. `end`, unless null, is given what the result is (all but its key and surface). On a device the host reads back one EquilibriumSums an
// evaluation, and beside that only what it needs to find where colliders came in, and `end`; parts of the times are those of launches there. Throws
// Error(kInput) as collide_push does.
Buffer<Vec3f> solve_equilibrium(Executor& executor, const EquilibriumRest& rest, const Similarity& placement, std::span<const Sdf* const> colliders,
                                const EquilibriumSettings& settings, EquilibriumFigures& figures, EquilibriumState* end = nullptr);

}  // namespace knead
