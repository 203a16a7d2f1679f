#include "kernels/build_tets/inside_fraction.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace knead {
namespace {

constexpr uint32_t kNone = Octree::kNone;
// M is moved by this, in root units, so that none of its triangles lies in a face of a tet: askew to everything, below what float32 input resolves.
constexpr Vec3d kAskew{2.1e-8, 1.3e-8, 1.7e-8};
constexpr size_t kPiece = 256;

// Values of affine functions at a place.
template <size_t N>
using Affine = std::array<double, N>;
using Barycentric = Affine<4>;

template <size_t N>
Affine<N> between(const Affine<N>& a, const Affine<N>& b, size_t k) {  // where value k is zero; it has opposite signs at a and b
  const double t = a[k] / (a[k] - b[k]);
  Affine<N> at;
  for (size_t c = 0; c < N; ++c) at[c] = a[c] + t * (b[c] - a[c]);
  at[k] = 0;
  return at;
}

// A triangle, and what is left of it where all values are positive.
template <size_t N>
struct Polygon {
  std::array<Affine<N>, 3 + N> at;
  size_t count = 3;

  explicit Polygon(const std::array<Affine<N>, 3>& triangle) {
    std::copy(triangle.begin(), triangle.end(), at.begin());
    for (size_t k = 0; k < N && count > 0; ++k) clip(k);
  }
  void clip(size_t k) {
    const auto from = at;
    const size_t n = std::exchange(count, 0);
    for (size_t i = 0; i < n; ++i) {
      const Affine<N>&p = from[i], &q = from[(i + 1) % n];
      if (p[k] > 0) at[count++] = p;
      if ((p[k] > 0) != (q[k] > 0)) at[count++] = between(p, q, k);
    }
  }
};

// One triangle's part in mean_winding. The flux of a cone's field from corner 0 through the triangle; what it shuts off of the face opposite, likewise from
// corner 1; and of that face's edge from corner 3 to corner 2.
double part_of(const std::array<Barycentric, 3>& triangle) {
  for (size_t k = 0; k < 4; ++k)
    if (triangle[0][k] <= 0 && triangle[1][k] <= 0 && triangle[2][k] <= 0) return 0;
  double sum = 0;
  const Polygon<4> whole(triangle);
  const auto vector = [&](size_t i) { return Vec3d{whole.at[i][1], whole.at[i][2], whole.at[i][3]}; };
  for (size_t i = 2; i < whole.count; ++i) sum += dot(vector(0), cross(vector(i - 1), vector(i)));

  // Where the triangle passes the face: from where its outline leaves the tet's side of it to where it comes back.
  std::array<Barycentric, 2> segment;
  int ends = 0;
  for (size_t i = 0; i < 3; ++i) {
    const Barycentric &p = triangle[i], &q = triangle[(i + 1) % 3];
    if ((p[0] > 0) == (q[0] > 0)) continue;
    segment[p[0] > 0 ? 0 : 1] = between(p, q, 0);
    ++ends;
  }
  if (ends != 2) return sum;
  Barycentric a = segment[0], b = segment[1];
  if ((a[1] > 0) != (b[1] > 0)) {
    const Barycentric at = between(a, b, 1);
    const double along = at[2] / (at[2] + at[3]);  // of the way from corner 3 to corner 2
    if (at[2] > 0 && at[3] > 0) sum += (a[1] > 0 ? 1 : -1) * (1 - along);
  }
  for (size_t k = 1; k < 4; ++k) {
    if (a[k] <= 0 && b[k] <= 0) return sum;
    if ((a[k] > 0) != (b[k] > 0)) (a[k] > 0 ? b : a) = between(a, b, k);
  }
  return sum - (a[2] * b[3] - a[3] * b[2]);
}

class Coordinates {
 public:
  explicit Coordinates(const std::array<Vec3d, 4>& tet) : first_(tet[0]) {
    const Vec3d b = tet[1] - tet[0], c = tet[2] - tet[0], d = tet[3] - tet[0];
    const double over = 1 / dot(b, cross(c, d));
    rows_ = {over * cross(c, d), over * cross(d, b), over * cross(b, c)};
  }
  Barycentric of(const Vec3d& at) const {
    const Vec3d y = at - first_;
    const double b = dot(rows_[0], y), c = dot(rows_[1], y), d = dot(rows_[2], y);
    return {1 - b - c - d, b, c, d};
  }

 private:
  Vec3d first_;
  std::array<Vec3d, 3> rows_;
};

// The material of each cell's copy.
class Materials {
 public:
  Materials(const Octree& octree, const Cells& cells, const Copies& copies, const RawTets& raw, const SoftBody& body, const WindingNumber& winding)
      : octree_(octree),
        cells_(cells),
        copies_(copies),
        raw_(raw),
        body_(body),
        winding_(winding),
        side_(kPlaceUnit * std::ldexp(1.0, octree.depth())) {}

  Vec3d place(uint32_t vertex) const {
    const auto& at = raw_.places[vertex];
    return (1 / side_) * Vec3d{double(at[0]), double(at[1]), double(at[2])};
  }
  std::array<Vec3d, 3> corners(uint32_t triangle) const {
    const uint32_t* v = &body_.triangles[3 * size_t{triangle}];
    return {body_.points[v[0]] + kAskew, body_.points[v[1]] + kAskew, body_.points[v[2]] + kAskew};
  }
  bool is_cut(uint32_t copy) const { return cells_.offsets[copies_.cell[copy]] != cells_.offsets[copies_.cell[copy] + 1]; }
  uint32_t centre(uint32_t copy) const { return raw_.slot_vertices[27 * size_t{copy} + kCentreSlot]; }

  // The triangles of M that bound the copy's material, rising.
  void append(uint32_t copy, std::vector<uint32_t>& triangles) const {
    const uint32_t cell = copies_.cell[copy];
    for (uint32_t e = cells_.offsets[cell]; e < cells_.offsets[cell + 1]; ++e)
      if (is_whole(cell) || copies_.entry_copy[e] == copy) triangles.push_back(cells_.triangles[e]);
  }

  // The winding number at the copy's centre of the surface round its piece alone.
  double at_centre(uint32_t copy) const {
    const Vec3d at = place(centre(copy));
    return is_whole(copies_.cell[copy]) ? std::round(winding_.at(at - kAskew)) : of_piece(copy, at);
  }

 private:
  bool is_whole(uint32_t cell) const { return copies_.first[cell + 1] - copies_.first[cell] == 1; }

  // Along the straight way from the middle of the largest part of a triangle in the cell.
  double of_piece(uint32_t copy, const Vec3d& to) const {
    std::vector<uint32_t> triangles;
    append(copy, triangles);
    double largest = 0, sum = 0;
    Vec3d from = to;
    uint32_t first = kNone;
    for (const uint32_t t : triangles) {
      double area = 0;
      const Vec3d middle = middle_in_cell(copies_.cell[copy], t, area);
      if (area > largest) largest = area, first = t, from = middle;
    }
    const double turned = body_.volume < 0 ? -1 : 1;
    for (const uint32_t t : triangles) {
      const auto [a, b, c] = corners(t);
      const Vec3d way = to - from, ab = b - a, ac = c - a, p = cross(way, ac), s = from - a, q = cross(s, ab);
      const double determinant = dot(ab, p);  // positive where the way goes against the normal
      if (t == first && determinant * turned > 0) sum += turned;
      if (t == first || determinant == 0) continue;
      const double u = dot(s, p) / determinant, w = dot(way, q) / determinant, along = dot(ac, q) / determinant;
      if (u >= 0 && w >= 0 && u + w <= 1 && along > 0 && along < 1) sum += determinant > 0 ? 1 : -1;
    }
    return sum;
  }

  Vec3d middle_in_cell(uint32_t cell, uint32_t triangle, double& area) const {
    const OctreeNode& node = octree_.node(cells_.nodes[cell]);
    const double half = 0.5 * node.size();
    std::array<Affine<6>, 3> values;
    const std::array<Vec3d, 3> at = corners(triangle);
    for (size_t i = 0; i < 3; ++i) {
      const Vec3d y = at[i] - node.centre();
      values[i] = {half - y.x, half + y.x, half - y.y, half + y.y, half - y.z, half + y.z};
    }
    const Polygon<6> part(values);
    const auto corner = [&](size_t i) {
      return 0.5 * Vec3d{part.at[i][1] - part.at[i][0], part.at[i][3] - part.at[i][2], part.at[i][5] - part.at[i][4]};
    };
    Vec3d sum{0, 0, 0}, normal{0, 0, 0};
    for (size_t i = 0; i < part.count; ++i) sum += corner(i);
    for (size_t i = 2; i < part.count; ++i) normal += cross(corner(i - 1) - corner(0), corner(i) - corner(0));
    area = length(normal);
    return node.centre() + (1 / static_cast<double>(std::max<size_t>(1, part.count))) * sum;
  }

  const Octree& octree_;
  const Cells& cells_;
  const Copies& copies_;
  const RawTets& raw_;
  const SoftBody& body_;
  const WindingNumber& winding_;
  const double side_;  // of the octree's cube, places
};

}  // namespace

double mean_winding(const std::array<Vec3d, 4>& tet, std::span<const std::array<Vec3d, 3>> triangles, double at_last) {
  const Coordinates coordinates(tet);
  double sum = at_last;
  for (const auto& [a, b, c] : triangles) sum += part_of({coordinates.of(a), coordinates.of(b), coordinates.of(c)});
  return sum;
}

std::vector<float> inside_fractions(const Octree& octree, const Cells& cells, const Copies& copies, const RawTets& raw, const SoftBody& body,
                                    const WindingNumber& winding, Executor& executor) {
  const Materials materials(octree, cells, copies, raw, body, winding);
  std::vector<uint32_t> copy_of(raw.places.size(), kNone);  // by the centre of a copy that M cuts
  std::vector<double> at_centre(copies.count(), 0);
  executor.parallel_ranges(copies.count(), kPiece, [&](size_t begin, size_t end) {
    for (uint32_t copy = static_cast<uint32_t>(begin); copy < end; ++copy) {
      if (!materials.is_cut(copy)) continue;
      copy_of[materials.centre(copy)] = copy;
      at_centre[copy] = materials.at_centre(copy);
    }
  });
  std::vector<float> fractions(raw.tets.size(), 1);
  executor.parallel_ranges(raw.tets.size(), kPiece, [&](size_t begin, size_t end) {
    std::vector<uint32_t> triangles;
    std::vector<std::array<Vec3d, 3>> places;
    for (size_t t = begin; t < end; ++t) {
      std::array<uint32_t, 4> tet = raw.tets[t];
      triangles.clear();
      size_t last = 4;
      for (size_t k = 0; k < 4; ++k) {
        if (copy_of[tet[k]] == kNone) continue;
        materials.append(copy_of[tet[k]], triangles);
        last = k;
      }
      if (last == 4) continue;
      if (last != 3) {  // an even permutation
        std::swap(tet[last], tet[3]);
        std::swap(tet[last == 0 ? 1 : 0], tet[last == 2 ? 1 : 2]);
      }
      std::sort(triangles.begin(), triangles.end());
      triangles.erase(std::unique(triangles.begin(), triangles.end()), triangles.end());
      places.clear();
      for (const uint32_t triangle : triangles) places.push_back(materials.corners(triangle));
      const double mean = mean_winding({materials.place(tet[0]), materials.place(tet[1]), materials.place(tet[2]), materials.place(tet[3])}, places,
                                       at_centre[copy_of[tet[3]]]);
      fractions[t] = static_cast<float>(std::clamp(std::abs(mean), 0.0, 1.0));
    }
  });
  return fractions;
}

}  // namespace knead
