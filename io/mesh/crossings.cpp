#include "io/mesh/crossings.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "graph/cancel.h"
#include "io/mesh/raw_mesh.h"
#include "kernels/surface/weld.h"

namespace knead::mesh {

namespace {

constexpr size_t kLeaf = 4;
constexpr size_t kPairsWanted = 10000;         // more than this says no more
constexpr size_t kTestsPerTriangle = 400;      // a tangle of thousands of triangles in one place must not take minutes
constexpr double kOrientationError = 7.8e-16;  // of the determinant's terms, for a determinant in double (Shewchuk 1997)

// +1, -1, or 0 when rounding decides.
int side(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d) {
  const Vec3d p = a - d, q = b - d, r = c - d;
  const double yz = q.y * r.z, zy = q.z * r.y, zx = q.z * r.x, xz = q.x * r.z, xy = q.x * r.y, yx = q.y * r.x;
  const double determinant = p.x * (yz - zy) + p.y * (zx - xz) + p.z * (xy - yx);
  const double size =
      std::abs(p.x) * (std::abs(yz) + std::abs(zy)) + std::abs(p.y) * (std::abs(zx) + std::abs(xz)) + std::abs(p.z) * (std::abs(xy) + std::abs(yx));
  return determinant > kOrientationError * size ? 1 : determinant < -kOrientationError * size ? -1 : 0;
}

// A triangle with all it takes to test it side by side in memory.
struct Triangle {
  std::array<Vec3f, 3> corners;
  std::array<uint32_t, 3> places;
};

bool shares(const Triangle& t, uint32_t place) {
  return t.places[0] == place || t.places[1] == place || t.places[2] == place;
}

using Corners = std::array<Vec3d, 3>;

// Where the corners of s lie, seen from t's plane; 0 also for corners that they share.
std::array<int, 3> sides_of(const Triangle& s, const Corners& p, const Triangle& t, const Corners& q) {
  std::array<int, 3> above{};
  for (size_t k = 0; k < 3; ++k) above[k] = shares(t, s.places[k]) ? 0 : side(q[0], q[1], q[2], p[k]);
  return above;
}

bool on_both_sides(const std::array<int, 3>& above) {
  return std::min({above[0], above[1], above[2]}) < 0 && std::max({above[0], above[1], above[2]}) > 0;
}

// Does an edge of the triangle p pass through the triangle q? Edges that begin or end in a shared corner only touch there and count for nothing.
bool an_edge_passes(const Corners& p, const std::array<int, 3>& above, const Corners& q) {
  for (size_t k = 0; k < 3; ++k) {
    const size_t next = (k + 1) % 3;
    if (above[k] * above[next] != -1) continue;
    // Through the inside or through an edge: never on both sides of the outline.
    std::array<int, 3> outline{};
    for (size_t e = 0; e < 3; ++e) outline[e] = side(p[k], p[next], q[e], q[(e + 1) % 3]);
    if (!on_both_sides(outline)) return true;
  }
  return false;
}

bool cross_each_other(const Triangle& s, const Triangle& t, int shared) {
  const Corners p{to_double(s.corners[0]), to_double(s.corners[1]), to_double(s.corners[2])};
  const Corners q{to_double(t.corners[0]), to_double(t.corners[1]), to_double(t.corners[2])};
  const std::array<int, 3> s_above_t = sides_of(s, p, t, q);
  // All of s beside t's plane, but for the corner they share: they can meet nowhere else.
  if (!on_both_sides(s_above_t) && std::count(s_above_t.begin(), s_above_t.end(), 0) == shared) return false;
  const std::array<int, 3> t_above_s = sides_of(t, q, s, p);
  return an_edge_passes(p, s_above_t, q) || an_edge_passes(q, t_above_s, p);
}

struct Box {
  Vec3f lower{HUGE_VALF, HUGE_VALF, HUGE_VALF}, upper{-HUGE_VALF, -HUGE_VALF, -HUGE_VALF};
  void add(const Vec3f& p) {
    for (int k = 0; k < 3; ++k) lower[k] = std::min(lower[k], p[k]), upper[k] = std::max(upper[k], p[k]);
  }
  bool meets(const Box& o) const {
    return lower.x <= o.upper.x && o.lower.x <= upper.x && lower.y <= o.upper.y && o.lower.y <= upper.y && lower.z <= o.upper.z &&
           o.lower.z <= upper.z;
  }
};

uint64_t spread(uint64_t v) {  // 21 bits to every third bit
  v = (v | v << 32) & 0x1f00000000ffffull;
  v = (v | v << 16) & 0x1f0000ff0000ffull;
  v = (v | v << 8) & 0x100f00f00f00f00full;
  v = (v | v << 4) & 0x10c30c30c30c30c3ull;
  return (v | v << 2) & 0x1249249249249249ull;
}

// Triangles in the order of a space-filling curve; a node is a range of them, halved down to a few.
class CrossingSearch {
 public:
  explicit CrossingSearch(const Surface& surface) : budget_(kTestsPerTriangle * surface.topology->triangle_count()) {
    sort_triangles(surface);
    nodes_.resize(4 * triangles_.size() / kLeaf + 4);
    if (!triangles_.empty()) build(1, 0, triangles_.size());
  }

  Crossings run() {
    if (!triangles_.empty()) within(1, 0, triangles_.size());
    found_.complete = !given_up();
    return found_;
  }

 private:
  void sort_triangles(const Surface& surface) {
    const Vec3d lower = to_double(surface.lower), size = to_double(surface.upper) - lower;
    const double cells = 2097151 / std::max({size.x, size.y, size.z, 1e-300});
    const auto points = surface.points.host();
    const std::vector<uint32_t>& corners = surface.topology->triangles;
    std::vector<std::pair<uint64_t, uint32_t>> keyed(corners.size() / 3);
    for (uint32_t t = 0; t < keyed.size(); ++t) {
      Vec3d centre{0, 0, 0};
      for (int k = 0; k < 3; ++k) centre += to_double(points[corners[3 * t + static_cast<uint32_t>(k)]]) * (1.0 / 3);
      const Vec3d cell = (centre - lower) * cells;
      uint64_t code = 0;
      for (int k = 0; k < 3; ++k) code |= spread(static_cast<uint64_t>(std::clamp(cell[k], 0.0, 2097151.0))) << k;
      keyed[t] = {code, t};
    }
    check_cancelled();
    std::sort(keyed.begin(), keyed.end());
    check_cancelled();
    const std::vector<uint32_t> place = first_at_same_place(points);
    triangles_.resize(keyed.size());
    boxes_.resize(keyed.size());
    for (size_t i = 0; i < keyed.size(); ++i)
      for (size_t k = 0; k < 3; ++k) {
        const uint32_t corner = corners[3 * size_t{keyed[i].second} + k];
        triangles_[i].corners[k] = points[corner];
        triangles_[i].places[k] = place[corner];
        boxes_[i].add(points[corner]);
      }
  }

  Box& node(size_t index) {
    if (index >= nodes_.size()) nodes_.resize(2 * index);
    return nodes_[index];
  }

  void build(size_t index, size_t first, size_t last) {
    Box box;
    if (last - first <= kLeaf) {
      for (size_t i = first; i < last; ++i) box.add(boxes_[i].lower), box.add(boxes_[i].upper);
    } else {
      const size_t middle = (first + last) / 2;
      build(2 * index, first, middle);
      build(2 * index + 1, middle, last);
      for (size_t child : {2 * index, 2 * index + 1}) box.add(node(child).lower), box.add(node(child).upper);
    }
    node(index) = box;
  }

  bool given_up() const { return budget_ == 0 || found_.pairs > kPairsWanted; }

  void within(size_t index, size_t first, size_t last) {
    if (given_up()) return;
    check_cancelled();
    if (last - first <= kLeaf) {
      for (size_t i = first; i < last; ++i)
        for (size_t j = i + 1; j < last; ++j) test(i, j);
      return;
    }
    const size_t middle = (first + last) / 2;
    within(2 * index, first, middle);
    within(2 * index + 1, middle, last);
    between(2 * index, first, middle, 2 * index + 1, middle, last);
  }

  void between(size_t a, size_t a_first, size_t a_last, size_t b, size_t b_first, size_t b_last) {
    if (given_up() || !nodes_[a].meets(nodes_[b])) return;
    const bool a_is_leaf = a_last - a_first <= kLeaf, b_is_leaf = b_last - b_first <= kLeaf;
    if (a_is_leaf && b_is_leaf) {
      for (size_t i = a_first; i < a_last; ++i)
        for (size_t j = b_first; j < b_last; ++j) test(i, j);
    } else if (b_is_leaf || (!a_is_leaf && a_last - a_first >= b_last - b_first)) {
      const size_t middle = (a_first + a_last) / 2;
      between(2 * a, a_first, middle, b, b_first, b_last);
      between(2 * a + 1, middle, a_last, b, b_first, b_last);
    } else {
      const size_t middle = (b_first + b_last) / 2;
      between(a, a_first, a_last, 2 * b, b_first, middle);
      between(a, a_first, a_last, 2 * b + 1, middle, b_last);
    }
  }

  void test(size_t i, size_t j) {
    if (!boxes_[i].meets(boxes_[j]) || budget_ == 0) return;
    --budget_;
    const Triangle &s = triangles_[i], &t = triangles_[j];
    int shared = 0;
    for (uint32_t place : s.places) shared += shares(t, place);
    found_.pairs += shared < 2 && cross_each_other(s, t, shared);
  }

  std::vector<Triangle> triangles_;
  std::vector<Box> boxes_, nodes_;
  size_t budget_;
  Crossings found_;
};

}  // namespace

Crossings count_crossings(const Surface& surface) {
  return CrossingSearch(surface).run();
}

}  // namespace knead::mesh
