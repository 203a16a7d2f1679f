#include <algorithm>
#include <cmath>

#include "io/picture/picture.h"

namespace knead {

static Vec3d corner(const Surface& rest, int i) {  // of the rest box, world space
  return rest.placement.apply({i & 1 ? rest.upper.x : rest.lower.x, i & 2 ? rest.upper.y : rest.lower.y, i & 4 ? rest.upper.z : rest.lower.z});
}

Box frame_box(const Surface& rest, const std::vector<const Surface*>& colliders) {
  Box box{{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
  for (int i = 0; i < 8; ++i) {
    const Vec3d p = corner(rest, i);
    for (int k = 0; k < 3; ++k) {
      box.lower[k] = std::min(box.lower[k], p[k]);
      box.upper[k] = std::max(box.upper[k], p[k]);
    }
  }
  const double diagonal = length(box.upper - box.lower);
  double room = 0.04 * diagonal;
  for (const Surface* collider : colliders) room = std::max(room, std::min(0.25 * collider->diagonal() * collider->placement.scale, 0.10 * diagonal));
  for (int k = 0; k < 3; ++k) {
    box.lower[k] -= room;
    box.upper[k] += room;
  }
  return box;
}

std::optional<Vec3d> view_direction(const std::string& name, const Vec3d& up) {
  const bool z_up = std::abs(up.z) > std::abs(up.y);
  const Vec3d front = z_up ? Vec3d{0, -1, 0} : Vec3d{0, 0, 1}, top = z_up ? Vec3d{0, 0, 1} : Vec3d{0, 1, 0}, right{1, 0, 0};
  if (name == "front") return front;
  if (name == "back") return -front;
  if (name == "right") return right;
  if (name == "left") return -right;
  if (name == "top") return top + 1e-3 * front;  // a hair's breadth off, so that `up` still says which way is up
  if (name == "bottom") return 1e-3 * front - top;
  if (name == "three_quarter") return front + 0.62 * right + 0.38 * top;
  return std::nullopt;
}

double lowest_height(const Surface& rest, const Vec3d& up) {
  double lowest = HUGE_VAL;
  for (int i = 0; i < 8; ++i) lowest = std::min(lowest, dot(up, corner(rest, i)) / length(up));
  return lowest;
}

void fit_range(PictureSettings& settings, std::span<const float> values, bool from_zero) {
  double low = HUGE_VAL, high = -HUGE_VAL;
  for (const float v : values) {
    if (!std::isfinite(v)) continue;
    low = std::min(low, static_cast<double>(v));
    high = std::max(high, static_cast<double>(v));
  }
  if (low > high) low = high = 0;
  if (settings.diverging) {
    high = std::max(std::abs(low), std::abs(high));
    low = -high;
  } else if (from_zero) {
    low = 0;
  }
  if (!(high > low)) high = low + (low == 0 ? 1e-6 : 1e-3 * std::abs(low));
  if (settings.diverging) low = -high;
  settings.range_low = low;
  settings.range_high = high;
}

}  // namespace knead
