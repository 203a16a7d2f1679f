#include "kernels/equilibrium/equilibrium.h"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "graph/error.h"
#include "kernels/equilibrium/contacts.h"
#include "kernels/equilibrium/energy_simd.h"
#include "kernels/equilibrium/lbfgs.h"
#include "kernels/equilibrium/mesh_transfer.h"
#include "kernels/equilibrium/rows.h"
#include "kernels/parallel.h"
#include "kernels/simd_level.h"

namespace knead {
namespace {

constexpr int kBulkInterval = 10;       // iterations after which it is looked at again where the enclosed volume would grow
constexpr double kVolume = 1e-4;        // relative error of the enclosed volume at rest
constexpr uint32_t kSmall = 8000;       // vertices of an H that begins with itself: it has few tets to crumple. Others begin with
constexpr uint32_t kFirstNodes = 1500;  // a grid of so many nodes at most;
constexpr int kLeastOnGrid = 2;         // iterations on one; from then on it is left when one of them
constexpr double kWorthStaying = 0.1;   // takes less than this part of the energy away
constexpr int kSides = 4;               // iterations in which contacts stay on the side that was told from the rest shape
constexpr int kRenewal = 4;             // iterations on H itself until the metric follows the shape, then as many, twice as many and so on;
constexpr int kFirstRenewal = 1, kCoarseRenewal = 2;  // the first one and the time to the next on coarse grids, where the body moves far,
constexpr int kStartedRenewal = 16;                   // and the same as kRenewal where it began nearly there, with a metric of that shape;
constexpr double kAstray = 0.3;                       // or where refused steps have scaled the metric down to this,
constexpr int kAgain = 8;                             // so many iterations after the last time
constexpr int kForget = 9;                            // until when pairs tell of a body that was far from the one that the metric follows
constexpr double kStride = 0.01;                      // of M's diagonal: how far a collider that stands back comes in an iteration at most,
constexpr int kWayRenewal = 8;                        // and after how many of them the metric is renewed
constexpr double kShorter = 0.7, kLonger = 1.05;      // how the metric is scaled when a full step was refused, or taken
constexpr int kSoon = 3;                              // iterations in which the memory is updated again only where the gradient is
constexpr double kClear = 0.3;                        // so far below what is asked: else the two keep each other moving
constexpr double kOnTheWay = 4;    // times the gradient at which the memory is updated, where colliders came in: else flesh gets past
constexpr int kPatience = 4;       // updates of the memory after which its error should have fallen by
constexpr double kProgress = 0.5;  // this factor, else contacts become stiffer,
constexpr double kStiffest = 64;   // at most this much
constexpr double kMean = 0.05;     // the mean error of contacts at rest, relative to the largest
constexpr double kStill = 1e-8;    // a step, in diagonals, that is lost in rounding; after
constexpr int kStillFor = 5;       // so many of them it is over
constexpr double kArmijo = 1e-4;
constexpr double kEnergyRounding = 2e-7;  // of the energy: what float32 terms leave uncertain
constexpr size_t kTetsPerPiece = 1024;
constexpr size_t kMostPieces = 4096;

using Clock = std::chrono::steady_clock;

struct ScopedTime {
  explicit ScopedTime(double& to) : sum(to) {}
  ~ScopedTime() { sum += std::chrono::duration<double>(Clock::now() - start).count(); }
  double& sum;
  Clock::time_point start = Clock::now();
};

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

struct Evaluation {
  double energy = 0, gradient = 0, load = 0;  // gradient and load: lengths
  float least_volume = 1;
  ContactSum contact;
};

class Solver {
 public:
  Solver(Executor& executor, const EquilibriumRest& rest, const Similarity& placement, std::span<const Sdf* const> colliders,
         const EquilibriumSettings& settings, EquilibriumFigures& figures)
      : executor_(executor),
        rest_(rest),
        settings_(settings),
        figures_(figures),
        lanes_(energy_simd(executor)),
        sums_(1, executor.memory()),
        contacts_(executor, rest, placement, colliders, settings, sums_.data_for_write(), seen_),
        u_(executor, rest.rows),
        trial_(executor, rest.rows),
        gradient_(executor, rest.rows),
        trial_gradient_(executor, rest.rows),
        direction_(executor, rest.grids->solve_rows()),
        forces_(executor, 4 * rest.stride),
        listed_at_(executor, rest.rows),
        descent_(executor, rest),
        blocks_(kBlock * size_t{rest.places}, executor.memory()),
        work_(rest.grids->work_rows(), executor.memory()) {
    seen_.volume.stiffness = contacts_.volume_stiffness();
    executor.copy(&seen_, Device{}, sums_.data_for_write(), executor.device(), sizeof seen_);
  }

  Buffer<Vec3f> run() {
    const Clock::time_point start = Clock::now();
    Evaluation now = evaluate(u_, gradient_);
    if (!begin(now) && !begin_at_rest(now)) {
      figures_.ended = "no contact";
      return rest_.rest;
    }
    descend(now);
    if (contacts_.longest_way() > 0) figures_.enclosed = contacts_.enclosed();  // let through on the way in
    figures_.volume = contacts_.volume_error();
    figures_.gradient = relative(now);
    figures_.penetration = now.contact.deepest / rest_.diagonal;
    figures_.least_volume = now.least_volume;
    figures_.energy = now.energy - now.contact.energy;
    figures_.contacts = now.contact.active;
    figures_.seconds = std::chrono::duration<double>(Clock::now() - start).count();
    return positions();
  }

  // After run, for a solve on another H.
  EquilibriumState state() {
    EquilibriumState state;
    state.undecided = figures_.undecided;
    state.enclosed = figures_.enclosed;
    if (figures_.ended == "no contact") return state;
    std::vector<Row4> u(rest_.places);
    executor_.copy(u_.data(), executor_.device(), u.data(), Device{}, u.size() * sizeof(Row4));
    executor_.synchronise();
    state.moved = Buffer<Vec3f>(u.size());
    const auto to_local = [&](const Row4& at) { return to_float(rest_.to_local.scale * rest_.to_local.rotate(to_double(to_vec(at)))); };
    std::transform(u.begin(), u.end(), state.moved.data_for_write(), to_local);
    state.pressures = contacts_.pressures();
    state.volume_pressure = contacts_.volume_pressure();
    return state;
  }

 private:
  bool on_host() const { return executor_.device() == Device{}; }

  // False when nothing touches.
  bool begin_at_rest(Evaluation& now) {
    if (length(settings_.entry) == 0) figures_.enclosed = contacts_.enclosed();
    if (may_touch(now) && contacts_.find_entries(settings_.entry)) {
      come_in(now);
      listed_ = false;
      now = evaluate(u_, gradient_);
    }
    if (now.contact.active == 0 && figures_.iterations == 0) return false;
    if (!metric_) {
      grid_ = first_grid();
      renew_metric();
    }
    figures_.undecided = contacts_.undecided();
    return true;
  }

  bool may_touch(const Evaluation& at_rest) const { return at_rest.contact.active > 0 || length(settings_.entry) > 0; }

  // Where the solve on another H ended. False when there is none, or when here nothing touches there.
  bool begin(Evaluation& now) {
    const EquilibriumState* start = settings_.start;
    if (!start || !start->moved) return false;
    if (settings_.friction > 0 && may_touch(now) && contacts_.find_entries(settings_.entry)) contacts_.forget_entries();
    move_to(transferred(*start, *settings_.transfer));
    contacts_.set_pressures(start->pressures.host(), start->volume_pressure);
    listed_ = false;
    now = evaluate(u_, gradient_);
    if (now.contact.active == 0) {
      move_to(std::vector<Row4>(rest_.places));
      contacts_.set_pressures({}, 0);
      listed_ = false;
      now = evaluate(u_, gradient_);
      return false;
    }
    contacts_.stick();
    now = balance(u_, gradient_);
    renew_for_shape();
    figures_.started = true;
    figures_.undecided = start->undecided;
    figures_.enclosed = start->enclosed;
    return true;
  }

  std::vector<Row4> transferred(const EquilibriumState& start, const MeshTransfer& transfer) const {
    const Similarity to_cells = rest_.to_local.inverse();
    const auto moved = start.moved.host();
    std::vector<Row4> u(rest_.places);
    for (uint32_t p = 0; p < rest_.places; ++p) {
      Vec3f sum{0, 0, 0};
      for (size_t c = 0; c < 4; ++c) sum += transfer.weights[p][c] * moved[transfer.places[p][c]];
      u[p] = to_row(rest_.free[p] * to_float(to_cells.scale * to_cells.rotate(to_double(sum))));
    }
    return u;
  }

  void move_to(const std::vector<Row4>& u) {
    executor_.copy(u.data(), Device{}, u_.data(), executor_.device(), u.size() * sizeof(Row4));
    executor_.synchronise();
  }

  EquilibriumSums& sums() { return *sums_.data_for_write(); }  // in the executor's memory

  // Samples out of reach are looked at again when H has moved far enough. A device has not told how far that is: see balance.
  void evaluate_contacts(Rows& u, bool again) {
    ScopedTime time(figures_.contact_seconds);
    if (!listed_) list_contacts(u, -1);
    measure(u, listed_at_, &sums().travelled);
    if (on_host() && !(sums().travelled < contacts_.skin())) {
      list_contacts(u, sums().travelled);
      sums().travelled = 0;
    }
    contacts_.evaluate(u.data(), again);
  }

  void list_contacts(Rows& u, float travelled) {
    listed_ = true;
    parallel_for(executor_, rest_.places, "copy_quads", CopyQuads{u.data(), listed_at_.data()});
    contacts_.list_samples(u.data(), travelled);
  }

  void measure(Rows& from, Rows& to, float* farthest) { reduce(executor_, rest_.places, Farthest{from.data(), to.data(), farthest}); }

  void gather(Rows& u, Rows& gradient) {
    ScopedTime time(figures_.elastic_seconds);
    const RestTables& t = rest_.on;
    reduce(executor_, rest_.places,
           GatherForces{forces_.data(), t.slot_offsets, t.slots, u.data(), t.hold, t.free, contacts_.pushes(), contacts_.forces(), t.back_offsets,
                        t.back_samples, t.back_weights, gradient.data(), &sums().forces});
  }

  void evaluate_elastic(Rows& u) {
    ScopedTime time(figures_.elastic_seconds);
    const RestTables& t = rest_.on;
    const ElasticTets body{u.data(), t.corners, t.shape, t.mu, t.lambda, forces_.data(), rest_.stride, rest_.term};
    if (!on_host()) return reduce(executor_, rest_.stride, ElasticEnergy{body, &sums().elastic});
    const size_t grain = std::max(kTetsPerPiece, (rest_.stride / kMostPieces + 15) / 16 * 16);
    parts_.resize(rest_.stride / grain + 1);
    executor_.parallel_ranges(rest_.stride, grain, [&](size_t begin, size_t end) {
      parts_[begin / grain] = lanes_.elastic(body, static_cast<uint32_t>(begin), static_cast<uint32_t>(end));
    });
    ElasticSum sum;
    for (size_t piece = 0; piece * grain < rest_.stride; ++piece) sum = ElasticEnergy::combine(sum, parts_[piece]);
    sums().elastic = sum;
  }

  Evaluation evaluate(Rows& u, Rows& gradient) {
    ++figures_.evaluations;
    evaluate_elastic(u);
    return balance(u, gradient);
  }

  // The rest of an evaluation at the place of the last elastic one, and the host's look at what came of it. `again`: only memories have changed since.
  Evaluation balance(Rows& u, Rows& gradient, bool again = false) {
    for (;;) {
      const bool fresh = !listed_;
      evaluate_contacts(u, again);
      gather(u, gradient);
      look();
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

  void look() {
    executor_.copy(&sums(), executor_.device(), &seen_, Device{}, sizeof seen_);
    executor_.synchronise();
  }

  // Contacts are soft while the body finds its shape, and become stiffer with the first memory, then where it fills too slowly: the forces stay as they are.
  void stiffen(double change) {
    const bool first = figures_.updates == 1;
    if (++updates_since_ < kPatience && !first) return;
    updates_since_ = 0;
    if (first || (change > kProgress * change_before_ && change > settings_.penetration * rest_.diagonal && stiffer_ < kStiffest)) {
      stiffer_ *= 2;
      contacts_.stiffen(2);
      renew_metric();
    }
    change_before_ = change;
  }

  // The memories, then the gradient anew at the same place.
  void update_memory(Evaluation& now) {
    contacts_.update_memory();
    ++figures_.updates;
    stiffen(now.contact.change);
    now = balance(u_, gradient_, true);
  }

  double relative(const Evaluation& at) const { return at.load > 0 ? at.gradient / at.load : 0; }

  // Of the shape that the Hessian was last made for, with the samples that push now.
  void renew_metric() {
    {
      ScopedTime time(figures_.renewal_seconds);
      float* blocks = blocks_.data_for_write();
      contacts_.make_blocks(blocks);
      metric_ = std::make_unique<Multigrid>(executor_, *rest_.grids, deformed_.gradients.empty() ? rest_.hessian : deformed_.now, blocks);
      ++figures_.metrics;
    }
    renew_bulk();
  }

  // For the body as it is deformed now.
  void renew_for_shape() {
    {
      ScopedTime time(figures_.renewal_seconds);
      metric_.reset();
      rest_.follow(executor_, u_.data(), deformed_);
      scale_ = 1;
    }
    renew_metric();
  }

  void renew_bulk() {
    bulk_at_ = figures_.iterations;
    if (contacts_.keeps_volume()) descent_.renew_bulk(*metric_, lanes_, contacts_, grid_, work_.data_for_write());
  }

  void make_direction() {
    ScopedTime time(figures_.direction_seconds);
    descent_.make(*metric_, lanes_, grid_, static_cast<float>(scale_), gradient_, direction_, &sums().slope, work_.data_for_write());
  }

  bool search(const Evaluation& now, Evaluation& next) {
    double along = 1;
    for (int attempt = 0; attempt < 12; ++attempt) {
      if (on_host() && !(sums().slope < 0)) return false;
      parallel_for(executor_, rest_.places, "combine_rows", CombineRows{trial_.data(), u_.data(), direction_.data(), static_cast<float>(along)});
      measure(trial_, u_, &sums().step);
      next = evaluate(trial_, trial_gradient_);
      const double slope = seen_.slope;
      if (!(slope < 0)) return false;
      const bool lower = next.energy <= now.energy + kArmijo * along * slope + kEnergyRounding * std::abs(now.energy);
      if (lower) {
        along_ = along;
        scale_ = attempt > 0 ? std::max(0.1, kShorter * scale_) : std::min(1.0, kLonger * scale_);
        return true;
      }
      // The parabola through both energies and the slope, kept within a tenth and a half.
      const double curved = 2 * (next.energy - now.energy - along * slope);
      const double best = curved > 0 ? -slope * along * along / curved : 0.5 * along;
      along = std::clamp(best, 0.1 * along, 0.5 * along);
    }
    return false;
  }

  // One iteration of L-BFGS. False when no step goes down any more.
  bool iterate(Evaluation& now) {
    if (settings_.check_cancelled) settings_.check_cancelled();
    for (bool fresh = !descent_.remembers();; fresh = true) {
      make_direction();
      Evaluation next;
      if (search(now, next)) {
        ++figures_.iterations;
        figures_.step = seen_.step / rest_.diagonal;
        descent_.remember(u_, trial_, gradient_, trial_gradient_, along_);
        std::swap(u_, trial_);
        std::swap(gradient_, trial_gradient_);
        now = next;
        return true;
      }
      descent_.forget();
      now = evaluate(u_, gradient_);
      if (fresh) return false;
    }
  }

  // With the body at rest.
  bool free_at(double share) {
    contacts_.stand_back(share);
    listed_ = false;
    balance(u_, gradient_);
    return contacts_.stand_free();
  }

  // Colliders that stand back come to their places. Their ways lead out of what they are in there; what they pass before may take more.
  void come_in(Evaluation& now) {
    const double whole =
        contacts_.steps_in(kStride * rest_.diagonal);  // the last one is shorter: so frames of a sweep go the same way, each a little farther
    const int steps = static_cast<int>(std::ceil(whole));
    const auto share_after = [&](int step) { return std::max(0.0, 1 - step / whole); };
    int first = 1;
    while (steps > 0 && first > 1 - steps && !free_at(share_after(first - 1))) --first;
    for (int step = first; step <= steps; ++step) {
      contacts_.stand_back(share_after(step));
      listed_ = false;
      now = evaluate(u_, gradient_);
      if (now.contact.active == 0) continue;
      if (step % kWayRenewal == 0 || !metric_) renew_metric();
      iterate(now);
      contacts_.update_memory();  // else the flesh that is carried along gets past a collider's middle: a penalty alone gives way
      now = balance(u_, gradient_, true);
    }
    figures_.way_in = figures_.iterations;
    if (steps > 0) renew_metric();
  }

  // From rest the body moves as a coarse grid can at first, then as finer ones: steps of all of H crumple fine tets under fresh contacts, and many more are
  // spent on smoothing them out.
  size_t first_grid() const {
    const std::vector<MultigridLevel>& grids = rest_.grids->levels();
    size_t k = 0;
    if (rest_.places <= kSmall) return k;
    while (k + 1 < grids.size() && grids[k].size > kFirstNodes) ++k;
    return k;
  }

  // On to the next finer grid before iteration `next`.
  void refine(int next, Renewals& renewals) {
    --grid_;
    if (grid_ > 0 || renewals.last == next - 1) {
      renew_bulk();
    } else {
      renew_for_shape();
      descent_.forget();
      renewals.last = next;
    }
    if (grid_ == 0) renewals = {next + kRenewal, kRenewal, renewals.last};
  }

  void descend(Evaluation& now) {
    const int interval = figures_.started ? kStartedRenewal : kRenewal;
    Renewals renewals = grid_ > 0 ? Renewals{kFirstRenewal, kCoarseRenewal} : Renewals{interval, interval};
    int since_update = 0, still = 0, on_grid = 0;
    const double often = figures_.way_in > 0 ? kOnTheWay : 1;
    figures_.ended = "iterations";
    for (int done = 0; done < settings_.max_iterations; ++done) {
      if (done == kSides && contacts_.by_entries()) {  // the shape has the right side by now
        contacts_.forget_entries();
        now = evaluate(u_, gradient_);
      }
      if (done == renewals.next || (scale_ < kAstray && done >= renewals.last + kAgain)) {
        renew_for_shape();
        if (done < kForget || done < renewals.next) descent_.forget();
        renewals.done(done);
      }
      if (figures_.iterations >= bulk_at_ + kBulkInterval) renew_bulk();
      const double before = now.energy;
      const bool went = iterate(now);
      if (!went && grid_ == 0) {
        figures_.ended = "stalled";
        return;
      }
      ++on_grid;
      if (grid_ > 0 && (!went || (on_grid >= kLeastOnGrid && now.energy > (1 - kWorthStaying) * before))) {
        refine(done + 1, renewals);
        on_grid = 0;
      }
      ++since_update;
      const double mean = std::sqrt(now.contact.squares / std::max(1e-30f, now.contact.area));
      const bool off = std::max(static_cast<double>(now.contact.change), mean / kMean) > settings_.penetration * rest_.diagonal;
      const bool settled = !contacts_.by_entries() && std::abs(contacts_.volume_error()) <= kVolume && relative(now) <= settings_.gradient &&
                           figures_.step <= settings_.displacement;
      if (settled && !off) {
        figures_.ended = "rest";
        return;
      }
      still = grid_ == 0 && figures_.step <= kStill && !off && !contacts_.by_entries() ? still + 1 : 0;
      if (still == kStillFor) {
        figures_.ended = "rounding";
        return;
      }
      if ((off || std::abs(contacts_.volume_error()) > kVolume) &&
          (relative(now) <= often * settings_.memory_gradient * (since_update < kSoon ? kClear : 1) || since_update >= settings_.memory_interval)) {
        update_memory(now);
        since_update = 0;
      }
    }
  }

  Buffer<Vec3f> positions() {
    Buffer<Vec3f> moved(rest_.places, executor_.memory());
    parallel_for(executor_, rest_.places, "moved_places", MovedPlaces{rest_.on.rest, u_.data(), rest_.on.vertex_at, moved.data_for_write()});
    return moved;
  }

  Executor& executor_;
  const EquilibriumRest& rest_;
  const EquilibriumSettings& settings_;
  EquilibriumFigures& figures_;
  const EnergySimd& lanes_;
  Buffer<EquilibriumSums> sums_;
  EquilibriumSums seen_;  // what the host last saw of them
  EquilibriumContacts contacts_;
  Rows u_, trial_, gradient_, trial_gradient_, direction_, forces_, listed_at_;
  Descent descent_;
  Buffer<float> blocks_;
  Buffer<Row4> work_;
  std::vector<ElasticSum> parts_;
  double scale_ = 1, along_ = 1;  // of the metric; of the last direction, the last step
  int updates_since_ = 0, bulk_at_ = 0;
  double change_before_ = 1e30, stiffer_ = 1;
  bool listed_ = false;
  size_t grid_ = 0;                    // the finest one of the metric that makes directions
  ShapeHessian deformed_;              // in place of the rest shape's, once it is not empty
  std::unique_ptr<Multigrid> metric_;  // of this frame's contacts
};

}  // namespace

const EnergySimd& energy_simd(const Executor& executor) {
  switch (simd_level(executor)) {
    case SimdLevel::kAvx512: return *energy_simd_avx512();
    case SimdLevel::kAvx2: return *energy_simd_avx2();
    case SimdLevel::kBaseline: return *energy_simd_baseline();
    case SimdLevel::kScalar: break;
  }
  return *energy_simd_scalar();
}

Buffer<Vec3f> solve_equilibrium(Executor& executor, const EquilibriumRest& rest, const Similarity& placement, std::span<const Sdf* const> colliders,
                                const EquilibriumSettings& settings, EquilibriumFigures& figures, EquilibriumState* end) {
  figures = {};
  if (rest.device != executor.device())
    throw Error(ErrorCode::kDevice, "equilibrium: the rest shape was prepared for " + rest.device.text() + ", not for " + executor.device().text(),
                "prepare it with the executor that solves");
  if (settings.start && settings.start->moved && (!settings.transfer || settings.transfer->size() != rest.places))
    throw Error(ErrorCode::kInternal, "equilibrium: a start without the way from its H to this one", "make it with make_mesh_transfer");
  Solver solver(executor, rest, placement, colliders, settings, figures);
  Buffer<Vec3f> moved = solver.run();
  if (end) *end = solver.state();
  return moved;
}

}  // namespace knead
