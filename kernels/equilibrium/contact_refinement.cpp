// More samples, where M is coarser than what it meets.
#include <algorithm>
#include <bit>
#include <cmath>

#include "kernels/equilibrium/contacts.h"
#include "kernels/equilibrium/sample_density.h"
#include "kernels/loop/collide.h"
#include "kernels/parallel.h"

namespace knead {
namespace {

constexpr uint32_t kUnknown = std::bit_cast<uint32_t>(-1.0f);

AddFloats copy_of(const float* from, float* to) {
  return {from, nullptr, to};
}
CopyRows copy_of(const Row4* from, Row4* to) {
  return {from, to};
}

// The values of M's vertices for every collider, in a buffer with room for other samples.
template <class T>
void carry(Executor& executor, Buffer<T>& values, size_t colliders, size_t vertices, size_t before, size_t now, uint32_t word) {
  if (values.empty()) return;
  Buffer<T> carried = filled<T>(executor, colliders * now, word);
  for (size_t k = 0; k < colliders; ++k)
    parallel_for(executor, vertices, copy_of(values.view(executor.device()).data() + k * before, carried.data_for_write() + k * now));
  values = std::move(carried);
}

}  // namespace

void EquilibriumContacts::refine_samples(const std::vector<uint8_t>& steps) {
  const size_t before = samples(), colliders = met_.count();
  steps_ = steps;
  finer_ = refined_samples(rest_.samples, rest_.surface.topology->triangles, steps, rest_.vertices, !on_host());
  finer_there_ = DeviceTables();
  use_samples(finer_, put_samples(executor_, finer_, finer_there_));
  const size_t vertices = finer_.vertices, now = samples();
  carry(executor_, multiplier_, colliders, vertices, before, now, 0);
  carry(executor_, normal_, colliders, vertices, before, now, 0);
  carry(executor_, distance_, colliders, vertices, before, now, std::bit_cast<uint32_t>(ContactEnergy::kFar));
  carry(executor_, stuck_, colliders, vertices, before, now, 0);
  carry(executor_, began_, colliders, vertices, before, now, kUnknown);
  if (colliders > 0) make_room();
}

std::vector<ColliderSize> EquilibriumContacts::sizes(const std::vector<ColliderView>& views, std::vector<Sdf>& fields) const {
  std::vector<ColliderSize> found;
  fields.reserve(views.size());
  for (size_t k = 0; k < views.size(); ++k) {
    const double half_thickness = static_cast<double>(colliders_[k]->inside_depth) * static_cast<double>(views[k].scale);
    found.push_back({views[k], half_thickness});
    if (!on_host()) found.back().view = view_collider(fields.emplace_back(settings_.on_host(k)), Device{}, placement_ * rest_.to_local);
  }
  return found;
}

std::vector<uint8_t> EquilibriumContacts::density_for(const std::vector<ColliderView>& views) const {
  if (!rest_.surface.topology) return {};
  const auto is_thin = [&](size_t k) {
    const double half_thickness = static_cast<double>(colliders_[k]->inside_depth) * static_cast<double>(views[k].scale);
    return half_thickness > 0 && asks_for_samples(rest_.samples.longest_side, half_thickness);
  };
  bool any = false;
  for (size_t k = 0; k < views.size(); ++k) any = any || is_thin(k);
  if (!any) return {};
  std::vector<Sdf> fields;
  std::vector<ColliderSize> thin = sizes(views, fields);
  const Vec3d given = settings_.entry;
  const Vec3f entry = length(given) > 0 ? to_float((1 / length(given)) * (placement_ * rest_.to_local).inverse().rotate(given)) : Vec3f{0, 0, 0};
  return sample_density(on_host() ? executor_ : stand_in(), rest_.samples, rest_.surface.topology->triangles, thin, entry, rest_.diagonal,
                        rest_.samples.steps);
}

bool EquilibriumContacts::refine_where_pierced(const Row4* u, double tolerance) {
  if (!rest_.surface.topology || samples_->vertices == 0) return false;
  std::vector<Row4> here(rest_.vertices);
  executor_.copy(u, executor_.device(), here.data(), Device{}, here.size() * sizeof(Row4));
  executor_.synchronise();
  const SampleTable& s = *samples_;
  std::vector<Vec3f> now(s.vertices);
  for (uint32_t v = 0; v < s.vertices; ++v) {
    Vec3f move{0, 0, 0};
    for (uint32_t e = s.offsets[v]; e < s.offsets[v + 1]; ++e) move += s.weights[e] * to_vec(here[s.indices[e]]);
    now[v] = s.rest[v] + move;
  }
  std::vector<Sdf> fields;
  std::vector<ColliderView> views;
  for (size_t k = 0; k < colliders_.size(); ++k) views.push_back(met_.original(k));
  const std::vector<uint8_t> steps =
      denser_where_pierced(on_host() ? executor_ : stand_in(), now, rest_.surface.topology->triangles, sizes(views, fields), body_.margin,
                           static_cast<float>(tolerance), steps_, rest_.samples.steps);
  if (steps.empty()) return false;
  refine_samples(steps);
  return true;
}

}  // namespace knead
