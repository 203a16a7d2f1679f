#include "io/mesh/triangulate.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace knead {

namespace {

// Above this a concave polygon is cut as a fan: a million-gon must not take an hour.
constexpr size_t kEarClippingLimit = 20000;

struct Point2 {
  double x, y;
  friend bool operator==(const Point2&, const Point2&) = default;
};

double turn(const Point2& a, const Point2& b, const Point2& c) {
  return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

// False for triangles whose corners lie on a line as well as floats can say: the height over the longest edge is below the rounding of the
// coordinates (2^-24 of the largest, on each of the three), so that which way the triangle faces is noise.
bool has_area(std::span<const Vec3f> points, uint32_t a, uint32_t b, uint32_t c) {
  if (a == b || b == c || c == a) return false;
  const Vec3d p = to_double(points[a]), q = to_double(points[b]), r = to_double(points[c]);
  const Vec3d normal = cross(q - p, r - p);
  const double longest_squared = std::max({dot(q - p, q - p), dot(r - q, r - q), dot(p - r, p - r)});
  double largest = 0;
  for (const Vec3d& v : {p, q, r}) largest = std::max({largest, std::abs(v.x), std::abs(v.y), std::abs(v.z)});
  constexpr double kRounding = 1.0 / (1 << 24);
  return dot(normal, normal) > longest_squared * largest * largest * (kRounding * kRounding);
}

// One polygon at a time, with storage that is kept between polygons.
class PolygonCutter {
 public:
  explicit PolygonCutter(std::span<const Vec3f> points) : points_(points) {}

  // Appends corner triples (indices into `corners`) to `out`. False when the polygon is tangled and was cut regardless.
  bool cut(std::span<const uint32_t> corners, std::vector<uint32_t>& out) {
    const auto n = static_cast<uint32_t>(corners.size());
    project(corners);
    if (faces_forward(0)) return fan(0, n, out), true;
    if (n == 4 && faces_forward(1)) return fan(1, n, out), true;
    if (n == 4 || n > kEarClippingLimit) return fan(0, n, out), false;
    return clip_ears(n, out);
  }

 private:
  // Drops the axis along which the polygon's area vector is largest, keeping the orientation: exact, unlike a rotation.
  void project(std::span<const uint32_t> corners) {
    const Vec3d normal = area_vector(points_, corners);
    const Vec3d size{std::abs(normal.x), std::abs(normal.y), std::abs(normal.z)};
    const int drop = size.z >= size.x && size.z >= size.y ? 2 : size.y >= size.x ? 1 : 0;
    int u = (drop + 1) % 3, v = (drop + 2) % 3;
    if (normal[drop] < 0) std::swap(u, v);
    flat_.clear();
    for (uint32_t corner : corners) flat_.push_back({points_[corner][u], points_[corner][v]});
  }

  bool faces_forward(uint32_t apex) const {
    const size_t n = flat_.size();
    for (size_t i = 1; i + 1 < n; ++i)
      if (!(turn(flat_[apex], flat_[(apex + i) % n], flat_[(apex + i + 1) % n]) > 0)) return false;
    // All triangles of the fan turn the same way; it covers the polygon once only if the boundary winds once, that is, no corner but the apex bends
    // back so far that the fan passes a full turn. The sum of the angles at the apex tells.
    double angle = 0;
    for (size_t i = 1; n > 4 && i + 1 < n; ++i) {
      const Point2 &o = flat_[apex], &a = flat_[(apex + i) % n], &b = flat_[(apex + i + 1) % n];
      angle += std::atan2(turn(o, a, b), (a.x - o.x) * (b.x - o.x) + (a.y - o.y) * (b.y - o.y));
    }
    return angle < 6.283;
  }

  static void fan(uint32_t apex, uint32_t n, std::vector<uint32_t>& out) {
    for (uint32_t i = 1; i + 1 < n; ++i) out.insert(out.end(), {apex, (apex + i) % n, (apex + i + 1) % n});
  }

  bool is_ear(uint32_t i) const {
    const Point2 &a = flat_[previous_[i]], &b = flat_[i], &c = flat_[next_[i]];
    if (!(turn(a, b, c) > 0)) return false;
    for (uint32_t k : reflex_) {
      if (removed_[k] || k == previous_[i] || k == i || k == next_[i]) continue;
      const Point2& p = flat_[k];
      if (p == a || p == b || p == c) continue;  // a bridge of a keyhole polygon touches itself there
      if (turn(a, b, p) >= 0 && turn(b, c, p) >= 0 && turn(c, a, p) >= 0) return false;
    }
    return true;
  }

  // Corners that are convex once stay convex, so the reflex corners of the whole polygon are all that can ever lie inside an ear.
  bool clip_ears(uint32_t n, std::vector<uint32_t>& out) {
    next_.resize(n), previous_.resize(n), ear_.resize(n);
    removed_.assign(n, 0);
    reflex_.clear();
    for (uint32_t i = 0; i < n; ++i) next_[i] = i + 1 == n ? 0 : i + 1, previous_[i] = i == 0 ? n - 1 : i - 1;
    for (uint32_t i = 0; i < n; ++i)
      if (!(turn(flat_[previous_[i]], flat_[i], flat_[next_[i]]) > 0)) reflex_.push_back(i);
    for (uint32_t i = 0; i < n; ++i) ear_[i] = is_ear(i);

    bool clean = true;
    uint32_t at = 1, misses = 0;  // from corner 1 on, so that the first ear is the first triangle of a fan from corner 0
    for (uint32_t left = n; left > 3;) {
      if (!ear_[at] && misses < left) {
        at = next_[at];
        ++misses;
        continue;
      }
      if (!ear_[at]) {  // none anywhere: rounding, or the outline crosses itself
        at = least_bad(at, left);
        clean = clean && !(turn(flat_[previous_[at]], flat_[at], flat_[next_[at]]) < 0);
      }
      const uint32_t before = previous_[at], after = next_[at];
      out.insert(out.end(), {before, at, after});
      removed_[at] = 1;
      next_[before] = after, previous_[after] = before;
      ear_[before] = is_ear(before), ear_[after] = is_ear(after);
      at = next_[after];  // skip one, so that ears do not all share a corner
      misses = 0;
      --left;
    }
    out.insert(out.end(), {previous_[at], at, next_[at]});
    return clean;
  }

  // Without an ear: a corner without area first (nothing is lost), else the least reflex one.
  uint32_t least_bad(uint32_t at, uint32_t left) const {
    uint32_t best = at;
    double best_badness = -1;
    for (uint32_t i = 0; i < left; ++i, at = next_[at]) {
      const double t = turn(flat_[previous_[at]], flat_[at], flat_[next_[at]]);
      const double badness = std::abs(t);
      if (best_badness < 0 || badness < best_badness) best = at, best_badness = badness;
    }
    return best;
  }

  std::span<const Vec3f> points_;
  std::vector<Point2> flat_;
  std::vector<uint32_t> next_, previous_, reflex_;
  std::vector<uint8_t> removed_, ear_;
};

}  // namespace

Vec3d area_vector(std::span<const Vec3f> points, std::span<const uint32_t> corners) {
  Vec3d sum{0, 0, 0};
  if (corners.size() < 3) return sum;
  const Vec3d origin = to_double(points[corners[0]]);
  Vec3d a = to_double(points[corners[1]]) - origin;
  for (size_t i = 2; i < corners.size(); ++i) {
    const Vec3d b = to_double(points[corners[i]]) - origin;
    sum += cross(a, b);
    a = b;
  }
  return sum;
}

TriangulationNotes triangulate(std::span<const Vec3f> points, MeshTopology& topology) {
  TriangulationNotes notes;
  PolygonCutter cutter(points);
  std::vector<uint32_t> corners, cut;
  topology.triangles.clear();
  topology.triangle_faces.clear();
  topology.triangles.reserve(topology.corners() > 2 * topology.faces() ? 3 * (topology.corners() - 2 * topology.faces()) : 0);
  topology.triangle_faces.reserve(topology.triangles.capacity() / 3);
  for (size_t face = 0; face < topology.faces(); ++face) {
    const uint32_t first = topology.face_offsets[face], last = topology.face_offsets[face + 1];
    corners.clear();
    for (uint32_t i = first; i < last; ++i)
      if (corners.empty() || corners.back() != topology.face_vertices[i]) corners.push_back(topology.face_vertices[i]);
    while (corners.size() > 1 && corners.back() == corners.front()) corners.pop_back();
    const bool repeated = corners.size() != last - first;

    const size_t before = topology.triangle_faces.size();
    size_t dropped = 0;
    const auto add = [&](uint32_t a, uint32_t b, uint32_t c) {
      if (!has_area(points, a, b, c)) return void(++dropped);
      topology.triangles.insert(topology.triangles.end(), {a, b, c});
      topology.triangle_faces.push_back(static_cast<uint32_t>(face));
    };
    if (corners.size() == 3) {
      add(corners[0], corners[1], corners[2]);
    } else if (corners.size() > 3) {
      cut.clear();
      const bool clean = cutter.cut(corners, cut);
      for (size_t i = 0; i < cut.size(); i += 3) add(corners[cut[i]], corners[cut[i + 1]], corners[cut[i + 2]]);
      if (!clean && topology.triangle_faces.size() > before) ++notes.tangled_faces;
    }
    if (topology.triangle_faces.size() == before) {
      ++notes.degenerate_faces;
      notes.repeated_corners += repeated;
    } else {
      notes.dropped_triangles += dropped;
    }
  }
  return notes;
}

}  // namespace knead
