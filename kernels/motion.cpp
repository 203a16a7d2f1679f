#include "kernels/motion.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>

namespace knead {

namespace {

constexpr double kRadians = std::numbers::pi / 180;

Quaternion unit(const Quaternion& q) {
  const double size = std::sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
  return {q.w / size, q.x / size, q.y / size, q.z / size};
}

double angle_between(const Quaternion& a, const Quaternion& b) {
  return 2 * std::acos(std::min(1.0, std::abs(a.w * b.w + a.x * b.x + a.y * b.y + a.z * b.z)));
}

// A monotone cubic through (frames, values) at `t` in segment s, flat at both ends.
double monotone(const std::vector<PoseKey>& keys, const std::function<double(size_t)>& value, size_t s, double t) {
  const auto slope = [&](size_t k) {  // of the curve at key k
    if (k == 0 || k + 1 == keys.size()) return 0.0;
    const double before = keys[k].frame - keys[k - 1].frame, after = keys[k + 1].frame - keys[k].frame;
    const double rise = (value(k) - value(k - 1)) / before, next = (value(k + 1) - value(k)) / after;
    if (rise * next <= 0) return 0.0;
    const double w0 = 2 * after + before, w1 = after + 2 * before;  // the weighted harmonic mean keeps it monotone
    return (w0 + w1) / (w0 / rise + w1 / next);
  };
  const double width = keys[s + 1].frame - keys[s].frame, from = value(s), to = value(s + 1);
  const double t2 = t * t, t3 = t2 * t;
  const double at = from + (to - from) * (3 * t2 - 2 * t3) + width * (slope(s) * (t3 - 2 * t2 + t) + slope(s + 1) * (t3 - t2));
  return std::clamp(at, std::min(from, to), std::max(from, to));
}

}  // namespace

Quaternion operator*(const Quaternion& a, const Quaternion& b) {
  return {a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z, a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y, a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
          a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w};
}

std::array<double, 9> Quaternion::matrix() const {
  if (w == 1) return {1, 0, 0, 0, 1, 0, 0, 0, 1};
  return {1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y), 2 * (x * y + w * z),    1 - 2 * (x * x + z * z),
          2 * (y * z - w * x),     2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)};
}

Quaternion rotation_about(const Vec3d& axis, double degrees) {
  const double size = length(axis);
  if (size == 0) return {};
  const double half = 0.5 * degrees * kRadians, s = std::sin(half) / size;
  return unit({std::cos(half), axis.x * s, axis.y * s, axis.z * s});
}

Quaternion rotation_xyz(const Vec3d& degrees) {
  return rotation_about({0, 0, 1}, degrees.z) * (rotation_about({0, 1, 0}, degrees.y) * rotation_about({1, 0, 0}, degrees.x));
}

Quaternion slerp(const Quaternion& a, const Quaternion& b, double t) {
  if (t <= 0) return a;
  if (t >= 1) return b;
  double cosine = a.w * b.w + a.x * b.x + a.y * b.y + a.z * b.z;
  const double sign = cosine < 0 ? -1 : 1;
  cosine = std::min(1.0, std::abs(cosine));
  const double angle = std::acos(cosine);
  const double near_a = angle < 1e-7 ? 1 - t : std::sin((1 - t) * angle) / std::sin(angle);
  const double near_b = sign * (angle < 1e-7 ? t : std::sin(t * angle) / std::sin(angle));
  return unit({near_a * a.w + near_b * b.w, near_a * a.x + near_b * b.x, near_a * a.y + near_b * b.y, near_a * a.z + near_b * b.z});
}

Pose pose_at(const std::vector<PoseKey>& keys, double frame, Interpolation interpolation) {
  if (keys.empty()) return {};
  if (frame <= keys.front().frame) return keys.front().pose;
  if (frame >= keys.back().frame) return keys.back().pose;
  size_t s = 0;
  while (keys[s + 1].frame <= frame) ++s;
  const Pose &from = keys[s].pose, &to = keys[s + 1].pose;
  const double t = (frame - keys[s].frame) / (keys[s + 1].frame - keys[s].frame);
  if (t == 0) return from;
  const auto between = [&](Vec3d Pose::*member) {
    Vec3d v;
    for (int k = 0; k < 3; ++k) {
      if (interpolation == Interpolation::kSmooth)
        v[k] = monotone(
            keys, [&](size_t i) { return (keys[i].pose.*member)[k]; }, s, t);
      else
        v[k] = (from.*member)[k] + t * ((to.*member)[k] - (from.*member)[k]);
    }
    return v;
  };
  double turn = t;
  if (interpolation == Interpolation::kSmooth) {
    std::vector<double> angles(keys.size(), 0);  // turned so far
    for (size_t k = 1; k < keys.size(); ++k) angles[k] = angles[k - 1] + angle_between(keys[k - 1].pose.rotate, keys[k].pose.rotate);
    const double all = angles[s + 1] - angles[s];
    if (all > 0)
      turn = (monotone(
                  keys, [&](size_t i) { return angles[i]; }, s, t) -
              angles[s]) /
             all;
  }
  return {between(&Pose::translate), slerp(from.rotate, to.rotate, turn), between(&Pose::scale), between(&Pose::pivot)};
}

Surface posed(const Surface& surface, const Pose& pose) {
  Surface result = surface;
  Similarity turn;
  turn.rotation = pose.rotate.matrix();
  const auto stretched = [&](const Vec3d& v) { return Vec3d{pose.scale.x * v.x, pose.scale.y * v.y, pose.scale.z * v.z}; };
  if (pose.uniform()) {
    turn.scale = pose.scale.x;
    turn.translation = pose.translate + pose.pivot - turn.scale * turn.rotate(pose.pivot);
    result.placement = turn * surface.placement;
    return result;
  }
  // With P the placement's rotation, R and S the pose's: R S P x = (R P)(P' S P) x, so the points take P' S P and the placement stays a similarity.
  Similarity old, back;
  old.rotation = surface.placement.rotation;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) back.rotation[3 * i + j] = old.rotation[3 * j + i];
  const auto baked = [&](const Vec3f& v) { return to_float(back.rotate(stretched(old.rotate(to_double(v))))); };
  const auto points = surface.points.host();
  Buffer<Vec3f> moved(points.size());
  Vec3f* out = moved.data_for_write();
  for (size_t i = 0; i < points.size(); ++i) out[i] = baked(points[i]);
  result.points = std::move(moved);

  result.placement = turn * old;
  result.placement.scale = surface.placement.scale;
  result.placement.translation = pose.translate + pose.pivot + turn.rotate(stretched(surface.placement.translation - pose.pivot));

  Vec3f lower{INFINITY, INFINITY, INFINITY}, upper{-INFINITY, -INFINITY, -INFINITY};
  for (int corner = 0; corner < 8; ++corner) {  // of the rest box, which may be another shape's than `points`
    const Vec3f p = baked({corner & 1 ? surface.upper.x : surface.lower.x, corner & 2 ? surface.upper.y : surface.lower.y,
                           corner & 4 ? surface.upper.z : surface.lower.z});
    for (int k = 0; k < 3; ++k) {
      lower[k] = std::min(lower[k], p[k]);
      upper[k] = std::max(upper[k], p[k]);
    }
  }
  result.lower = lower;
  result.upper = upper;
  if (surface.attributes && !surface.attributes->normals.empty()) {
    auto attributes = std::make_shared<MeshAttributes>(*surface.attributes);
    for (Vec3f& n : attributes->normals) {
      const Vec3d v = old.rotate(to_double(n));
      const Vec3d m = back.rotate({v.x / pose.scale.x, v.y / pose.scale.y, v.z / pose.scale.z});
      if (length(m) > 0) n = to_float(m * (1 / length(m)));
    }
    result.attributes = std::move(attributes);
  }
  return result;
}

}  // namespace knead
