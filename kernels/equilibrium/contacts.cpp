#include "kernels/equilibrium/contacts.h"

#include <bit>
#include <cmath>

#include "kernels/loop/collide.h"
#include "kernels/parallel.h"

namespace knead {
namespace {

// Samples as near to a collider as this are listed, cells. Half and double give the same bits; less lists oftener, more looks at more samples.
constexpr float kSkin = 3;
constexpr uint32_t kNone = std::bit_cast<uint32_t>(-1.0f);

}  // namespace

EquilibriumContacts::EquilibriumContacts(Executor& executor, const EquilibriumRest& rest, const Similarity& placement,
                                         std::span<const Sdf* const> colliders, const EquilibriumSettings& settings, EquilibriumSums* sums,
                                         const EquilibriumSums& seen)
    : executor_(executor),
      rest_(rest),
      placement_(placement),
      colliders_(colliders),
      settings_(settings),
      sums_(sums),
      seen_(seen),
      force_on_h_(filled<Row4>(executor, on_host() ? rest.rows : 0)),
      now_(rest.samples.vertices + 1, executor.memory()),
      volume_gradient_(rest.samples.vertices + 1, executor.memory()),
      skin_(kSkin) {
  body_.travelled = &sums_->travelled;
  body_.result = &sums_->contact;
  body_.margin = static_cast<float>(settings.margin / rest_.to_local.scale);
  body_.stiffness = static_cast<float>(settings.contact * rest_.contact_scale);
  body_.law.gap = static_cast<float>(settings.contact_gap * rest_.diagonal);
  body_.friction = static_cast<float>(settings.friction);
  const Similarity to_world = placement * rest_.to_local;
  std::vector<ColliderView> views;
  for (size_t k = 0; k < colliders.size(); ++k) {
    check_margin(*colliders[k], placement, settings.margin, k);
    views.push_back(view_collider(*colliders[k], executor_.device(), to_world));
    const float band = colliders[k]->outside_band * views[k].scale;
    skin_ = std::min(skin_, band);
    body_.law.gap = std::min(body_.law.gap, std::max(0.0f, static_cast<float>(settings.constants.contact.most_of_band) * (band - body_.margin)));
  }
  body_.law.gentle = static_cast<float>(settings.constants.contact.gap_pressure * (1 + rest_.lame) /
                                        std::max(1e-20, static_cast<double>(body_.law.gap) * body_.stiffness));
  use_samples(rest_.samples, rest_.on.samples);
  if (const std::vector<uint8_t> steps = density_for(views); !steps.empty()) refine_samples(steps);
  met_ = MetColliders(executor_, *samples_, std::move(views));
  met_.meet(length(settings.entry) > 0 ? rest_.diagonal : skin_);  // A way in that is given is looked for as far as that.
  make_room();
}

void EquilibriumContacts::use_samples(const SampleTable& samples_now, const SamplesThere& there) {
  samples_ = &samples_now;
  samples_there_ = there;
  list_.clear();
  list_.reserve(samples());
  force_ = filled<Row4>(executor_, samples() + 1);
  slack_ = filled<float>(executor_, samples());
  body_.offsets = there.offsets;
  body_.indices = there.indices;
  body_.weights = there.weights;
  body_.rest = there.rest;
  body_.area = there.area;
  body_.slack = slack_.data_for_write();
  body_.force = force_.data_for_write();
  body_.samples = static_cast<uint32_t>(samples());
}

void EquilibriumContacts::make_room() {
  const size_t size = met_.count() * samples();
  grow(executor_, multiplier_, size);
  grow(executor_, normal_, size);
  grow(executor_, distance_, size, std::bit_cast<uint32_t>(ContactEnergy::kFar));
  body_.multiplier = multiplier_.data_for_write();
  body_.distance = distance_.data_for_write();
  body_.normal = normal_.data_for_write();
  if (settings_.friction > 0) {
    grow(executor_, stuck_, size);
    grow(executor_, began_, size, kNone);
    body_.stuck = stuck_.data_for_write();
    body_.began = began_.data_for_write();
  }
  if (body_.exits) {
    grow(executor_, exits_, size, kNone);
    body_.exits = exits_.data_for_write();
  }
  ways_.resize(met_.count(), Vec3d{0, 0, 0});
  body_.count = met_.count();
  body_.colliders = met_.published_views(executor_);
  body_.entry = met_.published_entries(executor_);
}

bool EquilibriumContacts::meet(double moved) {
  if (moved < met_.nearest_unmet() || !met_.meet(moved + static_cast<double>(skin_))) return false;
  make_room();
  return true;
}

void EquilibriumContacts::evaluate(const Row4* u, bool again) {
  body_.u = u;
  body_.known = again;
  reduce(executor_, on_host() ? list_.size() : samples(), body_);
  if (keeps_volume()) add_volume();
  if (on_host()) scatter_forces();
}

// Values in the executor's memory: on a device a transfer.
std::vector<float> EquilibriumContacts::read(const float* values, size_t n) const {
  std::vector<float> seen(n);
  if (on_host()) {
    std::copy_n(values, n, seen.data());
  } else {
    executor_.copy(values, executor_.device(), seen.data(), Device{}, n * sizeof(float));
    executor_.synchronise();
  }
  return seen;
}

// Few samples have a force: the forces go to H's vertices one after the other.
void EquilibriumContacts::scatter_forces() {
  Row4* to = force_on_h_.data_for_write();
  for (const uint32_t p : loaded_) to[p] = {0, 0, 0, 0};
  loaded_.clear();
  const SampleTable& s = *samples_;
  const Row4* force = force_.host().data();
  const uint32_t first = keeps_volume() ? s.vertices : 0;  // With the enclosed volume all of M's vertices have a force, which H's vertices gather.
  for (const uint32_t i : list_) {
    if (i < first || (force[i].x == 0 && force[i].y == 0 && force[i].z == 0)) continue;
    for (uint32_t e = s.offsets[i]; e < s.offsets[i + 1]; ++e) {
      const uint32_t p = s.indices[e];
      to[p] = to_row(to_vec(to[p]) + s.weights[e] * to_vec(force[i]));
      loaded_.push_back(p);
    }
  }
}

void EquilibriumContacts::list_samples(const Row4* u, float travelled) {
  body_.u = u;
  float* slack = slack_.data_for_write();
  parallel_for(executor_, samples(), ContactRoom{body_, slack, skin_, travelled});
  if (!on_host()) return;
  list_.clear();
  for (uint32_t s = 0; s < samples(); ++s)
    if (slack[s] < skin_) list_.push_back(s);
  body_.list = list_.data();
}

size_t EquilibriumContacts::enclosed() const {
  if (!rest_.surface.topology || rest_.surface.topology->triangles.empty()) return 0;
  Vec3f lower = samples_->rest[0], upper = lower;
  for (const Vec3f& y : samples_->rest) {
    lower = {std::min(lower.x, y.x), std::min(lower.y, y.y), std::min(lower.z, y.z)};
    upper = {std::max(upper.x, y.x), std::max(upper.y, y.y), std::max(upper.z, y.z)};
  }
  const std::vector<float> multipliers = read(body_.multiplier, body_.count * samples()), distances = this->distances();
  const auto touches = [&](uint32_t slot) {
    for (size_t i = slot * samples(); i < (slot + 1) * samples(); ++i)
      if (body_.law.at(multipliers[i] - distances[i]).force > 0) return true;
    return false;
  };
  Executor& host = on_host() ? executor_ : stand_in();
  size_t count = 0;
  for (size_t k = 0; k < colliders_.size(); ++k) {
    const uint32_t slot = met_.slot(k);
    const Vec3f c = slot == MetColliders::kUnmet ? met_.original(k).centre : met_.views[slot].centre;
    if (c.x < lower.x || c.y < lower.y || c.z < lower.z || c.x > upper.x || c.y > upper.y || c.z > upper.z) continue;  // most frames without contact
    if (slot != MetColliders::kUnmet && touches(slot)) continue;
    count += rest_.searchable(host).inside(rest_.to_local.apply(to_double(c)));
  }
  return count;
}

void EquilibriumContacts::set_pressures(std::span<const float> contacts, double volume) {
  const size_t n = samples(), given = rest_.samples.size();
  const bool fits = contacts.size() == colliders_.size() * given;
  bool is_new = false;
  if (fits)
    for (size_t k = 0; k < colliders_.size(); ++k) {
      const std::span<const float> of = contacts.subspan(k * given, given);
      if (std::any_of(of.begin(), of.end(), [](float p) { return p > 0; })) is_new = met_.take_in(k) || is_new;
    }
  if (is_new) make_room();
  std::vector<float> multipliers(body_.count * n, 0.0f);
  if (fits)
    for (uint32_t slot = 0; slot < met_.count(); ++slot)
      for (size_t i = 0; i < shared_samples(); ++i) multipliers[slot * n + i] = contacts[met_.collider(slot) * given + i] / body_.stiffness;
  const double volume_multiplier = volume / volume_stiffness();
  executor_.copy(multipliers.data(), Device{}, multiplier_.data_for_write(), executor_.device(), multipliers.size() * sizeof(float));
  executor_.copy(&volume_multiplier, Device{}, &sums_->volume.multiplier, executor_.device(), sizeof volume_multiplier);
  executor_.synchronise();
}

// A coarse H holds the surface by few of its samples, which others take over on a finer one. So each vertex of H shares what acts on it out among the samples
// near the collider, by area: the same force, as smooth as H is.
Buffer<float> EquilibriumContacts::pressures() const {
  const SampleTable& s = *samples_;
  const std::vector<float> multipliers = read(body_.multiplier, body_.count * samples()), distances = this->distances();
  const float nearby = static_cast<float>(settings_.constants.contact.nearby);
  Buffer<float> pressures(std::vector<float>(colliders_.size() * rest_.samples.size(), 0.0f));
  for (uint32_t k = 0; k < body_.count; ++k) {
    float* pressure = pressures.data_for_write() + met_.collider(k) * rest_.samples.size();
    std::vector<double> force(rest_.vertices, 0), area(rest_.vertices, 0);
    const float *lambda = multipliers.data() + k * s.size(), *phi = distances.data() + k * s.size();
    const auto is_near = [&](size_t i) { return lambda[i] > 0 || phi[i] < nearby; };
    const auto each_vertex = [&](size_t i, auto&& f) {
      for (uint32_t e = s.offsets[i]; e < s.offsets[i + 1]; ++e) f(s.indices[e], static_cast<double>(s.weights[e]));
    };
    for (size_t i = 0; i < s.size(); ++i) {
      if (!is_near(i)) continue;
      const double pressure_here = body_.stiffness * body_.law.at(lambda[i] - phi[i]).force;
      each_vertex(i, [&](uint32_t p, double w) { force[p] += w * s.area[i] * pressure_here, area[p] += w * s.area[i]; });
    }
    for (size_t i = 0; i < shared_samples(); ++i) {
      double sum = 0;
      if (is_near(i)) each_vertex(i, [&](uint32_t p, double w) { sum += area[p] > 0 ? w * force[p] / area[p] : 0; });
      pressure[i] = static_cast<float>(std::max(0.0, sum));
    }
  }
  return pressures;
}

UnsettledContact EquilibriumContacts::most_unsettled() const {
  const std::vector<float> multipliers = read(body_.multiplier, body_.count * samples()), distances = this->distances();
  UnsettledContact most;
  float largest = 0;
  for (size_t i = 0; i < multipliers.size(); ++i) {
    const float change = std::abs(body_.law.at(multipliers[i] - distances[i]).force - multipliers[i]);
    if (!(change > largest)) continue;
    largest = change;
    most = {met_.collider(i / samples()), rest_.to_local.apply(to_double(samples_->rest[i % samples()]))};
  }
  return most;
}

std::vector<Vec3d> EquilibriumContacts::forces_on_colliders() const {
  Buffer<Vec3d> sums(body_.count, executor_.memory());
  for (uint32_t k = 0; k < body_.count; ++k) reduce(executor_, samples(), ForceOnCollider{body_, sums.data_for_write() + k, k});
  std::vector<Vec3d> of_met(body_.count), forces(colliders_.size(), Vec3d{0, 0, 0});
  executor_.copy(sums.data_for_write(), executor_.device(), of_met.data(), Device{}, sums.bytes());
  executor_.synchronise();
  for (uint32_t slot = 0; slot < met_.count(); ++slot) forces[met_.collider(slot)] = of_met[slot];
  return forces;
}

void EquilibriumContacts::stick() {
  if (body_.friction > 0) parallel_for(executor_, body_.count * samples(), CopyRows{body_.normal, stuck_.data_for_write()});
}

void EquilibriumContacts::update_multipliers() {
  Row4* stuck = body_.friction > 0 ? stuck_.data_for_write() : nullptr;
  parallel_for(executor_, on_host() ? list_.size() : samples(),
               UpdateMultiplier{body_, multiplier_.data_for_write(), slack_.data_for_write(), stuck});
  parallel_for(executor_, 1, UpdateVolumeMultiplier{&sums_->volume});
}

void EquilibriumContacts::stiffen(float by) {
  body_.stiffness *= by;
  body_.law.gentle /= by;
  parallel_for(executor_, body_.count * samples(), ScaleFloats{multiplier_.data_for_write(), 1 / by});
}

void EquilibriumContacts::make_blocks(float* blocks) const {
  const SamplesThere& s = samples_there_;
  const float* free = rest_.on.free;
  if (!on_host())
    return executor_.launch(ContactBlocks{body_, s.transpose_offsets, s.transpose_samples, s.transpose_weights, free, blocks}, rest_.vertices);
  std::fill_n(blocks, kBlock * size_t{rest_.vertices}, 0.0f);
  for (const uint32_t i : list_)
    for (uint32_t e = s.offsets[i]; e < s.offsets[i + 1]; ++e)
      if (free[s.indices[e]] != 0) body_.add_block(i, s.weights[e], blocks + kBlock * size_t{s.indices[e]});
}

// The gradient of what M's enclosed volume costs goes to the samples' forces.
void EquilibriumContacts::add_volume() {
  const uint32_t n = samples_->vertices;
  Row4 *now = now_.data_for_write(), *gradient = volume_gradient_.data_for_write();
  parallel_for(executor_, n, VertexPositions{body_, now});
  reduce(executor_, n, VolumeGradient{now, rest_.on.link_offsets, rest_.on.link_edges, gradient, &sums_->volume});
  parallel_for(executor_, n, AddVolumeForce{gradient, &sums_->volume, body_.slack, body_.force, skin_});
}

double EquilibriumContacts::volume_stiffness() const {
  return settings_.constants.multiplier.volume_stiffness * (1 + rest_.lame);
}
double EquilibriumContacts::volume_compliance() const {
  return std::abs(seen_.volume.rest) / volume_stiffness();
}

void EquilibriumContacts::volume_gradient(Row4* to) const {
  const SamplesThere& s = samples_there_;
  parallel_for(executor_, rest_.vertices,
               VolumeGradientOfH{volume_gradient_.view(executor_.device()).data(), samples_->vertices, s.transpose_offsets, s.transpose_samples,
                                 s.transpose_weights, rest_.on.free, to});
}

}  // namespace knead
