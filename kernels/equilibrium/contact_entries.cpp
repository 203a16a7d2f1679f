// Where colliders came in, and how they come to their places.
#include <algorithm>
#include <bit>
#include <cmath>

#include "kernels/equilibrium/contacts.h"
#include "kernels/parallel.h"

namespace knead {
namespace {

constexpr size_t kFewSamples = ContactEnergy::kGrain;
constexpr uint32_t kNone = std::bit_cast<uint32_t>(-1.0f);

}  // namespace

// The mean of the rest normals of what is inside a collider, weighted by depth, turned inwards; zero when they do not agree.
Vec3d EquilibriumContacts::against_patch(const float* distance) const {
  const SampleTable& s = *samples_;
  Vec3d facing{0, 0, 0};
  double area = 0;
  for (size_t i = 0; i < s.size(); ++i)
    if (distance[i] < 0) {
      const Vec3d part = static_cast<double>(-distance[i]) * to_double(s.outward[i]);
      facing += part;
      area += length(part);
    }
  const double size = length(facing);
  return size > settings_.constants.way_in.one_side * area && area > 0 ? (-1 / size) * facing : Vec3d{0, 0, 0};
}

std::vector<WayIn> EquilibriumContacts::ways_of_met() const {
  if (!rest_.surface.topology) return std::vector<WayIn>(met_.count());
  Executor& host = on_host() ? executor_ : stand_in();
  std::vector<Sdf> fields;
  std::vector<const Sdf*> colliders;
  fields.reserve(met_.count());
  for (uint32_t slot = 0; slot < met_.count(); ++slot) {
    const uint32_t k = met_.collider(slot);
    colliders.push_back(on_host() ? colliders_[k] : &fields.emplace_back(settings_.on_host(k)));
  }
  // Where samples are finer than M, a collider may have met nothing but samples.
  std::vector<Vec3f> points;
  std::span<const uint32_t> triangles = rest_.surface.topology->triangles;
  if (samples_ != &rest_.samples) {
    for (const Vec3f& y : samples_->rest) points.push_back(to_float(rest_.to_local.apply(to_double(y))));
    triangles = samples_->triangles;
  }
  CollideInput input;
  input.points = points.empty() ? rest_.surface.points.host() : std::span<const Vec3f>(points);
  input.placement = placement_;
  input.colliders = colliders;
  input.margin = settings_.margin;
  return ways_in(host, input, triangles, [&]() -> const MeshDistance& { return rest_.searchable(host); });
}

bool EquilibriumContacts::find_entries(const Vec3d& given) {
  exits_ = filled<float>(executor_, met_.count() * samples(), kNone);
  const std::vector<float> distances = this->distances();
  const std::vector<WayIn> ways = ways_of_met();
  ways_.assign(met_.count(), Vec3d{0, 0, 0});
  undecided_ = 0;
  bool any = false;
  for (uint32_t slot = 0; slot < met_.count(); ++slot) any = find_entry(slot, given, ways[slot], distances.data() + slot * samples()) || any;
  body_.entry = met_.published_entries(executor_);
  body_.exits = any ? exits_.data_for_write() : nullptr;
  return any || longest_way() > 0;
}

// Of one collider. Whether there is one; a collider that can stand back has none, but where it is given.
bool EquilibriumContacts::find_entry(uint32_t slot, const Vec3d& given, const WayIn& way, const float* distance) {
  float* exits = exits_.data_for_write() + slot * samples();
  const bool is_given = length(given) > 0;
  undecided_ += !is_given && way.undecided;
  const double deepest = -rest_.to_local.scale * static_cast<double>(*std::min_element(distance, distance + samples()));
  if (deepest > 0) thinnest_ = std::min(thinnest_, half_thickness(slot));
  if (!is_given && way.length > settings_.constants.way_in.deep * deepest) {
    ways_[slot] = (way.length / rest_.to_local.scale) * rest_.to_local.inverse().rotate(way.direction);
    find_beginnings(slot, (1 / length(ways_[slot])) * ways_[slot]);
    return false;
  }
  const Vec3d entry = is_given ? (1 / length(given)) * (placement_ * rest_.to_local).inverse().rotate(given) : against_patch(distance);
  if (length(entry) == 0) return false;
  find_beginnings(slot, entry);
  met_.entries[slot] = to_float(entry);
  parallel_for(executor_, samples(), ContactExit{body_, slot, to_float(entry), is_given ? static_cast<float>(rest_.diagonal) : 0.0f, exits},
               kFewSamples);
  if (!is_given) return true;
  const std::vector<float> gone = read(exits, samples());
  ways_[slot] = static_cast<double>(std::max(0.0f, *std::max_element(gone.begin(), gone.end()))) * entry;
  parallel_for(executor_, samples(), FillWords{reinterpret_cast<uint32_t*>(exits), kNone});
  return true;
}

void EquilibriumContacts::find_beginnings(uint32_t slot, const Vec3d& entry) {
  if (began_.empty()) return;
  met_.entries[slot] = to_float(entry);
  parallel_for(executor_, samples(), ContactExit{body_, slot, to_float(entry), 0, began_.data_for_write() + slot * samples()}, kFewSamples);
}

double EquilibriumContacts::longest_way() const {
  double longest = 0;
  for (const Vec3d& way : ways_) longest = std::max(longest, length(way));
  return longest;
}

// How far a collider may come in at a time, cells: else flesh gets past its middle, and stays on the wrong side with tets inside out.
double EquilibriumContacts::most_at_a_time(size_t slot) const {
  return settings_.constants.way_in.of_thickness * half_thickness(slot);
}

double EquilibriumContacts::half_thickness(size_t slot) const {
  return static_cast<double>(colliders_[met_.collider(slot)]->inside_depth) * static_cast<double>(met_.views[slot].scale);
}

bool EquilibriumContacts::slips(float deepest) const {
  const ContactConstants& c = settings_.constants.contact;
  return stiffer_for_thin_ < c.stiffest_for_thin &&
         thinnest_<c.thin * rest_.diagonal&& static_cast<double>(deepest)> settings_.constants.way_in.of_thickness * thinnest_;
}

void EquilibriumContacts::stiffen_for_thin() {
  stiffer_for_thin_ *= 2;
  stiffen(2);
}

double EquilibriumContacts::steps_in(double stride) const {
  double steps = 0;
  for (size_t k = 0; k < ways_.size(); ++k) {
    const double way = length(ways_[k]), most = most_at_a_time(k);
    steps = std::max({steps, way / stride, most > 0 ? std::min(way / most, settings_.constants.way_in.most_steps) : 0});
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
    ColliderView& view = met_.views[k];
    view = met_.original(met_.collider(k));
    view.offset = view.to_index(-shift);
    view.centre += shift;
  }
  body_.colliders = met_.published_views(executor_);
}

}  // namespace knead
