#include "kernels/equilibrium.h"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "graph/error.h"
#include "kernels/collide.h"
#include "kernels/contact_body.h"
#include "kernels/energy_lanes.h"
#include "kernels/equilibrium_rest.h"
#include "kernels/parallel.h"
#include "kernels/simd_level.h"

namespace knead {
namespace {

constexpr int kMemory = 8;                                  // pairs that L-BFGS remembers
constexpr double kBulk = 10;                                // stiffness of the enclosed volume over the body's own; the memory does the rest
constexpr int kBulkInterval = 10;                           // iterations between two looks at where the enclosed volume would grow
constexpr double kVolume = 1e-4;                            // relative error of the enclosed volume at rest
constexpr double kFirstContacts = 1, kLaterContacts = 0.3;  // share of the contacts' stiffness that goes into the metric
constexpr int kRenewal = 5;                                 // the iteration at which the contacts are as good as known
constexpr double kShorter = 0.7, kLonger = 1.05;            // how the metric is scaled when a full step was refused, or taken
constexpr int kPatience = 4;                                // updates of the memory after which its error should have fallen by
constexpr double kProgress = 0.5;                           // this factor, else contacts become stiffer,
constexpr double kStiffest = 16;                            // at most this much
constexpr float kSkin = 3;                                  // cells: samples as near as this to a collider are looked at
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

// One place of H: the sum of what acts on it.
struct Gather {
  const Row4* forces;  // by slot
  const uint32_t *slot_offsets, *slots;
  const Row4* u;
  const float *hold, *free;
  const Row4* contact;  // by sample; null when nothing pushes
  const uint32_t *back_offsets, *back_samples;
  const float* back_weights;
  Row4* gradient;

  struct Sum {
    double squares = 0, load = 0, energy = 0;
  };

  Sum operator()(uint32_t p) const {
    Pack<4> sum{};
    for (uint32_t e = slot_offsets[p]; e < slot_offsets[p + 1]; ++e) sum += *reinterpret_cast<const Pack<4>*>(forces + slots[e]);
    const Pack<4> at = *reinterpret_cast<const Pack<4>*>(u + p);
    sum += at * hold[p];
    Pack<4> push{};
    if (contact)
      for (uint32_t e = back_offsets[p]; e < back_offsets[p + 1]; ++e)
        push += *reinterpret_cast<const Pack<4>*>(contact + back_samples[e]) * back_weights[e];
    sum = (sum + push) * free[p];
    push = push * free[p];
    *reinterpret_cast<Pack<4>*>(gradient + p) = sum;
    const auto squared = [](const Pack<4>& v) { return static_cast<double>(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); };
    return {squared(sum), squared(push), 0.5 * static_cast<double>(hold[p]) * squared(at)};
  }
};

struct Evaluation {
  double energy = 0, gradient = 0, load = 0;  // gradient and load: lengths
  float least_volume = 1;
  ContactSum contact;
};

class Rows {
 public:
  explicit Rows(size_t n) : buffer_(n) { std::fill_n(data(), n, Row4{0, 0, 0, 0}); }
  Row4* data() { return buffer_.data_for_write(); }
  float* floats() { return &data()->x; }

 private:
  Buffer<Row4> buffer_;
};

class Solver {
 public:
  Solver(Executor& executor, const EquilibriumRest& rest, const Similarity& placement, std::span<const Sdf* const> colliders,
         const EquilibriumSettings& settings, EquilibriumFigures& figures)
      : executor_(executor),
        rest_(rest),
        settings_(settings),
        figures_(figures),
        lanes_(energy_lanes(executor)),
        u_(rest.rows),
        trial_(rest.rows),
        gradient_(rest.rows),
        trial_gradient_(rest.rows),
        direction_(rest.rows),
        forces_(4 * rest.stride),
        contact_(rest.samples.size() + 1),
        now_(rest.samples.size() + 1),
        volume_gradient_(rest.samples.size() + 1),
        bulk_(rest.rows),
        bulk_solved_(rest.rows),
        listed_at_(rest.rows),
        memory_(colliders.size() * rest.samples.size() + 1),
        distance_(memory_.size()),
        scratch_(rest.factor->scratch_floats() + 16) {
    std::fill_n(memory_.data_for_write(), memory_.size(), 0.0f);
    for (int k = 0; k < kMemory; ++k) steps_.emplace_back(rest.rows), changes_.emplace_back(rest.rows);
    set_contacts(placement, colliders);
  }

  Buffer<Vec3f> run() {
    const Clock::time_point start = Clock::now();
    Evaluation now = evaluate(u_, gradient_);
    if (now.contact.active == 0) {
      figures_.ended = "no contact";
      return rest_.rest;
    }
    if (find_entries()) now = evaluate(u_, gradient_);
    renew_metric();
    descend(now);
    figures_.volume = volume_error_;
    figures_.gradient = relative(now);
    figures_.penetration = now.contact.deepest / rest_.diagonal;
    figures_.least_volume = now.least_volume;
    figures_.energy = now.energy;
    figures_.contacts = now.contact.active;
    figures_.seconds = std::chrono::duration<double>(Clock::now() - start).count();
    return positions();
  }

 private:
  size_t floats() const { return 4 * size_t{rest_.rows}; }

  void set_contacts(const Similarity& placement, std::span<const Sdf* const> colliders) {
    if (colliders.size() > kMostColliders)
      throw Error(ErrorCode::kInput,
                  std::to_string(colliders.size()) + " colliders are more than the " + std::to_string(kMostColliders) + " that one solve takes",
                  "join some of them with union_sdf");
    const SampleTable& s = rest_.samples;
    body_.offsets = s.offsets.data();
    body_.indices = s.indices.data();
    body_.weights = s.weights.data();
    body_.rest = s.rest.data();
    body_.area = s.area.data();
    body_.force = contact_.data();
    body_.count = static_cast<uint32_t>(colliders.size());
    body_.samples = static_cast<uint32_t>(s.size());
    body_.to_local = static_cast<float>(rest_.to_local);
    body_.margin = static_cast<float>(settings_.margin / rest_.to_local);
    body_.stiffness = static_cast<float>(settings_.contact * rest_.contact_scale);
    for (size_t k = 0; k < colliders.size(); ++k) {
      check_margin(*colliders[k], placement, settings_.margin, k);
      body_.colliders[k] = view_collider(*colliders[k], executor_.device(), placement);
      skin_ = std::min(skin_, colliders[k]->outside_band * body_.colliders[k].scale / body_.to_local);
    }
  }

  ContactSum evaluate_contact(Rows& u) {
    ScopedTime time(figures_.contact_seconds);
    body_.u = u.data();
    body_.memory = memory_.data_for_write();
    body_.distance = distance_.data_for_write();
    keep_list(u);
    ContactSum sum = parallel_reduce(executor_, list_.size(), "contact_energy", ContactSum{}, body_, [](const ContactSum& a, const ContactSum& b) {
      return ContactSum{a.energy + b.energy, std::max(a.deepest, b.deepest), std::max(a.change, b.change), a.active + b.active};
    });
    if (!rest_.fans.empty()) sum.energy += add_volume();
    return sum;
  }

  // Samples that may touch something before H has moved further than the skin; the others push nothing.
  void keep_list(Rows& u) {
    if (listed_) {
      const Row4 *a = u.data(), *b = listed_at_.data();
      float most = 0;
      for (uint32_t p = 0; p < rest_.places; ++p) {
        const float x = a[p].x - b[p].x, y = a[p].y - b[p].y, z = a[p].z - b[p].z, squared = x * x + y * y + z * z;
        most = squared > most ? squared : most;
      }
      if (most < skin_ * skin_) return;
    }
    listed_ = true;
    std::copy_n(u.data(), rest_.rows, listed_at_.data());
    near_.resize(body_.samples);
    parallel_for(executor_, body_.samples, "contact_list", [&](uint32_t s) { near_[s] = body_.near(s, skin_); });
    list_.clear();
    Row4* force = contact_.data();
    float* distance = distance_.data_for_write();
    for (uint32_t s = 0; s < body_.samples; ++s) {
      if (near_[s]) {
        list_.push_back(s);
        continue;
      }
      force[s] = {0, 0, 0, 0};
      for (size_t k = 0; k < body_.count; ++k) distance[k * body_.samples + s] = ContactEnergy::kFar;
    }
    body_.list = list_.data();
  }

  // kb/2 V0 (V/V0 - 1 + memory)^2 for M as a whole: its gradient goes to the samples' forces.
  double add_volume() {
    const uint32_t n = static_cast<uint32_t>(rest_.fan_offsets.size() - 1);
    parallel_for(executor_, n, "vertex_places", VertexPlaces{body_, now_.data()});
    const VolumeGradient body{now_.data(), rest_.fan_offsets.data(), rest_.fans.data(), volume_gradient_.data()};
    const double volume = reduce_sum(executor_, n, "enclosed_volume", body);
    if (rest_volume_ == 0) rest_volume_ = volume;  // the first call is at rest
    const double stiffness = bulk_stiffness();
    volume_error_ = volume / rest_volume_ - 1;
    const double error = volume_error_ + volume_memory_;
    const float push = static_cast<float>(stiffness * error * (rest_volume_ < 0 ? -1 : 1));
    Row4* force = contact_.data();
    const Row4* gradient = volume_gradient_.data();
    for (uint32_t v = 0; v < n; ++v) {
      const Vec3f own = near_[v] ? to_vec(force[v]) : Vec3f{0, 0, 0};
      force[v] = to_row(own + push * to_vec(gradient[v]));
    }
    return 0.5 * stiffness * std::abs(rest_volume_) * error * error;
  }

  void gather(Rows& u, Rows& gradient, Evaluation& at) {
    const SampleTable& s = rest_.samples;
    const Gather body{forces_.data(),
                      rest_.slot_offsets.data(),
                      rest_.slots.data(),
                      u.data(),
                      rest_.hold.data(),
                      rest_.free.data(),
                      at.contact.active || !rest_.fans.empty() ? contact_.data() : nullptr,
                      s.back_offsets.data(),
                      s.back_samples.data(),
                      s.back_weights.data(),
                      gradient.data()};
    const Gather::Sum sum =
        parallel_reduce(executor_, rest_.places, "gather_forces", Gather::Sum{}, body, [](const Gather::Sum& a, const Gather::Sum& b) {
          return Gather::Sum{a.squares + b.squares, a.load + b.load, a.energy + b.energy};
        });
    at.gradient = std::sqrt(sum.squares);
    at.load = std::sqrt(sum.load);
    at.energy = elastic_energy_ + sum.energy + at.contact.energy;
  }

  Evaluation evaluate(Rows& u, Rows& gradient) {
    Evaluation at;
    ++figures_.evaluations;
    {
      ScopedTime time(figures_.elastic_seconds);
      const ElasticTets body{u.data(),
                             rest_.corners.host().data(),
                             rest_.shape.host().data(),
                             rest_.mu.host().data(),
                             rest_.lambda.host().data(),
                             forces_.data(),
                             rest_.stride,
                             rest_.term};
      const size_t grain = std::max(kTetsPerPiece, (rest_.stride / kMostPieces + 15) / 16 * 16);
      std::vector<ElasticSum>& parts = parts_;
      parts.resize(rest_.stride / grain + 1);
      executor_.parallel_ranges(rest_.stride, grain, [&](size_t begin, size_t end) {
        parts[begin / grain] = lanes_.elastic(body, static_cast<uint32_t>(begin), static_cast<uint32_t>(end));
      });
      elastic_energy_ = 0;
      at.least_volume = 3.4e38f;
      for (size_t piece = 0; piece * grain < rest_.stride; ++piece) {
        elastic_energy_ += parts[piece].energy;
        at.least_volume = std::min(at.least_volume, parts[piece].least_volume);
      }
    }
    at.contact = evaluate_contact(u);
    ScopedTime time(figures_.elastic_seconds);
    gather(u, gradient, at);
    return at;
  }

  // Where a collider has come in deep, the nearest way out may lead to the other side, or sideways out of a half-sunk ball. So a start from rest goes
  // by the way in: against the mean of M's normals over the samples that are inside. Each of these first has to go as far along it as it takes to
  // come out.
  bool find_entries() {
    const SampleTable& s = rest_.samples;
    const float* distance = distance_.data_for_write();
    exits_.assign(body_.count * s.size(), -1.0f);
    bool any = false;
    for (uint32_t k = 0; k < body_.count; ++k) {
      Vec3d facing{0, 0, 0};
      double area = 0;
      for (size_t i = 0; i < s.size(); ++i)
        if (distance[k * s.size() + i] < 0) {
          facing += to_double(s.outward[i]);
          area += length(to_double(s.outward[i]));
        }
      const double size = length(facing);
      if (!(size > 0.3 * area) || area == 0) continue;
      body_.entry[k] = to_float((-1 / size) * facing);
      const ContactExit body{body_, k, exits_.data() + k * s.size()};
      parallel_for(executor_, s.size(), "contact_exit", body, 64);
      any = true;
    }
    body_.exits = any ? exits_.data() : nullptr;
    listed_ = !any;
    return any;
  }

  // A memory that fills too slowly gets stiffer contacts: the forces stay as they are.
  void stiffen(double change) {
    if (++updates_since_ >= kPatience) {
      updates_since_ = 0;
      if (change > kProgress * change_before_ && change > settings_.penetration * rest_.diagonal && stiffer_ < kStiffest) {
        stiffer_ *= 2;
        body_.stiffness *= 2;
        float* memory = memory_.data_for_write();
        for (size_t i = 0; i + 1 < memory_.size(); ++i) memory[i] *= 0.5f;
        renew_metric();
      }
      change_before_ = change;
    }
  }

  // lambda <- max(0, lambda - phi), then the gradient anew at the same place.
  void update_memory(Evaluation& now) {
    float* memory = memory_.data_for_write();
    const float* distance = distance_.data_for_write();
    for (size_t i = 0; i + 1 < memory_.size(); ++i) memory[i] = std::max(0.0f, memory[i] - distance[i]);
    volume_memory_ += volume_error_;
    ++figures_.updates;
    stiffen(now.contact.change);
    now.contact = evaluate_contact(u_);
    gather(u_, gradient_, now);
  }

  double relative(const Evaluation& at) const { return at.load > 0 ? at.gradient / at.load : 0; }

  // P with the samples that push now: kc a w on the diagonal, lumped, the same for x, y and z.
  void renew_metric() {
    ScopedTime time(figures_.factor_seconds);
    const double share = figures_.factors == 0 ? kFirstContacts : kLaterContacts;
    const SampleTable& s = rest_.samples;
    std::vector<float> weight(s.size(), 0), diagonal = rest_.metric_diagonal;
    const float *memory = memory_.data_for_write(), *distance = distance_.data_for_write();
    for (size_t k = 0; k < body_.count; ++k)
      for (size_t i = 0; i < s.size(); ++i)
        if (distance[k * s.size() + i] < memory[k * s.size() + i]) weight[i] += static_cast<float>(share) * body_.stiffness * s.area[i];
    for (uint32_t p = 0; p < rest_.places; ++p)
      for (uint32_t e = s.back_offsets[p]; e < s.back_offsets[p + 1]; ++e)
        if (rest_.free[p] != 0) diagonal[p] += weight[s.back_samples[e]] * s.back_weights[e];
    factor_ = std::make_unique<SparseCholesky>(executor_, lanes_, *rest_.factor, diagonal);
    ++figures_.factors;
    renew_bulk();
  }

  void apply_metric(Rows& x) {
    ScopedTime time(figures_.solve_seconds);
    (factor_ ? *factor_ : *rest_.factor).solve(lanes_, x.data(), scratch_.data_for_write());
    if (rest_.fans.empty()) return;
    // The enclosed volume's part of the Hessian has rank 1 (Sherman and Morrison 1950).
    const double along = lanes_.dot(bulk_.floats(), x.floats(), floats());
    lanes_.add_scaled(x.floats(), bulk_solved_.floats(), static_cast<float>(-along * bulk_factor_), floats());
  }

  void renew_bulk() {
    if (rest_.fans.empty()) return;
    const SampleTable& s = rest_.samples;
    const uint32_t vertices = static_cast<uint32_t>(rest_.fan_offsets.size() - 1);
    const Row4* gradient = volume_gradient_.data();
    Row4 *to = bulk_.data(), *solved = bulk_solved_.data();
    for (uint32_t p = 0; p < rest_.places; ++p) {
      Vec3f sum{0, 0, 0};
      for (uint32_t e = s.back_offsets[p]; e < s.back_offsets[p + 1]; ++e)
        if (s.back_samples[e] < vertices) sum += s.back_weights[e] * to_vec(gradient[s.back_samples[e]]);
      to[p] = solved[p] = to_row(rest_.free[p] * sum);
    }
    factor_->solve(lanes_, solved, scratch_.data_for_write());
    bulk_factor_ = 1 / (std::abs(rest_volume_) / bulk_stiffness() + lanes_.dot(bulk_.floats(), bulk_solved_.floats(), floats()));
  }

  double bulk_stiffness() const { return kBulk * (1 + rest_.bulk); }

  // direction_ <- -(metric of the last pairs) gradient
  void make_direction() {
    float* d = direction_.floats();
    std::copy_n(gradient_.floats(), floats(), d);
    double weight[kMemory];
    for (int k = pairs_ - 1; k >= 0; --k) {
      const int slot = (newest_ - (pairs_ - 1 - k) + kMemory) % kMemory;
      weight[slot] = lanes_.dot(steps_[static_cast<size_t>(slot)].floats(), d, floats()) * over_[slot];
      lanes_.add_scaled(d, changes_[static_cast<size_t>(slot)].floats(), static_cast<float>(-weight[slot]), floats());
    }
    apply_metric(direction_);
    if (scale_ != 1)
      for (size_t i = 0; i < floats(); ++i) d[i] *= static_cast<float>(scale_);
    for (int k = 0; k < pairs_; ++k) {
      const int slot = (newest_ - (pairs_ - 1 - k) + kMemory) % kMemory;
      const double back = lanes_.dot(changes_[static_cast<size_t>(slot)].floats(), d, floats()) * over_[slot];
      lanes_.add_scaled(d, steps_[static_cast<size_t>(slot)].floats(), static_cast<float>(weight[slot] - back), floats());
    }
    for (size_t i = 0; i < floats(); ++i) d[i] = -d[i];
  }

  // Remembers the step from (u_, gradient_) to (trial_, trial_gradient_).
  void remember() {
    const int slot = (newest_ + 1) % kMemory;
    float *s = steps_[static_cast<size_t>(slot)].floats(), *y = changes_[static_cast<size_t>(slot)].floats();
    lanes_.combine(s, trial_.floats(), u_.floats(), -1, floats());
    lanes_.combine(y, trial_gradient_.floats(), gradient_.floats(), -1, floats());
    const double sy = lanes_.dot(s, y, floats());
    if (!(sy > 1e-10 * std::sqrt(lanes_.dot(s, s, floats()) * lanes_.dot(y, y, floats())))) return;
    over_[slot] = 1 / sy;
    newest_ = slot;
    pairs_ = std::min(pairs_ + 1, kMemory);
  }

  double longest_step() {
    const Row4 *a = trial_.data(), *b = u_.data();
    double most = 0;
    for (uint32_t p = 0; p < rest_.places; ++p) most = std::max(most, static_cast<double>(length(to_vec(a[p]) - to_vec(b[p]))));
    return most / rest_.diagonal;
  }

  bool search(const Evaluation& now, double slope, Evaluation& next) {
    double along = 1;
    for (int attempt = 0; attempt < 12; ++attempt) {
      lanes_.combine(trial_.floats(), u_.floats(), direction_.floats(), static_cast<float>(along), floats());
      next = evaluate(trial_, trial_gradient_);
      const bool lower = next.energy <= now.energy + kArmijo * along * slope + kEnergyRounding * std::abs(now.energy);
      if (lower) {
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

  void descend(Evaluation& now) {
    int since_update = 0;
    figures_.ended = "iterations";
    while (figures_.iterations < settings_.max_iterations) {
      if (settings_.check_cancelled) settings_.check_cancelled();
      if (figures_.iterations == kRenewal) {
        if (body_.exits) {  // the shape has the right side by now
          body_.exits = nullptr;
          evaluate_again(now);
        }
        renew_metric();
      }
      if (figures_.iterations % kBulkInterval == 0 && figures_.iterations > 0) renew_bulk();
      make_direction();
      double slope = lanes_.dot(gradient_.floats(), direction_.floats(), floats());
      if (!(slope < 0) && pairs_ > 0) {
        pairs_ = 0;
        make_direction();
        slope = lanes_.dot(gradient_.floats(), direction_.floats(), floats());
      }
      Evaluation next;
      if (!(slope < 0) || !search(now, slope, next)) {
        if (pairs_ > 0) {
          pairs_ = 0;
          evaluate_again(now);
          continue;
        }
        figures_.ended = "stalled";
        evaluate_again(now);
        return;
      }
      ++figures_.iterations;
      ++since_update;
      figures_.step = longest_step();
      remember();
      std::swap(u_, trial_);
      std::swap(gradient_, trial_gradient_);
      now = next;
      const double change = now.contact.change / rest_.diagonal;
      const bool settled =
          !body_.exits && std::abs(volume_error_) <= kVolume && relative(now) <= settings_.gradient && figures_.step <= settings_.displacement;
      if (settled && change <= settings_.penetration) {
        figures_.ended = "rest";
        return;
      }
      if ((change > settings_.penetration || std::abs(volume_error_) > kVolume) &&
          (relative(now) <= settings_.memory_gradient || since_update >= settings_.memory_interval)) {
        update_memory(now);
        since_update = 0;
      }
    }
  }

  void evaluate_again(Evaluation& now) { now = evaluate(u_, gradient_); }

  Buffer<Vec3f> positions() {
    Buffer<Vec3f> moved(rest_.places, executor_.memory());
    Vec3f* to = moved.data_for_write();
    const auto x = rest_.rest.host();
    const Row4* u = u_.data();
    for (uint32_t p = 0; p < rest_.places; ++p) {
      const uint32_t v = rest_.vertex_at[p];
      to[v] = x[v] + to_vec(u[p]);
    }
    return moved;
  }

  Executor& executor_;
  const EquilibriumRest& rest_;
  const EquilibriumSettings& settings_;
  EquilibriumFigures& figures_;
  const EnergyLanes& lanes_;
  Rows u_, trial_, gradient_, trial_gradient_, direction_, forces_, contact_, now_, volume_gradient_, bulk_, bulk_solved_, listed_at_;
  std::vector<Rows> steps_, changes_;
  double over_[kMemory] = {};  // 1 / s.y
  int pairs_ = 0, newest_ = kMemory - 1;
  Buffer<float> memory_, distance_, scratch_;
  std::vector<ElasticSum> parts_;
  double elastic_energy_ = 0, rest_volume_ = 0, volume_error_ = 0, volume_memory_ = 0, bulk_factor_ = 0, scale_ = 1;
  std::vector<float> exits_;
  std::vector<uint32_t> list_;
  std::vector<char> near_;
  float skin_ = kSkin;  // cells
  int updates_since_ = 0;
  double change_before_ = 1e30, stiffer_ = 1;
  bool listed_ = false;
  ContactEnergy body_{};
  std::unique_ptr<SparseCholesky> factor_;  // of this frame's contacts
};

}  // namespace

const EnergyLanes& energy_lanes(const Executor& executor) {
  switch (simd_level(executor)) {
    case SimdLevel::kAvx512: return *energy_lanes_avx512();
    case SimdLevel::kAvx2: return *energy_lanes_avx2();
    case SimdLevel::kBaseline: return *energy_lanes_baseline();
    case SimdLevel::kScalar: break;
  }
  return *energy_lanes_scalar();
}

Buffer<Vec3f> solve_equilibrium(Executor& executor, const EquilibriumRest& rest, const Similarity& placement, std::span<const Sdf* const> colliders,
                                const EquilibriumSettings& settings, EquilibriumFigures& figures) {
  figures = {};
  return Solver(executor, rest, placement, colliders, settings, figures).run();
}

}  // namespace knead
