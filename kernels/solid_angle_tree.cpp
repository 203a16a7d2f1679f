#include "kernels/solid_angle_tree.h"

#include <algorithm>
#include <array>
#include <numbers>
#include <numeric>

namespace knead {
namespace {

constexpr uint32_t kLeafTriangles = 4;
constexpr double kFarFactor = 2;  // a node further away than this many radii acts through its moments

}  // namespace

double solid_angle(const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  // Van Oosterom and Strackee 1983.
  const double la = length(a), lb = length(b), lc = length(c);
  const double volume = dot(a, cross(b, c));
  const double spread = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb;
  return volume == 0 ? 0.0 : 2 * std::atan2(volume, spread);
}

SolidAngleTree::SolidAngleTree(std::span<const Vec3d> points, std::span<const uint32_t> triangles) {
  const uint32_t count = static_cast<uint32_t>(triangles.size() / 3);
  if (count == 0) return;
  std::vector<Vec3d> centroids(count), unsorted(triangles.size());
  for (size_t k = 0; k < triangles.size(); ++k) unsorted[k] = points[triangles[k]];
  for (uint32_t t = 0; t < count; ++t) centroids[t] = (unsorted[3 * t] + unsorted[3 * t + 1] + unsorted[3 * t + 2]) * (1.0 / 3);
  order_.resize(count);
  std::iota(order_.begin(), order_.end(), 0u);
  nodes_.reserve(count / 2 + 1);
  corners_ = std::move(unsorted);  // build() reads it in mesh order
  build(0, count, centroids);
  std::vector<Vec3d> sorted(corners_.size());
  for (uint32_t k = 0; k < count; ++k)
    for (int c = 0; c < 3; ++c) sorted[3 * k + c] = corners_[3 * order_[k] + c];
  corners_ = std::move(sorted);
  order_ = {};
}

uint32_t SolidAngleTree::build(uint32_t first, uint32_t count, const std::vector<Vec3d>& centroids) {
  const uint32_t self = static_cast<uint32_t>(nodes_.size());
  nodes_.emplace_back();
  Node node{};
  node.first = first;
  node.count = count;
  Vec3d lower = centroids[order_[first]], upper = lower, plain{0, 0, 0}, weighted{0, 0, 0};
  double area = 0;
  for (uint32_t k = first; k < first + count; ++k) {
    const uint32_t t = order_[k];
    const Vec3d half = cross(corners_[3 * t + 1] - corners_[3 * t], corners_[3 * t + 2] - corners_[3 * t]) * 0.5;
    const double size = length(half);
    node.dipole += half;
    area += size;
    weighted += size * centroids[t];
    plain += centroids[t];
    for (int k3 = 0; k3 < 3; ++k3) {
      lower[k3] = std::min(lower[k3], centroids[t][k3]);
      upper[k3] = std::max(upper[k3], centroids[t][k3]);
    }
  }
  node.centre = area > 0 ? weighted * (1 / area) : plain * (1.0 / count);
  for (uint32_t k = first; k < first + count; ++k) {
    const uint32_t t = order_[k];
    const Vec3d half = cross(corners_[3 * t + 1] - corners_[3 * t], corners_[3 * t + 2] - corners_[3 * t]) * 0.5;
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) node.moment[3 * i + j] += half[i] * (centroids[t] - node.centre)[j];
  }
  for (uint32_t k = first; k < first + count; ++k)
    for (int c = 0; c < 3; ++c) node.radius = std::max(node.radius, length(corners_[3 * order_[k] + c] - node.centre));
  if (count > kLeafTriangles) {
    const Vec3d extent = upper - lower;
    const int axis = extent.x >= extent.y && extent.x >= extent.z ? 0 : extent.y >= extent.z ? 1 : 2;
    const uint32_t half = count / 2;
    std::nth_element(order_.begin() + first, order_.begin() + first + half, order_.begin() + first + count, [&](uint32_t a, uint32_t b) {
      return centroids[a][axis] != centroids[b][axis] ? centroids[a][axis] < centroids[b][axis] : a < b;
    });
    node.count = 0;
    build(first, half, centroids);
    node.second = build(first + half, count - half, centroids);
  }
  nodes_[self] = node;
  return self;
}

double SolidAngleTree::winding_number(const Vec3d& p) const {
  if (nodes_.empty()) return 0;
  double sum = 0;
  std::array<uint32_t, 64> stack;  // the tree halves its triangles: 32 levels at most
  int top = 0;
  stack[top++] = 0;
  while (top > 0) {
    const uint32_t index = stack[--top];
    const Node& node = nodes_[index];
    const Vec3d towards = node.centre - p;
    const double squared = dot(towards, towards);
    if (squared > kFarFactor * kFarFactor * node.radius * node.radius) {
      const double inverse = 1 / std::sqrt(squared), cubed = inverse * inverse * inverse;
      const double* m = node.moment;
      const Vec3d along{m[0] * towards.x + m[1] * towards.y + m[2] * towards.z, m[3] * towards.x + m[4] * towards.y + m[5] * towards.z,
                        m[6] * towards.x + m[7] * towards.y + m[8] * towards.z};
      sum += (dot(node.dipole, towards) + m[0] + m[4] + m[8] - 3 * dot(along, towards) * inverse * inverse) * cubed;
    } else if (node.second == 0) {
      for (uint32_t k = node.first; k < node.first + node.count; ++k)
        sum += solid_angle(corners_[3 * k] - p, corners_[3 * k + 1] - p, corners_[3 * k + 2] - p);
    } else {
      stack[top++] = node.second;
      stack[top++] = index + 1;
    }
  }
  return sum / (4 * std::numbers::pi);
}

}  // namespace knead
