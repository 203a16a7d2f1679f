#include "kernels/surface/shell_distance.h"

#include <algorithm>
#include <cmath>

#include "kernels/surface/edges.h"
#include "kernels/surface/weld.h"

namespace knead {
namespace {

constexpr double kOnEdge = 1e-9;  // of the diagonal: rounding of a nearest point that lies on an edge

double to_segment(const Vec3d& p, const Vec3d& a, const Vec3d& b) {
  const Vec3d along = b - a;
  const double squared = dot(along, along), t = squared > 0 ? std::clamp(dot(p - a, along) / squared, 0.0, 1.0) : 0.0;
  return length(p - a - along * t);
}

}  // namespace

ShellDistance::ShellDistance(std::span<const Vec3f> points, std::span<const uint32_t> triangles, double thickness, Executor* executor)
    : surface_(points, triangles, executor), triangles_(triangles.begin(), triangles.end()), half_(0.5 * thickness) {
  for (const Vec3f& p : points) points_.push_back(to_double(p));
  rim_edges_.assign(triangles_.size() / 3, 0);
  const std::vector<uint32_t> welded = first_at_same_place(std::span<const Vec3d>(points_));
  std::vector<uint32_t> corners(triangles_.size());
  for (size_t c = 0; c < corners.size(); ++c) corners[c] = welded[triangles_[c]];
  std::vector<uint8_t> on_rim(points_.size(), 0);
  EdgeUses(points_.size(), corners, executor).each_edge([&](uint32_t low, std::span<const EdgeUse> uses) {
    if (uses.size() != 1) return;
    on_rim[low] = on_rim[uses[0].high] = 1;
    rim_edges_[uses[0].triangle()] |= static_cast<uint8_t>(1u << uses[0].corner % 3);
    rim_.insert(rim_.end(), {points_[low], points_[uses[0].high], (points_[low] + points_[uses[0].high]) * 0.5});
  });
  for (size_t c = 0; c < corners.size(); ++c)
    if (on_rim[corners[c]]) rim_edges_[c / 3] |= static_cast<uint8_t>(8u << c % 3);
}

int ShellDistance::side_at(const SignedDistance& nearest, const Vec3d& p) const {
  const uint32_t t = nearest.triangle;
  const double near = kOnEdge * surface_.diagonal();
  const auto corner = [&](int k) -> const Vec3d& { return points_[triangles_[3 * size_t{t} + static_cast<size_t>(k % 3)]]; };
  for (int k = 0; k < 3; ++k) {
    if (rim_edges_[t] >> k & 1 && to_segment(nearest.point, corner(k), corner(k + 1)) <= near) return 0;
    if (rim_edges_[t] >> (3 + k) & 1 && length(nearest.point - corner(k)) <= near) return 0;
  }
  // At an edge or a corner of the surface all faces around it see p from the same side, or p is level with one of them: MeshDistance's pseudonormal tells.
  const Vec3d facing = cross(corner(1) - corner(0), corner(2) - corner(0)), away = p - nearest.point;
  const double above = dot(away, facing), size = length(away) * length(facing);
  if (std::abs(above) > 0.1 * size) return above < 0 ? -1 : 1;
  return nearest.distance < 0 ? -1 : 1;
}

int ShellDistance::side_of(const Vec3d& p) const {
  return side_at(surface_.signed_distance(p), p);
}

SignedDistance ShellDistance::around(SignedDistance nearest, const Vec3d& p) const {
  if (!nearest.found()) return nearest;
  if (nearest.distance < 0) nearest.normal = -nearest.normal;  // from the surface instead of out of a solid
  nearest.distance = length(p - nearest.point) - half_;
  nearest.point = nearest.point + half_ * nearest.normal;
  return nearest;
}

SignedDistance ShellDistance::signed_distance(const Vec3d& p, double radius) const {
  return around(surface_.signed_distance(p, radius + half_), p);
}

SignedDistance ShellDistance::signed_distance_near(const Vec3d& p, uint32_t& hint) const {
  return around(surface_.signed_distance_near(p, hint), p);
}

double ShellDistance::from_side(const Vec3d& p, int side, uint32_t& hint) const {
  const SignedDistance nearest = surface_.signed_distance_near(p, hint);
  const double away = length(p - nearest.point);
  return (side_at(nearest, p) == -side ? -away : away) - half_;
}

}  // namespace knead
