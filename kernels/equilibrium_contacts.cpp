#include "kernels/equilibrium_contacts.h"

#include <cmath>

#include "graph/error.h"
#include "kernels/approach.h"
#include "kernels/collide.h"
#include "kernels/parallel.h"

namespace knead {
namespace {

constexpr float kSkin = 3;          // cells: samples as near as this to a collider are listed
constexpr double kBulk = 10;        // stiffness of the enclosed volume over the body's own; the memory does the rest
constexpr double kGapPressure = 0.5;  // up to which a contact keeps some of its gap, over the body's own stiffness
constexpr float kMostOfBand = 0.5f;    // of a field's outside band that the gap may take
constexpr size_t kFewSamples = 64;  // per piece: a sample in contact costs a look at 27 voxels
constexpr double kDeep = 2.1;          // a way in that is so many times as long as the nearest way out of what is deepest is gone step by step
constexpr double kOneSide = 0.3;    // of their area: how far the samples inside a collider must agree on the way in

}  // namespace

EquilibriumContacts::EquilibriumContacts(Executor& executor, const EquilibriumRest& rest, const Similarity& placement,
                                         std::span<const Sdf* const> colliders, const EquilibriumSettings& settings)
    : executor_(executor),
      rest_(rest),
      placement_(placement),
      colliders_(colliders),
      margin_(settings.margin),
      force_(rest.samples.size() + 1),
      push_(rest.rows),
      now_(rest.samples.vertices + 1),
      volume_gradient_(rest.samples.vertices + 1),
      memory_(colliders.size() * rest.samples.size() + 1),
      distance_(memory_.size()),
      slack_(rest.samples.size(), 0.0f),
      skin_(kSkin) {
  if (colliders.size() > kMostColliders)
    throw Error(ErrorCode::kInput,
                std::to_string(colliders.size()) + " colliders are more than the " + std::to_string(kMostColliders) + " that one solve takes",
                "join some of them with union_sdf");
  const SampleTable& s = rest_.samples;
  list_.reserve(s.size());
  std::fill_n(memory_.data_for_write(), memory_.size(), 0.0f);
  std::fill_n(force_.data_for_write(), force_.size(), Row4{0, 0, 0, 0});
  std::fill_n(push_.data_for_write(), push_.size(), Row4{0, 0, 0, 0});
  body_.offsets = s.offsets.data();
  body_.indices = s.indices.data();
  body_.weights = s.weights.data();
  body_.rest = s.rest.data();
  body_.area = s.area.data();
  body_.slack = slack_.data();
  body_.memory = memory_.host().data();
  body_.distance = distance_.data_for_write();
  body_.force = force_.data_for_write();
  body_.count = static_cast<uint32_t>(colliders.size());
  body_.samples = static_cast<uint32_t>(s.size());
  body_.margin = static_cast<float>(settings.margin / rest_.to_local.scale);
  body_.stiffness = static_cast<float>(settings.contact * rest_.contact_scale);
  body_.gap = static_cast<float>(settings.gap * rest_.diagonal);
  body_.friction = static_cast<float>(settings.friction);
  if (settings.friction > 0) {
    normal_.assign(memory_.size(), Row4{0, 0, 0, 0});
    stuck_ = normal_;
    body_.normal = normal_.data();
    body_.stuck = stuck_.data();
    began_.assign(memory_.size(), -1.0f);
    body_.began = began_.data();
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

ContactSum EquilibriumContacts::evaluate(const Row4* u, float travelled) {
  body_.u = u;
  body_.travelled = travelled;
  ContactSum sum = parallel_reduce(
      executor_, list_.size(), "contact_energy", ContactSum{}, body_,
      [](const ContactSum& a, const ContactSum& b) {
        return ContactSum{a.energy + b.energy, std::max(a.deepest, b.deepest), std::max(a.change, b.change), a.active + b.active};
      },
      kFewSamples);
  if (keeps_volume()) sum.energy += add_volume();
  spread();
  return sum;
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

void EquilibriumContacts::list_samples(const Row4* u) {
  body_.u = u;
  parallel_for(executor_, samples(), "contact_list", [&](uint32_t s) { slack_[s] = body_.room(s, skin_); });
  list_.clear();
  Row4* force = force_.data_for_write();
  float* distance = distance_.data_for_write();
  for (uint32_t s = 0; s < samples(); ++s) {
    if (slack_[s] < skin_) {
      list_.push_back(s);
      continue;
    }
    force[s] = {0, 0, 0, 0};
    for (size_t k = 0; k < body_.count; ++k) distance[k * samples() + s] = ContactEnergy::kFar;
  }
  body_.list = list_.data();
}

// The mean of the rest normals of what is inside collider k, the deeper the weightier, turned inwards; zero when they do not agree.
Vec3d EquilibriumContacts::against_patch(size_t k) const {
  const SampleTable& s = rest_.samples;
  const float* distance = distance_.host().data() + k * s.size();
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
  exits_.assign(body_.count * s.size(), -1.0f);
  std::vector<WayIn> ways(body_.count);
  if (rest_.surface.topology) {
    CollideInput input;
    input.points = rest_.surface.points.host();
    input.placement = placement_;
    input.colliders = colliders_;
    input.margin = margin_;
    ways = ways_in(executor_, input, rest_.surface.topology->triangles, [&]() -> const MeshDistance& { return rest_.searchable(executor_); });
  }
  places_.assign(body_.colliders, body_.colliders + body_.count);
  ways_.assign(body_.count, Vec3d{0, 0, 0});
  bool any = false;
  for (uint32_t k = 0; k < body_.count; ++k) {
    float* exits = exits_.data() + k * s.size();
    const bool is_given = length(given) > 0;
    undecided_ += !is_given && ways[k].undecided;
    const float* distance = distance_.host().data() + k * s.size();
    const double deepest = -rest_.to_local.scale * static_cast<double>(*std::min_element(distance, distance + s.size()));
    if (!is_given && ways[k].length > kDeep * deepest) {
      ways_[k] = (ways[k].length / rest_.to_local.scale) * rest_.to_local.inverse().rotate(ways[k].direction);
      find_beginnings(k, (1 / length(ways_[k])) * ways_[k]);
      continue;
    }
    const Vec3d entry = is_given ? (1 / length(given)) * (placement_ * rest_.to_local).inverse().rotate(given) : against_patch(k);
    if (length(entry) == 0) continue;
    find_beginnings(k, entry);
    body_.entry[k] = to_float(entry);
    parallel_for(executor_, s.size(), "contact_exit", ContactExit{body_, k, is_given ? static_cast<float>(rest_.diagonal) : 0.0f, exits}, kFewSamples);
    any = true;
    if (!is_given) continue;
    ways_[k] = static_cast<double>(std::max(0.0f, *std::max_element(exits, exits + s.size()))) * entry;
    std::fill_n(exits, s.size(), -1.0f);
  }
  body_.exits = any ? exits_.data() : nullptr;
  return any || longest_way() > 0;
}

void EquilibriumContacts::find_beginnings(uint32_t k, const Vec3d& entry) {
  if (began_.empty()) return;
  body_.entry[k] = to_float(entry);
  parallel_for(executor_, samples(), "contact_beginning", ContactExit{body_, k, 0, began_.data() + k * samples()}, kFewSamples);
}

size_t EquilibriumContacts::enclosed() const {
  if (!rest_.surface.topology || rest_.surface.topology->triangles.empty()) return 0;
  Vec3f lower = rest_.samples.rest[0], upper = lower;
  for (const Vec3f& y : rest_.samples.rest) {
    lower = {std::min(lower.x, y.x), std::min(lower.y, y.y), std::min(lower.z, y.z)};
    upper = {std::max(upper.x, y.x), std::max(upper.y, y.y), std::max(upper.z, y.z)};
  }
  size_t count = 0;
  for (size_t k = 0; k < colliders_.size(); ++k) {
    const float* distance = distance_.host().data() + k * samples();
    if (std::any_of(distance, distance + samples(), [](float phi) { return phi < 0; })) continue;
    const Vec3f c = body_.colliders[k].centre;
    if (c.x < lower.x || c.y < lower.y || c.z < lower.z || c.x > upper.x || c.y > upper.y || c.z > upper.z) continue;  // most frames without contact
    count += rest_.searchable(executor_).inside(rest_.to_local.apply(to_double(body_.colliders[k].centre)));
  }
  return count;
}

double EquilibriumContacts::longest_way() const {
  double longest = 0;
  for (const Vec3d& way : ways_) longest = std::max(longest, length(way));
  return longest;
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

void EquilibriumContacts::update_memory() {
  float* memory = memory_.data_for_write();
  const float* distance = distance_.host().data();
  for (size_t i = 0; i < body_.count * samples(); ++i) {
    memory[i] = body_.push_of(memory[i] - distance[i]).push;
    if (memory[i] > 0) slack_[i % samples()] = 0;
  }
  std::copy_n(normal_.data(), normal_.size(), stuck_.data());
  volume_memory_ += volume_error_;
}

void EquilibriumContacts::stiffen(float by) {
  body_.stiffness *= by;
  body_.gentle /= by;
  float* memory = memory_.data_for_write();
  for (size_t i = 0; i < body_.count * samples(); ++i) memory[i] /= by;
}

void EquilibriumContacts::add_to(std::span<float> diagonal, float share) const {
  const SampleTable& s = rest_.samples;
  const float *memory = memory_.host().data(), *distance = distance_.host().data();
  for (size_t k = 0; k < body_.count; ++k)
    for (const uint32_t i : list_) {
      const float slope = body_.push_of(memory[k * s.size() + i] - distance[k * s.size() + i]).slope;
      if (!(slope > 0)) continue;
      const float weight = share * slope * body_.stiffness * s.area[i];
      for (uint32_t e = s.offsets[i]; e < s.offsets[i + 1]; ++e)
        if (rest_.free[s.indices[e]] != 0) diagonal[s.indices[e]] += weight * s.weights[e];
    }
}

// kb/2 V0 (V/V0 - 1 + memory)^2 for M as a whole: its gradient goes to the samples' forces.
double EquilibriumContacts::add_volume() {
  const uint32_t n = rest_.samples.vertices;
  parallel_for(executor_, n, "vertex_places", VertexPlaces{body_, now_.data_for_write()});
  const VolumeGradient body{now_.data_for_write(), rest_.fan_offsets.data(), rest_.fans.data(), volume_gradient_.data_for_write()};
  const double volume = reduce_sum(executor_, n, "enclosed_volume", body);
  if (rest_volume_ == 0) rest_volume_ = volume;  // the first call is at rest
  if (rest_volume_ == 0) rest_volume_ = 1e-30;
  const double stiffness = std::abs(rest_volume_) / volume_compliance();
  volume_error_ = volume / rest_volume_ - 1;
  const double error = volume_error_ + volume_memory_;
  const float push = static_cast<float>(stiffness * error * (rest_volume_ < 0 ? -1 : 1));
  parallel_for(executor_, n, "volume_push", VolumePush{volume_gradient_.host().data(), push, slack_.data(), skin_, force_.data_for_write()});
  return 0.5 * stiffness * std::abs(rest_volume_) * error * error;
}

double EquilibriumContacts::volume_compliance() const {
  return std::abs(rest_volume_) / (kBulk * (1 + rest_.bulk));
}

void EquilibriumContacts::volume_gradient(Row4* by_place) const {
  const SampleTable& s = rest_.samples;
  const Row4* gradient = volume_gradient_.host().data();
  for (uint32_t p = 0; p < rest_.places; ++p) {
    Vec3f sum{0, 0, 0};
    for (uint32_t e = s.back_offsets[p]; e < s.back_offsets[p + 1]; ++e) sum += s.back_weights[e] * to_vec(gradient[s.back_samples[e]]);
    by_place[p] = to_row(rest_.free[p] * sum);
  }
}

}  // namespace knead
