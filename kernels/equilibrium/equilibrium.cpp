#include "kernels/equilibrium/equilibrium.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>

#include "graph/error.h"
#include "kernels/equilibrium/mesh_transfer.h"
#include "kernels/equilibrium/minimiser.h"

namespace knead {
namespace {

// The iterations at which the metric follows the shape: `next`, then after `interval`, twice as many and so on.
struct Renewals {
  int next, interval, last = 0;

  void done(int iteration) {
    last = iteration;
    if (iteration != next) return;
    next += interval;
    interval *= 2;
  }
};

class Solver {
 public:
  Solver(Executor& executor, const EquilibriumRest& rest, const Similarity& placement, std::span<const Sdf* const> colliders,
         const EquilibriumSettings& settings, EquilibriumFigures& figures)
      : executor_(executor),
        rest_(rest),
        settings_(settings),
        constants_(settings.constants),
        figures_(figures),
        to_world_(placement * rest.to_local),
        energy_(executor, rest, placement, colliders, settings, figures),
        contacts_(energy_.contacts()),
        minimiser_(executor, rest, constants_, energy_, figures),
        kept_(executor, rest.rows) {}

  Buffer<Vec3f> run() {
    const auto start = std::chrono::steady_clock::now();
    Evaluation now = minimiser_.evaluate();
    if (!begin_from_state(now) && !begin_at_rest(now)) {
      figures_.ended = Ended::kNoContact;
      return rest_.rest;
    }
    descend(now);
    const double tolerance = constants_.contact.pierced * rest_.diagonal;
    for (double round = 0; round < constants_.contact.refinements && contacts_.refine_where_pierced(minimiser_.u().data(), tolerance); ++round) {
      minimiser_.forget_pairs();
      energy_.forget_list();
      now = minimiser_.evaluate();
      minimiser_.renew_metric();
      kept_error_ = std::numeric_limits<float>::infinity();
      descend(now);
    }
    if (!is_rest(figures_.ended) && !(now.least_volume > 0)) go_back_to_kept(now);
    if (contacts_.longest_way() > 0) figures_.enclosed = contacts_.enclosed();  // A collider may have been let through on the way in.
    figures_.volume = contacts_.volume_error();
    figures_.gradient = now.relative_gradient();
    figures_.penetration = now.contact.deepest / rest_.diagonal;
    figures_.least_volume = now.least_volume;
    figures_.energy = now.energy - now.contact.energy;
    figures_.contacts = now.contact.active;
    figures_.forces = contacts_.forces_on_colliders();
    const double young = 2 + rest_.lame / (1 + rest_.lame);  // over the shear modulus: 2 + 2 nu
    for (Vec3d& force : figures_.forces) force = (1 / (young * rest_.diagonal * rest_.diagonal)) * to_world_.rotate(force);
    if (!is_rest(figures_.ended)) figures_.unsettled = contacts_.most_unsettled();
    figures_.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return positions();
  }

  // After run, for a solve on another H.
  EquilibriumState state() {
    EquilibriumState state;
    state.undecided = figures_.undecided;
    state.enclosed = figures_.enclosed;
    if (figures_.ended == Ended::kNoContact) return state;
    std::vector<Row4> u(rest_.vertices);
    executor_.copy(minimiser_.u().data(), executor_.device(), u.data(), Device{}, u.size() * sizeof(Row4));
    executor_.synchronise();
    state.moved = Buffer<Vec3f>(u.size());
    const auto to_local = [&](const Row4& at) { return to_float(rest_.to_local.scale * rest_.to_local.rotate(to_double(to_vec(at)))); };
    std::transform(u.begin(), u.end(), state.moved.data_for_write(), to_local);
    state.pressures = contacts_.pressures();
    state.volume_pressure = contacts_.volume_pressure();
    return state;
  }

 private:
  // Begins with the body at rest. False when nothing touches.
  bool begin_at_rest(Evaluation& now) {
    if (length(settings_.entry) == 0) figures_.enclosed = contacts_.enclosed();
    if (may_touch(now) && contacts_.find_entries(settings_.entry)) {
      come_in(now);
      energy_.forget_list();
      now = minimiser_.evaluate();
    }
    if (now.contact.active == 0 && figures_.iterations == 0) return false;
    if (!minimiser_.has_metric()) {
      minimiser_.begin_on_coarse_grid(constants_.start);
      minimiser_.renew_metric();
    }
    figures_.undecided = contacts_.undecided();
    return true;
  }

  bool may_touch(const Evaluation& at_rest) const { return at_rest.contact.active > 0 || length(settings_.entry) > 0; }

  // Begins where the solve on another H ended. False when there is no such solve, or when nothing touches there on this H.
  bool begin_from_state(Evaluation& now) {
    const EquilibriumState* start = settings_.start;
    if (!start || !start->moved) return false;
    if (settings_.friction > 0 && may_touch(now) && contacts_.find_entries(settings_.entry)) contacts_.forget_entries();
    now = evaluate_at(transferred(*start, *settings_.transfer), start->pressures.host(), start->volume_pressure);
    if (now.contact.active == 0) {
      now = evaluate_at(std::vector<Row4>(rest_.vertices), {}, 0);
      return false;
    }
    contacts_.stick();
    now = minimiser_.evaluate_contacts();
    minimiser_.renew_for_shape();
    figures_.started = true;
    figures_.undecided = start->undecided;
    figures_.enclosed = start->enclosed;
    return true;
  }

  std::vector<Row4> transferred(const EquilibriumState& start, const MeshTransfer& transfer) const {
    const Similarity to_cells = rest_.to_local.inverse();
    const auto moved = start.moved.host();
    std::vector<Row4> u(rest_.vertices);
    for (uint32_t p = 0; p < rest_.vertices; ++p) {
      Vec3f sum{0, 0, 0};
      for (size_t c = 0; c < 4; ++c) sum += transfer.weights[p][c] * moved[transfer.vertices[p][c]];
      u[p] = to_row(rest_.free[p] * to_float(to_cells.scale * to_cells.rotate(to_double(sum))));
    }
    return u;
  }

  Evaluation evaluate_at(const std::vector<Row4>& u, std::span<const float> pressures, double volume_pressure) {
    executor_.copy(u.data(), Device{}, minimiser_.u().data(), executor_.device(), u.size() * sizeof(Row4));
    energy_.place().project(minimiser_.u().data());
    executor_.synchronise();
    contacts_.set_pressures(pressures, volume_pressure);
    energy_.forget_list();
    return minimiser_.evaluate();
  }

  bool iterate(Evaluation& now) {
    if (settings_.check_cancelled) settings_.check_cancelled();
    return minimiser_.iterate(now);
  }

  // With the body at rest.
  bool free_at(double share) {
    contacts_.stand_back(share);
    energy_.forget_list();
    minimiser_.evaluate_contacts();
    return contacts_.stand_free();
  }

  // Colliders that stand back come in. A way leads out of what its collider is in at the end; what the collider passes before may take a longer way. The last
  // step is shorter than the others, so that frames of a sweep go the same way, each a little farther.
  void come_in(Evaluation& now) {
    const double whole = contacts_.steps_in(constants_.way_in.stride * rest_.diagonal);
    const int steps = static_cast<int>(std::ceil(whole));
    const auto share_after = [&](int step) { return std::max(0.0, 1 - step / whole); };
    int first = 1;
    while (steps > 0 && first > 1 - steps && !free_at(share_after(first - 1))) --first;
    for (int step = first; step <= steps; ++step) {
      if (figures_.iterations >= settings_.max_iterations) step = steps;
      contacts_.stand_back(share_after(step));
      energy_.forget_list();
      now = minimiser_.evaluate();
      if (now.contact.active == 0) continue;
      if (step % static_cast<int>(constants_.way_in.renewal) == 0 || !minimiser_.has_metric()) minimiser_.renew_metric();
      iterate(now);
      contacts_.update_multipliers();  // A penalty alone gives way: flesh that is carried along would get past a collider's middle.
      now = minimiser_.evaluate_contacts(true);
      stiffen_where_thin(now);
    }
    figures_.way_in = figures_.iterations;
    if (steps > 0) minimiser_.renew_metric();
  }

  // Few samples hold the flesh against a thin collider: contacts become stiffer as long as flesh is about to slip past the collider's middle.
  void stiffen_where_thin(Evaluation& now) {
    if (!contacts_.slips(now.contact.deepest)) return;
    contacts_.stiffen_for_thin();
    minimiser_.renew_metric();
    now = minimiser_.evaluate_contacts(true);
  }

  // Contacts are soft while the body finds its shape, and become stiffer with the first multipliers, then where the multipliers fill too slowly: the forces stay
  // as they are.
  void stiffen(double change) {
    const MultiplierConstants& c = constants_.multiplier;
    const bool first = figures_.updates == 1;
    if (++updates_since_ < c.patience && !first) return;
    updates_since_ = 0;
    if (first || (change > c.progress * change_before_ && change > settings_.penetration * rest_.diagonal && stiffer_ < c.stiffest)) {
      stiffer_ *= 2;
      contacts_.stiffen(2);
      minimiser_.renew_metric();
    }
    change_before_ = change;
  }

  void update_multipliers(Evaluation& now) {
    contacts_.update_multipliers();
    ++figures_.updates;
    stiffen(now.contact.change);
    now = minimiser_.evaluate_contacts(true);
  }

  // Before iteration `next`.
  void go_to_finer_grid(int next, Renewals& renewals) {
    minimiser_.refine();
    if (minimiser_.grid() > 0 || renewals.last == next - 1) {
      minimiser_.renew_volume_term();
    } else {
      minimiser_.renew_for_shape();
      minimiser_.forget_pairs();
      renewals.last = next;
    }
    const int interval = static_cast<int>(constants_.metric.interval);
    if (minimiser_.grid() == 0) renewals = {next + interval, interval, renewals.last};
  }

  Renewals first_renewals() const {
    const MetricConstants& c = constants_.metric;
    if (minimiser_.grid() > 0) return {static_cast<int>(c.coarse_first), static_cast<int>(c.coarse_interval)};
    const int interval = static_cast<int>(figures_.started ? c.started_interval : c.interval);
    return {interval, interval};
  }

  // What is due before iteration `done`.
  void renew(int done, Renewals& renewals) {
    const MetricConstants& c = constants_.metric;
    if (done == renewals.next || (minimiser_.metric_scale() < c.least_scale && done >= renewals.last + c.interval)) {
      minimiser_.renew_for_shape();
      if (done < c.forget_before || done < renewals.next) minimiser_.forget_pairs();
      renewals.done(done);
    }
    if (minimiser_.iterations_since_volume_term() >= c.volume_interval) minimiser_.renew_volume_term();
  }

  // What a solve that does not come to rest ends with, rather than with tets inside out: of the shapes that it passed, the one with the least error of a contact.
  void keep_if_good(const Evaluation& now) {
    if (minimiser_.grid() > 0 || !(now.least_volume > 0) || now.contact.change > kept_error_) return;
    kept_error_ = now.contact.change;
    parallel_for(executor_, rest_.vertices, CopyRows{minimiser_.u().data(), kept_.data()});
  }
  void go_back_to_kept(Evaluation& now) {
    if (kept_error_ == std::numeric_limits<float>::infinity()) return;
    parallel_for(executor_, rest_.vertices, CopyRows{kept_.data(), minimiser_.u().data()});
    energy_.forget_list();
    now = minimiser_.evaluate();
  }

  // The stopping rule (nodes/equilibrium.cpp says it in words).
  bool contacts_off(const Evaluation& now) const {
    const double mean = std::sqrt(now.contact.squares / std::max(1e-30f, now.contact.area));
    return std::max(static_cast<double>(now.contact.change), mean / constants_.stopping.mean_penetration) > settings_.penetration * rest_.diagonal;
  }
  bool volume_off() const { return std::abs(contacts_.volume_error()) > constants_.stopping.volume; }
  bool settled(const Evaluation& now) const {
    return !contacts_.by_entries() && !volume_off() && now.relative_gradient() <= settings_.threshold && figures_.step <= settings_.displacement;
  }

  bool multipliers_due(const Evaluation& now, int since_update) const {
    const MultiplierConstants& c = constants_.multiplier;
    const double often = figures_.way_in > 0 ? c.way_in_gradient : 1;
    return now.relative_gradient() <= often * settings_.memory_gradient * (since_update < c.soon ? c.soon_gradient : 1) ||
           since_update >= settings_.memory_interval;
  }

  void descend(Evaluation& now) {
    Renewals renewals = first_renewals();
    int since_update = 0, still = 0, on_grid = 0;
    figures_.ended = Ended::kIterationLimit;
    for (int done = 0; figures_.iterations < settings_.max_iterations; ++done) {
      if (done == constants_.way_in.iterations_on_side && contacts_.by_entries()) {
        contacts_.forget_entries();
        now = minimiser_.evaluate();
      }
      renew(done, renewals);
      const double before = now.energy;
      const bool went = iterate(now);
      if (!went && minimiser_.grid() == 0) {
        figures_.ended = Ended::kStalled;
        return;
      }
      ++on_grid;
      const StartConstants& start = constants_.start;
      if (minimiser_.grid() > 0 && (!went || (on_grid >= start.least_on_grid && now.energy > (1 - start.worth_staying) * before))) {
        go_to_finer_grid(done + 1, renewals);
        on_grid = 0;
      }
      ++since_update;
      keep_if_good(now);
      stiffen_where_thin(now);
      const bool off = contacts_off(now);
      if (settled(now) && !off) {
        figures_.ended = Ended::kAtRest;
        return;
      }
      still = minimiser_.grid() == 0 && figures_.step <= constants_.stopping.still && !off && !contacts_.by_entries() ? still + 1 : 0;
      if (still == constants_.stopping.still_steps) {
        figures_.ended = Ended::kRounding;
        return;
      }
      if ((off || volume_off()) && multipliers_due(now, since_update)) {
        update_multipliers(now);
        since_update = 0;
      }
    }
  }

  Buffer<Vec3f> positions() {
    Buffer<Vec3f> moved(rest_.vertices, executor_.memory());
    parallel_for(executor_, rest_.vertices, MovedVertices{rest_.on.rest, minimiser_.u().data(), rest_.on.vertex_at, moved.data_for_write()});
    return moved;
  }

  Executor& executor_;
  const EquilibriumRest& rest_;
  const EquilibriumSettings& settings_;
  const EquilibriumConstants& constants_;
  EquilibriumFigures& figures_;
  const Similarity to_world_;
  EquilibriumEnergy energy_;
  EquilibriumContacts& contacts_;
  EquilibriumMinimiser minimiser_;
  Rows kept_;
  float kept_error_ = std::numeric_limits<float>::infinity();
  int updates_since_ = 0;  // of the multipliers, since the last look at the contacts' error
  double change_before_ = 1e30, stiffer_ = 1;
};

}  // namespace

Buffer<Vec3f> solve_equilibrium(Executor& executor, const EquilibriumRest& rest, const Similarity& placement, std::span<const Sdf* const> colliders,
                                const EquilibriumSettings& settings, EquilibriumFigures& figures, EquilibriumState* end) {
  figures = {};
  if (rest.device != executor.device())
    throw Error(ErrorCode::kDevice, "equilibrium: the rest shape was prepared for " + rest.device.text() + ", not for " + executor.device().text(),
                "prepare it with the executor that solves");
  if (settings.start && settings.start->moved && (!settings.transfer || settings.transfer->size() != rest.vertices))
    throw Error(ErrorCode::kInternal, "equilibrium: a start without the way from its H to this one", "make it with make_mesh_transfer");
  Solver solver(executor, rest, placement, colliders, settings, figures);
  Buffer<Vec3f> moved = solver.run();
  if (end) *end = solver.state();
  return moved;
}

}  // namespace knead
