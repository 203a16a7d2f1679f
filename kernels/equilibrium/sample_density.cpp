#include "kernels/equilibrium/sample_density.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "kernels/parallel.h"

namespace knead {
namespace {

// The longest distance of two samples of M at rest over a collider's half thickness. A pin of radius 0.03 that is pressed 0.2 into a block with edges of 0.07
// comes to rest after 141 iterations at 0.5, after 109 at 1.1, without a face inside it; at 2 faces are left 0.004 deep. A ring around a cap of a ball
// (EquilibriumRobust.ThinCollidersKeepTheFleshOnItsSide) takes over 300 at 0.5, 85 at 1.1.
constexpr double kSpacing = 1.1;
// How far from a collider M's triangles may be pulled along into it, in half thicknesses.
constexpr double kPulled = 4;
constexpr int kMostMarches = 200;
constexpr int kLookSteps = 4;       // of the grid in which a face is looked at
constexpr uint8_t kTimesFiner = 4;  // where a face is pierced

// The least distance to the collider on the way from y along `entry`, up to `reach`; stops where it is below `enough`.
float least_on_way(const ColliderView& view, Vec3f y, const Vec3f& entry, double reach, float enough) {
  SdfSampler sampler(view.sdf);
  float least = sampler.least(view.to_index(y)) * view.scale;
  float gone = 0;
  for (int march = 0; march < kMostMarches && least > enough && gone < static_cast<float>(reach); ++march) {
    const float along = std::max(sampler.least(view.to_index(y)) * view.scale, 0.5f * enough);
    gone += along;
    y += along * entry;
    least = std::min(least, sampler.least(view.to_index(y)) * view.scale);
  }
  return least;
}

}  // namespace

std::vector<uint8_t> sample_density(Executor& host, const SampleTable& samples, std::span<const uint32_t> triangles,
                                    std::span<const ColliderSize> colliders, const Vec3f& entry, double reach, int least) {
  const size_t count = triangles.size() / 3;
  std::vector<uint8_t> steps(count, static_cast<uint8_t>(std::clamp(least, 1, kMostSteps)));
  const bool on_a_way = length(entry) > 0;
  std::vector<uint8_t> is_finer(count, 0);
  parallel_for(host, count, "sample_density", [&](uint32_t t) {
    const Vec3f a = samples.rest[triangles[3 * size_t{t}]], b = samples.rest[triangles[3 * size_t{t} + 1]],
                c = samples.rest[triangles[3 * size_t{t} + 2]];
    const double longest = static_cast<double>(std::max({length(b - a), length(c - b), length(a - c)}));
    for (const ColliderSize& collider : colliders) {
      const double wanted = longest / (kSpacing * collider.half_thickness);
      if (!(wanted > steps[t])) continue;
      const auto enough = static_cast<float>(kPulled * collider.half_thickness + longest);
      const Vec3f middle = (1.0f / 3) * (a + b + c);
      if (least_on_way(collider.view, middle, entry, on_a_way ? reach : 0, enough) > enough) continue;
      steps[t] =
          static_cast<uint8_t>(std::min<uint32_t>(kMostSteps, std::bit_ceil(static_cast<uint32_t>(std::ceil(std::min(wanted, double{kMostSteps}))))));
      is_finer[t] = 1;
    }
  });
  return std::any_of(is_finer.begin(), is_finer.end(), [](uint8_t f) { return f != 0; }) ? steps : std::vector<uint8_t>();
}

bool asks_for_samples(double longest_side, double half_thickness) {
  return longest_side > kSpacing * half_thickness;
}

std::vector<uint8_t> denser_where_pierced(Executor& host, std::span<const Vec3f> now, std::span<const uint32_t> triangles,
                                          std::span<const ColliderSize> colliders, float margin, float tolerance, const std::vector<uint8_t>& steps,
                                          int least) {
  const size_t count = triangles.size() / 3;
  std::vector<uint8_t> denser = steps.empty() ? std::vector<uint8_t>(count, static_cast<uint8_t>(std::clamp(least, 1, kMostSteps))) : steps;
  std::vector<uint8_t> is_pierced(count, 0), touched(now.size(), 0);
  parallel_for(host, count, "pierced_faces", [&](uint32_t t) {
    const Vec3f a = now[triangles[3 * size_t{t}]], b = now[triangles[3 * size_t{t} + 1]], c = now[triangles[3 * size_t{t} + 2]];
    const Vec3f middle = (1.0f / 3) * (a + b + c);
    const float radius = std::max({length(a - middle), length(b - middle), length(c - middle)});
    for (const ColliderSize& collider : colliders) {
      const ColliderView& view = collider.view;
      SdfSampler sampler(view.sdf);
      if (sampler.least(view.to_index(middle)) * view.scale - margin > radius) continue;
      for (int i = 0; i <= kLookSteps; ++i)
        for (int j = 0; i + j <= kLookSteps; ++j) {
          const float u = static_cast<float>(i) / kLookSteps, v = static_cast<float>(j) / kLookSteps;
          const Vec3f at = u * a + v * b + (1 - u - v) * c;
          if (sampler.value(view.to_index(at)) * view.scale - margin < -tolerance) is_pierced[t] = 1;
        }
    }
  });
  for (size_t t = 0; t < count; ++t)
    for (size_t k = 0; is_pierced[t] && k < 3; ++k) touched[triangles[3 * t + k]] = 1;
  bool any = false;
  for (size_t t = 0; t < count; ++t) {
    if (!touched[triangles[3 * t]] && !touched[triangles[3 * t + 1]] && !touched[triangles[3 * t + 2]]) continue;
    const auto finer = static_cast<uint8_t>(std::min<int>(kMostSteps, kTimesFiner * denser[t]));
    any = any || finer > denser[t];
    denser[t] = finer;
  }
  return any ? denser : std::vector<uint8_t>();
}

}  // namespace knead
