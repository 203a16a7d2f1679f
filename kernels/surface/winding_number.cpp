#include "kernels/surface/winding_number.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "kernels/surface/morton.h"

namespace knead {
namespace {

constexpr size_t kGroup = 8, kFan = 4;
constexpr double kFar = 2.5;  // a node is seen as one dipole from this many radii away

// Van Oosterom and Strackee 1983. On the triangle itself the sign is arbitrary and the size 2 pi.
double solid_angle(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& at) {
  const Vec3d u = a - at, v = b - at, w = c - at;
  const double lu = length(u), lv = length(v), lw = length(w);
  return 2 * std::atan2(dot(u, cross(v, w)), lu * lv * lw + dot(u, v) * lw + dot(v, w) * lu + dot(w, u) * lv);
}

void grow(Vec3d& lower, Vec3d& upper, const Vec3d& p) {
  for (int k = 0; k < 3; ++k) {
    lower[k] = std::min(lower[k], p[k]);
    upper[k] = std::max(upper[k], p[k]);
  }
}

}  // namespace

double winding_number_exact(std::span<const Vec3d> points, std::span<const uint32_t> triangles, const Vec3d& at) {
  double sum = 0;
  for (size_t t = 0; t + 2 < triangles.size(); t += 3)
    sum += solid_angle(points[triangles[t]], points[triangles[t + 1]], points[triangles[t + 2]], at);
  return sum / (4 * std::numbers::pi);
}

WindingNumber::WindingNumber(std::span<const Vec3d> points, std::span<const uint32_t> triangles, Executor& executor) {
  const size_t count = triangles.size() / 3;
  if (count == 0) return;
  Vec3d lower = points[triangles[0]], upper = lower;
  for (const uint32_t v : triangles) grow(lower, upper, points[v]);
  const double size = std::max({upper.x - lower.x, upper.y - lower.y, upper.z - lower.z, 1e-300});
  std::vector<std::pair<uint64_t, uint32_t>> order(count);
  executor.parallel_ranges(count, 8192, [&](size_t begin, size_t end) {
    for (size_t t = begin; t < end; ++t) {
      const Vec3d middle = (1.0 / 3) * (points[triangles[3 * t]] + points[triangles[3 * t + 1]] + points[triangles[3 * t + 2]]);
      order[t] = {morton_key((1 / size) * (middle - lower)), static_cast<uint32_t>(t)};
    }
  });
  std::sort(order.begin(), order.end());
  triangles_.resize(count);
  for (size_t t = 0; t < count; ++t) {
    const uint32_t* corner = &triangles[3 * size_t{order[t].second}];
    triangles_[t] = {points[corner[0]], points[corner[1]], points[corner[2]]};
  }

  levels_.emplace_back((count + kGroup - 1) / kGroup);
  executor.parallel_ranges(levels_[0].size(), 512, [&](size_t begin, size_t end) {
    for (size_t n = begin; n < end; ++n) add_triangles(levels_[0][n], n * kGroup, std::min(count, (n + 1) * kGroup));
  });
  while (levels_.back().size() > 1) {
    const std::vector<Node>& below = levels_.back();
    std::vector<Node> level((below.size() + kFan - 1) / kFan);
    for (size_t n = 0; n < level.size(); ++n) {
      Node& node = level[n];
      const std::span<const Node> children(&below[n * kFan], std::min(kFan, below.size() - n * kFan));
      node.lower = children[0].lower;
      node.upper = children[0].upper;
      for (const Node& child : children) {
        node.area += child.area;
        node.centre += child.area * child.centre;
        node.normal += child.normal;
        grow(node.lower, node.upper, child.lower);
        grow(node.lower, node.upper, child.upper);
      }
      node.centre = node.area > 0 ? (1 / node.area) * node.centre : 0.5 * (node.lower + node.upper);
      for (const Node& child : children)
        for (int k = 0; k < 3; ++k) node.moment[k] += child.moment[k] + child.normal[k] * (child.centre - node.centre);
      finish(node);
    }
    levels_.push_back(std::move(level));
  }
}

void WindingNumber::add_triangles(Node& node, size_t begin, size_t end) const {
  node.lower = node.upper = triangles_[begin].a;
  for (size_t t = begin; t < end; ++t) {
    const auto& [a, b, c] = triangles_[t];
    const Vec3d normal = 0.5 * cross(b - a, c - a);
    const double area = length(normal);
    node.area += area;
    node.centre += (area / 3) * (a + b + c);
    node.normal += normal;
    for (const Vec3d& p : {a, b, c}) grow(node.lower, node.upper, p);
  }
  node.centre = node.area > 0 ? (1 / node.area) * node.centre : 0.5 * (node.lower + node.upper);
  for (size_t t = begin; t < end; ++t) {
    const auto& [a, b, c] = triangles_[t];
    const Vec3d normal = 0.5 * cross(b - a, c - a);
    for (int k = 0; k < 3; ++k) node.moment[k] += normal[k] * ((1.0 / 3) * (a + b + c) - node.centre);
  }
  finish(node);
}

void WindingNumber::finish(Node& node) {
  Vec3d reach{0, 0, 0};
  for (int k = 0; k < 3; ++k) reach[k] = std::max(node.upper[k] - node.centre[k], node.centre[k] - node.lower[k]);
  node.radius = length(reach);
}

double WindingNumber::at(const Vec3d& query) const {
  if (levels_.empty()) return 0;
  struct Place {
    uint32_t level, node;
  };
  Place todo[128];  // at most kFan - 1 waiting per level
  int waiting = 0;
  todo[waiting++] = {static_cast<uint32_t>(levels_.size() - 1), 0};
  double sum = 0;
  while (waiting > 0) {
    const Place place = todo[--waiting];
    const Node& node = levels_[place.level][place.node];
    const Vec3d r = node.centre - query;
    const double r2 = dot(r, r);
    if (r2 > kFar * kFar * node.radius * node.radius) {
      const double inverse = 1 / std::sqrt(r2), inverse3 = inverse * inverse * inverse;
      const double trace = node.moment[0].x + node.moment[1].y + node.moment[2].z;
      const double twice = r.x * dot(node.moment[0], r) + r.y * dot(node.moment[1], r) + r.z * dot(node.moment[2], r);
      sum += (dot(node.normal, r) + trace - 3 * twice * inverse * inverse) * inverse3;
    } else if (place.level == 0) {
      for (size_t t = place.node * kGroup; t < std::min(triangles_.size(), (place.node + 1) * kGroup); ++t)
        sum += solid_angle(triangles_[t].a, triangles_[t].b, triangles_[t].c, query);
    } else {
      const std::vector<Node>& below = levels_[place.level - 1];
      for (size_t n = place.node * kFan; n < std::min(below.size(), (place.node + 1) * kFan); ++n)
        todo[waiting++] = {place.level - 1, static_cast<uint32_t>(n)};
    }
  }
  return sum / (4 * std::numbers::pi);
}

}  // namespace knead
