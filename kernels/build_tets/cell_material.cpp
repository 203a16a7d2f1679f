#include "kernels/build_tets/cell_material.h"

#include <algorithm>
#include <array>

#include "kernels/surface/triangle_box.h"

namespace knead {

bool CellMaterial::in_cell(const Vec3d& p) const {
  const double reach = half_ + kTouchSlack;
  return std::abs(p.x - centre_.x) <= reach && std::abs(p.y - centre_.y) <= reach && std::abs(p.z - centre_.z) <= reach;
}

void CellMaterial::join(uint32_t a, uint32_t b) {
  count_ -= sets_.join(a, b);
}

void CellMaterial::join_over_vertices(std::span<const uint32_t> triangles) {
  keyed_.clear();
  for (uint32_t i = 0; i < triangles.size(); ++i)
    for (size_t k = 0; k < 3; ++k) {
      const uint32_t v = body_.triangles[3 * size_t{triangles[i]} + k];
      if (in_cell(body_.points[v])) keyed_.emplace_back(body_.welded[v], i);
    }
  std::sort(keyed_.begin(), keyed_.end());
  for (size_t i = 1; i < keyed_.size(); ++i)
    if (keyed_[i].first == keyed_[i - 1].first) join(keyed_[i].second, keyed_[i - 1].second);
}

// Edges that pass through the cell with both ends outside it.
void CellMaterial::join_over_edges(std::span<const uint32_t> triangles) {
  keyed_.clear();
  for (uint32_t i = 0; i < triangles.size(); ++i)
    for (size_t k = 0; k < 3; ++k) {
      const uint32_t a = body_.welded[body_.triangles[3 * size_t{triangles[i]} + k]];
      const uint32_t b = body_.welded[body_.triangles[3 * size_t{triangles[i]} + (k + 1) % 3]];
      if (a != b && !in_cell(body_.points[a]) && !in_cell(body_.points[b])) keyed_.emplace_back(uint64_t{std::min(a, b)} << 32 | std::max(a, b), i);
    }
  std::sort(keyed_.begin(), keyed_.end());
  const double reach = half_ + kTouchSlack;
  for (size_t i = 1; i < keyed_.size(); ++i) {
    if (keyed_[i].first != keyed_[i - 1].first || sets_.find(keyed_[i].second) == sets_.find(keyed_[i - 1].second)) continue;
    const Vec3d &a = body_.points[keyed_[i].first >> 32], &b = body_.points[keyed_[i].first & UINT32_MAX];
    if (triangle_touches_box(a, b, b, centre_, {reach, reach, reach})) join(keyed_[i].second, keyed_[i - 1].second);
  }
}

// A point well inside the part of the triangle that lies in the cell, and that part's area (Sutherland-Hodgman).
Vec3d CellMaterial::place_on(uint32_t triangle, double& area) const {
  std::array<Vec3d, 16> polygon, clipped;
  size_t n = 3;
  for (size_t k = 0; k < 3; ++k) polygon[k] = body_.points[body_.triangles[3 * size_t{triangle} + k]] - centre_;
  Vec3d middle = (1.0 / 3) * (polygon[0] + polygon[1] + polygon[2]);
  for (int plane = 0; plane < 6 && n > 0; ++plane) {
    const int axis = plane >> 1;
    const double sign = (plane & 1) != 0 ? 1 : -1;
    size_t m = 0;
    for (size_t i = 0; i < n; ++i) {
      const Vec3d &p = polygon[i], &q = polygon[(i + 1) % n];
      const double dp = half_ - sign * p[axis], dq = half_ - sign * q[axis];
      if (dp >= 0) clipped[m++] = p;
      if ((dp > 0 && dq < 0) || (dp < 0 && dq > 0)) clipped[m++] = p + dp / (dp - dq) * (q - p);
    }
    polygon = clipped;
    n = m;
  }
  area = 0;
  if (n > 0) {
    Vec3d sum{0, 0, 0};
    for (size_t i = 0; i < n; ++i) sum += (1.0 + 0.01 * static_cast<double>(i)) * polygon[i];
    middle = 1 / (static_cast<double>(n) + 0.005 * static_cast<double>(n * (n - 1))) * sum;
    Vec3d normal{0, 0, 0};
    for (size_t i = 2; i < n; ++i) normal += knead::cross(polygon[i - 1] - polygon[0], polygon[i] - polygon[0]);
    area = 0.5 * length(normal);
  }
  for (int k = 0; k < 3; ++k) middle[k] = std::clamp(middle[k], -half_, half_);
  return centre_ + middle;
}

// Where the straight way from one point to another meets the triangles, sorted, ends left out. Edges count as hit from both sides, so that a way
// through a shared edge misses nothing; hitting twice does no harm.
void CellMaterial::cross(std::span<const uint32_t> triangles, const Vec3d& from, const Vec3d& to) {
  constexpr double kEdge = 1e-9;
  crossings_.clear();
  const Vec3d way = to - from;
  for (uint32_t i = 0; i < triangles.size(); ++i) {
    const uint32_t* v = &body_.triangles[3 * size_t{triangles[i]}];
    const Vec3d &a = body_.points[v[0]], ab = body_.points[v[1]] - a, ac = body_.points[v[2]] - a;
    const Vec3d p = knead::cross(way, ac);
    const double determinant = dot(ab, p);
    if (std::abs(determinant) <= 1e-14 * length(ab) * length(p)) continue;
    const Vec3d s = from - a;
    const double u = dot(s, p) / determinant;
    const Vec3d q = knead::cross(s, ab);
    const double w = dot(way, q) / determinant, t = dot(ac, q) / determinant;
    if (u >= -kEdge && w >= -kEdge && u + w <= 1 + kEdge && t > 1e-9 && t < 1 - 1e-9) crossings_.push_back({t, i});
  }
  std::sort(crossings_.begin(), crossings_.end(), [](const Crossing& a, const Crossing& b) { return a.t != b.t ? a.t < b.t : a.place < b.place; });
}

void CellMaterial::join_through_inside(std::span<const uint32_t> triangles) {
  struct Place {
    uint32_t triangle;
    double area;
    Vec3d at;
  };
  std::vector<Place> places(triangles.size(), {0, -1, {0, 0, 0}});  // by root: where its patch is largest
  for (uint32_t i = 0; i < triangles.size(); ++i) {
    double area = 0;
    const Vec3d at = place_on(triangles[i], area);
    Place& place = places[sets_.find(i)];
    if (area > place.area) place = {i, area, at};
  }
  std::erase_if(places, [](const Place& place) { return place.area < 0; });
  for (size_t patch = 1; patch < places.size() && count_ > 1; ++patch) {
    const Vec3d from = places[0].at, to = places[patch].at;
    cross(triangles, from, to);
    crossings_.insert(crossings_.begin(), {0.0, places[0].triangle});
    crossings_.push_back({1.0, places[patch].triangle});
    for (size_t i = 1; i < crossings_.size(); ++i) {
      const Crossing &a = crossings_[i - 1], &b = crossings_[i];
      if (sets_.find(a.place) == sets_.find(b.place)) continue;
      const bool together = (b.t - a.t) * length(to - from) <= 10 * kTouchSlack;
      if (together || is_inside(winding_, from + 0.5 * (a.t + b.t) * (to - from))) join(a.place, b.place);
    }
  }
}

uint32_t CellMaterial::pieces(const OctreeNode& cell, std::span<const uint32_t> triangles, size_t most_patches, std::vector<uint32_t>& piece) {
  piece.assign(triangles.size(), 0);
  if (triangles.size() <= 1) return 1;
  centre_ = cell.centre();
  half_ = 0.5 * cell.size();
  sets_.reset(triangles.size());
  count_ = triangles.size();
  join_over_vertices(triangles);
  if (count_ > 1) join_over_edges(triangles);
  if (count_ > most_patches) return 1;
  if (count_ > 1) join_through_inside(triangles);
  if (count_ == 1) return 1;
  return number_pieces(triangles, piece);
}

// In order along a direction that is askew to everything, so that the numbering of M's triangles does not matter.
uint32_t CellMaterial::number_pieces(std::span<const uint32_t> triangles, std::vector<uint32_t>& piece) {
  std::vector<std::pair<double, uint32_t>> first;  // (how far along, root)
  for (uint32_t i = 0; i < triangles.size(); ++i) {
    double along = 0;
    for (size_t k = 0; k < 3; ++k) along += dot(body_.points[body_.triangles[3 * size_t{triangles[i]} + k]], Vec3d{0.6180, 0.5437, 0.5671});
    const auto known = std::find_if(first.begin(), first.end(), [&](const auto& f) { return f.second == sets_.find(i); });
    if (known == first.end()) {
      first.emplace_back(along, sets_.find(i));
    } else {
      known->first = std::min(known->first, along);
    }
  }
  std::sort(first.begin(), first.end());
  for (uint32_t i = 0; i < triangles.size(); ++i)
    piece[i] =
        static_cast<uint32_t>(std::find_if(first.begin(), first.end(), [&](const auto& f) { return f.second == sets_.find(i); }) - first.begin());
  return static_cast<uint32_t>(first.size());
}

size_t CellMaterial::nearest_along(const OctreeNode& cell, std::span<const uint32_t> triangles, const Vec3d& from) {
  centre_ = cell.centre();
  half_ = 0.5 * cell.size();
  double area = 0;
  const Vec3d to = place_on(triangles[0], area);
  cross(triangles, from, to);
  return crossings_.empty() ? 0 : crossings_[0].place;
}

}  // namespace knead
