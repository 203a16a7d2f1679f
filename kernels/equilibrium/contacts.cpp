#include "kernels/equilibrium/contacts.h"

#include <bit>
#include <cmath>

#include "graph/error.h"
#include "kernels/loop/approach.h"
#include "kernels/loop/collide.h"
#include "kernels/parallel.h"

namespace knead {
namespace {

constexpr float kSkin = 3;            // cells: samples as near as this to a collider are listed
constexpr double kBulk = 10;          // stiffness of the enclosed volume over the body's own; the memory does the rest
constexpr double kGapPressure = 0.5;  // up to which a contact keeps some of its gap, over the body's own stiffness
constexpr float kMostOfBand = 0.5f;   // of a field's outside band that the gap may take
constexpr size_t kFewSamples = ContactEnergy::kGrain;
constexpr double kDeep = 2.1;          // a way in that is so many times as long as the nearest way out of what is deepest is gone step by step
constexpr double kOfThickness = 0.25;  // of a collider's half thickness: how far it comes in at a time,
constexpr double kMostSteps = 100;     // but in no more steps than this on its account
constexpr float kNearby = 0.2f;        // cells: samples as near to a collider as this share a state's pushes
constexpr double kOneSide = 0.3;       // of their area: how far the samples inside a collider must agree on the way in

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
      force_(filled<Row4>(executor, rest.samples.size() + 1)),
      push_(filled<Row4>(executor, on_host() ? rest.rows : 0)),
      now_(rest.samples.vertices + 1, executor.memory()),
      volume_gradient_(rest.samples.vertices + 1, executor.memory()),
      memory_(filled<float>(executor, colliders.size() * rest.samples.size() + 1)),
      distance_(memory_.size(), executor.memory()),
      slack_(filled<float>(executor, rest.samples.size())),
      skin_(kSkin) {
  if (colliders.size() > kMostColliders)
    throw Error(ErrorCode::kInput,
                std::to_string(colliders.size()) + " colliders are more than the " + std::to_string(kMostColliders) + " that one solve takes",
                "join some of them with union_sdf");
  const RestTables& s = rest_.on;
  list_.reserve(samples());
  body_.offsets = s.offsets;
  body_.indices = s.indices;
  body_.weights = s.weights;
  body_.rest = s.sample_rest;
  body_.area = s.area;
  body_.slack = slack_.data_for_write();
  body_.memory = memory_.data_for_write();
  body_.travelled = &sums_->travelled;
  body_.result = &sums_->contact;
  body_.distance = distance_.data_for_write();
  body_.force = force_.data_for_write();
  body_.count = static_cast<uint32_t>(colliders.size());
  body_.samples = static_cast<uint32_t>(samples());
  body_.margin = static_cast<float>(settings.margin / rest_.to_local.scale);
  body_.stiffness = static_cast<float>(settings.contact * rest_.contact_scale);
  body_.gap = static_cast<float>(settings.gap * rest_.diagonal);
  body_.friction = static_cast<float>(settings.friction);
  normal_ = filled<Row4>(executor_, memory_.size());
  body_.normal = normal_.data_for_write();
  if (settings.friction > 0) {
    stuck_ = filled<Row4>(executor_, memory_.size());
    began_ = filled<float>(executor_, memory_.size(), std::bit_cast<uint32_t>(-1.0f));
    body_.stuck = stuck_.data_for_write();
    body_.began = began_.data_for_write();
  }
  const Similarity to_world = placement * rest_.to_local;
  for (size_t k = 0; k < colliders.size(); ++k) {
    check_margin(*colliders[k], placement, settings.margin, k);
    body_.colliders[k] = view_collider(*colliders[k], executor_.device(), to_world);
    const float band = colliders[k]->outside_band * body_.colliders[k].scale;
    skin_ = std::min(skin_, band);
    body_.gap = std::min(body_.gap, std::max(0.0f, kMostOfBand * (band - body_.margin)));
  }
  body_.gentle = static_cast<float>(kGapPressure * (1 + rest_.bulk) / std::max(1e-20, static_cast<double>(body_.gap) * body_.stiffness));
}

void EquilibriumContacts::evaluate(const Row4* u, bool again) {
  body_.u = u;
  body_.known = again;
  reduce(executor_, on_host() ? list_.size() : samples(), body_);
  if (keeps_volume()) add_volume();
  if (on_host()) spread();
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

// Few samples push: their forces go to H's vertices one after the other.
void EquilibriumContacts::spread() {
  Row4* push = push_.data_for_write();
  for (const uint32_t p : pushed_) push[p] = {0, 0, 0, 0};
  pushed_.clear();
  const SampleTable& s = rest_.samples;
  const Row4* force = force_.host().data();
  const uint32_t first = keeps_volume() ? s.vertices : 0;  // with the volume all vertices push
  for (const uint32_t i : list_) {
    if (i < first || (force[i].x == 0 && force[i].y == 0 && force[i].z == 0)) continue;
    for (uint32_t e = s.offsets[i]; e < s.offsets[i + 1]; ++e) {
      const uint32_t p = s.indices[e];
      push[p] = to_row(to_vec(push[p]) + s.weights[e] * to_vec(force[i]));
      pushed_.push_back(p);
    }
  }
}

void EquilibriumContacts::list_samples(const Row4* u, float travelled) {
  body_.u = u;
  float* slack = slack_.data_for_write();
  parallel_for(executor_, samples(), "contact_list", ContactRoom{body_, slack, skin_, travelled});
  if (!on_host()) return;
  list_.clear();
  for (uint32_t s = 0; s < samples(); ++s)
    if (slack[s] < skin_) list_.push_back(s);
  body_.list = list_.data();
}

// The mean of the rest normals of what is inside a collider, the deeper the weightier, turned inwards; zero when they do not agree.
Vec3d EquilibriumContacts::against_patch(const float* distance) const {
  const SampleTable& s = rest_.samples;
  Vec3d facing{0, 0, 0};
  double area = 0;
  for (size_t i = 0; i < s.size(); ++i)
    if (distance[i] < 0) {
      const Vec3d part = static_cast<double>(-distance[i]) * to_double(s.outward[i]);
      facing += part;
      area += length(part);
    }
  const double size = length(facing);
  return size > kOneSide * area && area > 0 ? (-1 / size) * facing : Vec3d{0, 0, 0};
}

bool EquilibriumContacts::find_entries(const Vec3d& given) {
  const SampleTable& s = rest_.samples;
  constexpr uint32_t kNone = std::bit_cast<uint32_t>(-1.0f);
  exits_ = filled<float>(executor_, body_.count * s.size(), kNone);
  const std::vector<float> distances = this->distances();
  std::vector<WayIn> ways(body_.count);
  undecided_ = 0;
  if (rest_.surface.topology) {
    Executor& host = on_host() ? executor_ : stand_in();
    std::vector<Sdf> fields;
    std::vector<const Sdf*> colliders(colliders_.begin(), colliders_.end());
    fields.reserve(colliders.size());
    for (size_t k = 0; k < colliders.size() && !on_host(); ++k) colliders[k] = &fields.emplace_back(settings_.on_host(k));
    CollideInput input;
    input.points = rest_.surface.points.host();
    input.placement = placement_;
    input.colliders = colliders;
    input.margin = settings_.margin;
    ways = ways_in(host, input, rest_.surface.topology->triangles, [&]() -> const MeshDistance& { return rest_.searchable(host); });
  }
  places_.assign(body_.colliders, body_.colliders + body_.count);
  ways_.assign(body_.count, Vec3d{0, 0, 0});
  bool any = false;
  for (uint32_t k = 0; k < body_.count; ++k) {
    float* exits = exits_.data_for_write() + k * s.size();
    const bool is_given = length(given) > 0;
    undecided_ += !is_given && ways[k].undecided;
    const float* distance = distances.data() + k * s.size();
    const double deepest = -rest_.to_local.scale * static_cast<double>(*std::min_element(distance, distance + s.size()));
    if (!is_given && ways[k].length > kDeep * deepest) {
      ways_[k] = (ways[k].length / rest_.to_local.scale) * rest_.to_local.inverse().rotate(ways[k].direction);
      find_beginnings(k, (1 / length(ways_[k])) * ways_[k]);
      continue;
    }
    const Vec3d entry = is_given ? (1 / length(given)) * (placement_ * rest_.to_local).inverse().rotate(given) : against_patch(distance);
    if (length(entry) == 0) continue;
    find_beginnings(k, entry);
    body_.entry[k] = to_float(entry);
    parallel_for(executor_, s.size(), "contact_exit", ContactExit{body_, k, is_given ? static_cast<float>(rest_.diagonal) : 0.0f, exits},
                 kFewSamples);
    any = true;
    if (!is_given) continue;
    const std::vector<float> gone = read(exits, s.size());
    ways_[k] = static_cast<double>(std::max(0.0f, *std::max_element(gone.begin(), gone.end()))) * entry;
    parallel_for(executor_, s.size(), "fill_words", FillWords{reinterpret_cast<uint32_t*>(exits), kNone});
  }
  body_.exits = any ? exits_.data_for_write() : nullptr;
  return any || longest_way() > 0;
}

void EquilibriumContacts::find_beginnings(uint32_t k, const Vec3d& entry) {
  if (began_.empty()) return;
  body_.entry[k] = to_float(entry);
  parallel_for(executor_, samples(), "contact_beginning", ContactExit{body_, k, 0, began_.data_for_write() + k * samples()}, kFewSamples);
}

size_t EquilibriumContacts::enclosed() const {
  if (!rest_.surface.topology || rest_.surface.topology->triangles.empty()) return 0;
  Vec3f lower = rest_.samples.rest[0], upper = lower;
  for (const Vec3f& y : rest_.samples.rest) {
    lower = {std::min(lower.x, y.x), std::min(lower.y, y.y), std::min(lower.z, y.z)};
    upper = {std::max(upper.x, y.x), std::max(upper.y, y.y), std::max(upper.z, y.z)};
  }
  const std::vector<float> memory = read(body_.memory, body_.count * samples()), distances = this->distances();
  Executor& host = on_host() ? executor_ : stand_in();
  size_t count = 0;
  for (size_t k = 0; k < colliders_.size(); ++k) {
    const auto pushes = [&](size_t i) { return body_.push_of(memory[i] - distances[i]).push > 0; };
    size_t i = k * samples();
    while (i < (k + 1) * samples() && !pushes(i)) ++i;
    if (i < (k + 1) * samples()) continue;
    const Vec3f c = body_.colliders[k].centre;
    if (c.x < lower.x || c.y < lower.y || c.z < lower.z || c.x > upper.x || c.y > upper.y || c.z > upper.z) continue;  // most frames without contact
    count += rest_.searchable(host).inside(rest_.to_local.apply(to_double(body_.colliders[k].centre)));
  }
  return count;
}

double EquilibriumContacts::longest_way() const {
  double longest = 0;
  for (const Vec3d& way : ways_) longest = std::max(longest, length(way));
  return longest;
}

// How far a collider may come in at a time, cells: else flesh gets past its middle, and stays on the wrong side with tets inside out.
double EquilibriumContacts::most_at_a_time(size_t k) const {
  return kOfThickness * static_cast<double>(colliders_[k]->inside_depth) * static_cast<double>(body_.colliders[k].scale);
}

double EquilibriumContacts::steps_in(double stride) const {
  double steps = 0;
  for (size_t k = 0; k < ways_.size(); ++k) {
    const double way = length(ways_[k]), most = most_at_a_time(k);
    steps = std::max({steps, way / stride, most > 0 ? std::min(way / most, kMostSteps) : 0});
  }
  return steps;
}

bool EquilibriumContacts::stand_free() const {
  const std::vector<float> distances = this->distances();
  for (size_t k = 0; k < ways_.size(); ++k) {
    const float* distance = distances.data() + k * samples();
    const double deepest = -static_cast<double>(*std::min_element(distance, distance + samples()));
    if (length(ways_[k]) > 0 && deepest > most_at_a_time(k)) return false;
  }
  return true;
}

void EquilibriumContacts::stand_back(double share) {
  for (size_t k = 0; k < ways_.size(); ++k) {
    const Vec3f shift = to_float(-share * ways_[k]);
    ColliderView& view = body_.colliders[k];
    view = places_[k];
    view.offset = CollidePush::to_index(view, -shift);
    view.centre += shift;
  }
}

void EquilibriumContacts::set_pressures(std::span<const float> contacts, double volume) {
  std::vector<float> memory(body_.count * samples(), 0.0f);
  if (contacts.size() == memory.size())
    std::transform(contacts.begin(), contacts.end(), memory.begin(), [&](float p) { return p / body_.stiffness; });
  const double volume_memory = volume / volume_stiffness();
  executor_.copy(memory.data(), Device{}, memory_.data_for_write(), executor_.device(), memory.size() * sizeof(float));
  executor_.copy(&volume_memory, Device{}, &sums_->volume.memory, executor_.device(), sizeof volume_memory);
  executor_.synchronise();
}

// A coarse H holds the surface by few of its samples, which others take over on a finer one. So each vertex of H shares what acts on it out among the samples
// near the collider, by area: the same force, as smooth as H is.
Buffer<float> EquilibriumContacts::pressures() const {
  const SampleTable& s = rest_.samples;
  const std::vector<float> memory = read(body_.memory, body_.count * samples()), distances = this->distances();
  Buffer<float> pressures(memory.size());
  float* pressure = pressures.data_for_write();
  for (uint32_t k = 0; k < body_.count; ++k) {
    std::vector<double> force(rest_.places, 0), area(rest_.places, 0);
    const float *lambda = memory.data() + k * s.size(), *phi = distances.data() + k * s.size();
    const auto is_near = [&](size_t i) { return lambda[i] > 0 || phi[i] < kNearby; };
    const auto each_place = [&](size_t i, auto&& f) {
      for (uint32_t e = s.offsets[i]; e < s.offsets[i + 1]; ++e) f(s.indices[e], static_cast<double>(s.weights[e]));
    };
    for (size_t i = 0; i < s.size(); ++i) {
      if (!is_near(i)) continue;
      const double push = body_.stiffness * body_.push_of(lambda[i] - phi[i]).push;
      each_place(i, [&](uint32_t p, double w) { force[p] += w * s.area[i] * push, area[p] += w * s.area[i]; });
    }
    for (size_t i = 0; i < s.size(); ++i) {
      double sum = 0;
      if (is_near(i)) each_place(i, [&](uint32_t p, double w) { sum += area[p] > 0 ? w * force[p] / area[p] : 0; });
      pressure[k * s.size() + i] = static_cast<float>(std::max(0.0, sum));
    }
  }
  return pressures;
}

void EquilibriumContacts::stick() {
  if (body_.friction > 0) parallel_for(executor_, body_.count * samples(), "copy_quads", CopyQuads{body_.normal, stuck_.data_for_write()});
}

void EquilibriumContacts::update_memory() {
  Row4* stuck = body_.friction > 0 ? stuck_.data_for_write() : nullptr;
  parallel_for(executor_, on_host() ? list_.size() : samples(), "contact_memory",
               ContactMemory{body_, memory_.data_for_write(), slack_.data_for_write(), stuck});
  parallel_for(executor_, 1, "remember_volume", RememberVolume{&sums_->volume});
}

void EquilibriumContacts::stiffen(float by) {
  body_.stiffness *= by;
  body_.gentle /= by;
  parallel_for(executor_, body_.count * samples(), "scale_floats", ScaleFloats{memory_.data_for_write(), 1 / by});
}

void EquilibriumContacts::make_blocks(float* blocks) const {
  const RestTables& s = rest_.on;
  if (!on_host()) return executor_.launch(ContactBlocks{body_, s.back_offsets, s.back_samples, s.back_weights, s.free, blocks}, rest_.places);
  std::fill_n(blocks, kBlock * size_t{rest_.places}, 0.0f);
  for (const uint32_t i : list_)
    for (uint32_t e = s.offsets[i]; e < s.offsets[i + 1]; ++e)
      if (s.free[s.indices[e]] != 0) body_.add_block(i, s.weights[e], blocks + kBlock * size_t{s.indices[e]});
}

// The gradient of what M's enclosed volume costs goes to the samples' forces.
void EquilibriumContacts::add_volume() {
  const uint32_t n = rest_.samples.vertices;
  Row4 *now = now_.data_for_write(), *gradient = volume_gradient_.data_for_write();
  parallel_for(executor_, n, "vertex_places", VertexPlaces{body_, now});
  reduce(executor_, n, VolumeGradient{now, rest_.on.fan_offsets, rest_.on.fans, gradient, &sums_->volume});
  parallel_for(executor_, n, "volume_push", VolumePush{gradient, &sums_->volume, body_.slack, body_.force, skin_});
}

double EquilibriumContacts::volume_stiffness() const {
  return kBulk * (1 + rest_.bulk);
}
double EquilibriumContacts::volume_compliance() const {
  return std::abs(seen_.volume.rest) / volume_stiffness();
}

void EquilibriumContacts::volume_gradient(Row4* by_place) const {
  const RestTables& s = rest_.on;
  parallel_for(executor_, rest_.places, "volume_by_place",
               VolumeByPlace{volume_gradient_.view(executor_.device()).data(), rest_.samples.vertices, s.back_offsets, s.back_samples, s.back_weights,
                             s.free, by_place});
}

}  // namespace knead
