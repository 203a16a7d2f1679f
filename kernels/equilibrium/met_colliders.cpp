#include "kernels/equilibrium/met_colliders.h"

#include <algorithm>
#include <cmath>

#include "kernels/parallel.h"

namespace knead {
namespace {

// A ball around the samples at rest, and how far a sample may go for one cell that H travels: more than a cell outside H.
struct Around {
  Vec3f centre{0, 0, 0};
  float radius = 0, reach = 1;
};

float reach_of(const SampleTable& samples, size_t s) {
  float reach = 1;
  for (uint32_t e = samples.offsets[s]; e < samples.offsets[s + 1]; ++e) reach += std::max(0.0f, -2 * samples.weights[e]);
  return reach;
}

Around around(const SampleTable& samples) {
  Around ball;
  if (samples.size() == 0) return ball;
  Vec3f lower = samples.rest[0], upper = lower;
  for (const Vec3f& y : samples.rest)
    for (int k = 0; k < 3; ++k) lower[k] = std::min(lower[k], y[k]), upper[k] = std::max(upper[k], y[k]);
  ball.centre = (lower + upper) * 0.5f;
  for (size_t s = 0; s < samples.size(); ++s) {
    ball.radius = std::max(ball.radius, length(samples.rest[s] - ball.centre));
    ball.reach = std::max(ball.reach, reach_of(samples, s));
  }
  return ball;
}

// From y to the box beyond which a collider's field is its background, cells.
float to_box(const ColliderView& view, const Vec3f& y) {
  const Vec3f p = view.to_index(y);
  Vec3f beyond{0, 0, 0};
  for (int k = 0; k < 3; ++k) beyond[k] = std::max({view.sdf.lower[k] - p[k], p[k] - view.sdf.upper[k], 0.0f});
  return length(beyond) * view.sdf.voxel * view.scale;
}

float away_from(const SampleTable& samples, const Around& ball, const ColliderView& view) {
  const float least = (to_box(view, ball.centre) - ball.radius) / ball.reach;
  if (least > ball.radius) return least;
  float away = std::numeric_limits<float>::infinity();
  for (size_t s = 0; s < samples.size() && away > 0; ++s) {
    const float to_sample = to_box(view, samples.rest[s]);
    if (to_sample < away) away = std::min(away, to_sample / reach_of(samples, s));
  }
  return away;
}

}  // namespace

MetColliders::MetColliders(Executor& executor, const SampleTable& samples, std::vector<ColliderView> views_of_all)
    : all_(std::move(views_of_all)), away_(all_.size()), slots_(all_.size(), kUnmet) {
  const Around ball = around(samples);
  Executor& host = executor.device() == Device{} ? executor : stand_in();
  parallel_for(
      host, all_.size(), "met_colliders", [&](uint32_t k) { away_[k] = away_from(samples, ball, all_[k]); }, 1);
  find_nearest_unmet();
}

bool MetColliders::meet(double travelled) {
  if (travelled < nearest_unmet_) return false;
  const uint32_t before = count();
  for (uint32_t k = 0; k < all_.size(); ++k)
    if (!(away_[k] > travelled)) take_in(k);
  return count() > before;
}

bool MetColliders::take_in(size_t collider) {
  if (slots_[collider] != kUnmet) return false;
  slots_[collider] = count();
  met_.push_back(static_cast<uint32_t>(collider));
  views.push_back(all_[collider]);
  entries.push_back({0, 0, 0});
  find_nearest_unmet();
  return true;
}

void MetColliders::find_nearest_unmet() {
  nearest_unmet_ = std::numeric_limits<double>::infinity();
  for (size_t k = 0; k < all_.size(); ++k)
    if (slots_[k] == kUnmet) nearest_unmet_ = std::min(nearest_unmet_, static_cast<double>(away_[k]));
}

namespace {

template <class T>
const T* published(Executor& executor, const std::vector<T>& values, Buffer<T>& there) {
  if (executor.device() == Device{}) return values.data();
  if (there.size() != values.size()) there = Buffer<T>(values.size(), executor.memory());
  T* const to = there.data_for_write();
  executor.copy(values.data(), Device{}, to, executor.device(), values.size() * sizeof(T));
  executor.synchronise();
  return to;
}

}  // namespace

const ColliderView* MetColliders::published_views(Executor& executor) {
  return published(executor, views, views_there_);
}
const Vec3f* MetColliders::published_entries(Executor& executor) {
  return published(executor, entries, entries_there_);
}

}  // namespace knead
