#include "kernels/shapes/implicit_mesh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>

namespace knead {

namespace {

constexpr uint32_t kGone = 0xffffffffu;

// The six tets of a cube around its diagonal 0-7; corner c is at (c & 1, c >> 1 & 1, c >> 2 & 1). All are positively oriented, and
// neighbouring cubes cut their common face alike.
constexpr int kCubeTets[6][4] = {{0, 1, 3, 7}, {0, 3, 2, 7}, {0, 2, 6, 7}, {0, 6, 4, 7}, {0, 4, 5, 7}, {0, 5, 1, 7}};

}  // namespace

TriangleMesh contour(ImplicitFunction value, const Vec3d& lower, const Vec3d& upper, double cell) {
  std::array<uint32_t, 3> n{};
  for (int k = 0; k < 3; ++k) n[k] = static_cast<uint32_t>(std::ceil((upper[k] - lower[k]) / cell)) + 1;
  const auto index = [&](uint32_t i, uint32_t j, uint32_t k) { return (k * n[1] + j) * n[0] + i; };
  const auto position = [&](uint32_t id) {
    return Vec3d{lower.x + cell * (id % n[0]), lower.y + cell * (id / n[0] % n[1]), lower.z + cell * (id / (n[0] * n[1]))};
  };
  std::vector<double> values(static_cast<size_t>(n[0]) * n[1] * n[2]);
  for (uint32_t id = 0; id < values.size(); ++id) values[id] = value(position(id));

  TriangleMesh mesh;
  std::map<std::pair<uint32_t, uint32_t>, uint32_t> crossings;
  const auto crossing = [&](uint32_t a, uint32_t b) {
    const auto [place, fresh] = crossings.try_emplace(std::minmax(a, b), static_cast<uint32_t>(mesh.points.size()));
    if (fresh) {
      const auto [p, q] = place->first;
      const double t = values[p] / (values[p] - values[q]);
      mesh.points.push_back(position(p) + t * (position(q) - position(p)));
    }
    return place->second;
  };
  // Orientation by counting, not by normals, which triangles without area have not: with the corners in an even order of the tet's, inside ones
  // first, the triangles below face outwards.
  const auto cut = [&](const uint32_t(&tet)[4]) {
    bool positive = true;
    uint32_t inside[4], outside[4];
    int in = 0, out = 0;
    for (uint32_t v : tet) {
      if (values[v] < 0) {
        inside[in++] = v;
        positive ^= out % 2 == 1;
      } else {
        outside[out++] = v;
      }
    }
    if (in == 0 || out == 0) return;
    const auto emit = [&](uint32_t a, uint32_t b, uint32_t c) {
      mesh.triangles.insert(mesh.triangles.end(), {a, positive ? b : c, positive ? c : b});
    };
    if (in == 1)
      emit(crossing(inside[0], outside[0]), crossing(inside[0], outside[1]), crossing(inside[0], outside[2]));
    else if (in == 3)
      emit(crossing(inside[0], outside[0]), crossing(inside[1], outside[0]), crossing(inside[2], outside[0]));
    else {
      const uint32_t a = crossing(inside[0], outside[0]), b = crossing(inside[0], outside[1]);
      const uint32_t c = crossing(inside[1], outside[1]), d = crossing(inside[1], outside[0]);
      emit(a, b, c);
      emit(a, c, d);
    }
  };
  for (uint32_t k = 0; k + 1 < n[2]; ++k)
    for (uint32_t j = 0; j + 1 < n[1]; ++j)
      for (uint32_t i = 0; i + 1 < n[0]; ++i)
        for (const auto& corners : kCubeTets) {
          uint32_t tet[4];
          for (int c = 0; c < 4; ++c) tet[c] = index(i + (corners[c] & 1), j + (corners[c] >> 1 & 1), k + (corners[c] >> 2 & 1));
          cut(tet);
        }
  return mesh;
}

Remesher::Remesher(TriangleMesh mesh, ImplicitFunction value, ImplicitFunction edge)
    : points_(std::move(mesh.points)), faces_(std::move(mesh.triangles)), value_(value), edge_(edge) {
  vertex_faces_.resize(points_.size());
  live_ = points_.size();
  double size = 0;
  for (uint32_t f = 0; f < faces_.size() / 3; ++f)
    for (int c = 0; c < 3; ++c) vertex_faces_[faces_[3 * f + c]].push_back(f);
  for (const Vec3d& p : points_) size = std::max(size, length(p));
  reach_ = 0.1 * size;
}

double Remesher::length_of(uint32_t a, uint32_t b) const {
  return length(points_[a] - points_[b]) / edge_(0.5 * (points_[a] + points_[b]));
}

Vec3d Remesher::normal_of(uint32_t a, uint32_t b, uint32_t c) const {
  return cross(points_[b] - points_[a], points_[c] - points_[a]);
}

std::vector<Remesher::Edge> Remesher::edges() const {
  std::vector<Edge> list;
  for (size_t f = 0; f < faces_.size(); f += 3) {
    if (faces_[f] == kGone) continue;
    for (int c = 0; c < 3; ++c) {
      const uint32_t a = faces_[f + c], b = faces_[f + (c + 1) % 3];
      if (a < b) list.push_back({a, b, length_of(a, b)});
    }
  }
  std::sort(list.begin(), list.end(), [](const Edge& x, const Edge& y) { return std::pair(x.a, x.b) < std::pair(y.a, y.b); });
  return list;
}

int Remesher::faces_of(uint32_t a, uint32_t b, uint32_t faces[2]) const {
  int found = 0;
  for (uint32_t f : vertex_faces_[a])
    if (faces_[3 * f] == b || faces_[3 * f + 1] == b || faces_[3 * f + 2] == b) {
      if (found == 2) return 3;
      faces[found++] = f;
    }
  return found;
}

uint32_t Remesher::opposite(uint32_t face, uint32_t a, uint32_t b) const {
  for (int c = 0; c < 3; ++c)
    if (const uint32_t v = faces_[3 * face + c]; v != a && v != b) return v;
  return kGone;
}

void Remesher::unlink(uint32_t face, uint32_t vertex) {
  auto& list = vertex_faces_[vertex];
  list.erase(std::find(list.begin(), list.end(), face));
}

void Remesher::split(uint32_t a, uint32_t b) {
  uint32_t sides[2];
  if (faces_of(a, b, sides) != 2) return;
  const uint32_t m = static_cast<uint32_t>(points_.size());
  points_.push_back(0.5 * (points_[a] + points_[b]));
  vertex_faces_.emplace_back();
  ++live_;
  for (uint32_t f : sides) {
    const uint32_t fresh = static_cast<uint32_t>(faces_.size() / 3), across = opposite(f, a, b);
    for (int c = 0; c < 3; ++c) faces_.push_back(faces_[3 * f + c] == a ? m : faces_[3 * f + c]);  // keeps b, m, across
    for (int c = 0; c < 3; ++c)
      if (faces_[3 * f + c] == b) faces_[3 * f + c] = m;  // keeps a, m, across
    unlink(f, b);
    vertex_faces_[b].push_back(fresh);
    vertex_faces_[across].push_back(fresh);
    vertex_faces_[m].push_back(f);
    vertex_faces_[m].push_back(fresh);
  }
}

bool Remesher::collapse(uint32_t a, uint32_t b, double longest) {
  uint32_t sides[2];
  if (faces_of(a, b, sides) != 2) return false;
  const uint32_t across[2] = {opposite(sides[0], a, b), opposite(sides[1], a, b)};
  if (vertex_faces_[across[0]].size() <= 3 || vertex_faces_[across[1]].size() <= 3) return false;
  const Vec3d middle = 0.5 * (points_[a] + points_[b]);
  longest *= edge_(middle);
  int common = 0;
  for (uint32_t f : vertex_faces_[b])
    for (int c = 0; c < 3; ++c) {
      const uint32_t v = faces_[3 * f + c], next = faces_[3 * f + (c + 1) % 3];
      if (v == b) {  // `next` runs once over the ring of b
        uint32_t shared[2];
        if (next != a && faces_of(a, next, shared) != 0) ++common;
        if (next != a && length(points_[next] - middle) > longest) return false;
      }
    }
  if (common != 2) return false;
  for (uint32_t v : {a, b})
    for (uint32_t f : vertex_faces_[v]) {
      if (f == sides[0] || f == sides[1]) continue;
      Vec3d p[3];
      for (int c = 0; c < 3; ++c) p[c] = faces_[3 * f + c] == v ? middle : points_[faces_[3 * f + c]];
      if (v == a)
        for (int c = 0; c < 3; ++c)
          if (length(p[c] - middle) > longest) return false;
      const Vec3d before = normal_of(faces_[3 * f], faces_[3 * f + 1], faces_[3 * f + 2]), after = cross(p[1] - p[0], p[2] - p[0]);
      if (dot(before, after) < 0.5 * length(before) * length(after)) return false;
    }
  for (uint32_t f : sides) {
    for (int c = 0; c < 3; ++c) unlink(f, faces_[3 * f + c]);
    for (int c = 0; c < 3; ++c) faces_[3 * f + c] = kGone;
  }
  for (uint32_t f : vertex_faces_[b]) {
    for (int c = 0; c < 3; ++c)
      if (faces_[3 * f + c] == b) faces_[3 * f + c] = a;
    vertex_faces_[a].push_back(f);
  }
  vertex_faces_[b].clear();
  points_[a] = middle;
  --live_;
  return true;
}

void Remesher::flip_all() {
  const auto excess = [&](uint32_t v, int change) {
    const int d = static_cast<int>(vertex_faces_[v].size()) + change - 6;
    return d * d;
  };
  for (const Edge& edge : edges()) {
    const uint32_t a = edge.a, b = edge.b;
    uint32_t sides[2], none[2];
    if (faces_of(a, b, sides) != 2) continue;
    const uint32_t c = opposite(sides[0], a, b), d = opposite(sides[1], a, b);
    if (c == d || faces_of(c, d, none) != 0) continue;
    if (vertex_faces_[a].size() <= 3 || vertex_faces_[b].size() <= 3) continue;
    if (excess(a, -1) + excess(b, -1) + excess(c, 1) + excess(d, 1) >= excess(a, 0) + excess(b, 0) + excess(c, 0) + excess(d, 0)) continue;
    const uint32_t* f = &faces_[3 * sides[0]];
    const bool ab = (f[0] == a && f[1] == b) || (f[1] == a && f[2] == b) || (f[2] == a && f[0] == b);  // side 0 runs from a to b
    const std::array<uint32_t, 3> first{c, ab ? a : d, ab ? d : a}, second{d, ab ? b : c, ab ? c : b};
    const Vec3d old = normal_of(faces_[3 * sides[0]], faces_[3 * sides[0] + 1], faces_[3 * sides[0] + 2]) +
                      normal_of(faces_[3 * sides[1]], faces_[3 * sides[1] + 1], faces_[3 * sides[1] + 2]);
    const Vec3d n0 = normal_of(first[0], first[1], first[2]), n1 = normal_of(second[0], second[1], second[2]);
    if (dot(n0, old) < 0.7 * length(n0) * length(old) || dot(n1, old) < 0.7 * length(n1) * length(old)) continue;
    unlink(sides[0], b);
    unlink(sides[1], a);
    vertex_faces_[d].push_back(sides[0]);
    vertex_faces_[c].push_back(sides[1]);
    std::copy(first.begin(), first.end(), faces_.begin() + 3 * sides[0]);
    std::copy(second.begin(), second.end(), faces_.begin() + 3 * sides[1]);
  }
}

Vec3d Remesher::project(const Vec3d& p, const Vec3d& normal) const {
  double before = 0, value_before = value_(p);
  double at = std::clamp(-value_before, -reach_, reach_);
  for (int round = 0; round < 5 && at != before; ++round) {  // secants
    const double value = value_(p + at * normal);
    if (std::abs(value) < 1e-6 * reach_) break;
    const double slope = std::max(0.3, (value - value_before) / (at - before));
    before = std::exchange(at, std::clamp(at - value / slope, -reach_, reach_));
    value_before = value;
  }
  return p + at * normal;
}

void Remesher::smooth() {
  std::vector<Vec3d> moved = points_;
  for (uint32_t v = 0; v < points_.size(); ++v) {
    if (vertex_faces_[v].empty()) continue;
    Vec3d normal{0, 0, 0}, centre{0, 0, 0};
    double total = 0;
    for (uint32_t f : vertex_faces_[v]) {  // pulled to the middles of its triangles by their areas: evens out areas
      const uint32_t* c = &faces_[3 * f];
      const Vec3d n = normal_of(c[0], c[1], c[2]), middle = (points_[c[0]] + points_[c[1]] + points_[c[2]]) * (1.0 / 3);
      const double wanted = edge_(middle), area = length(n) / (wanted * wanted);
      normal += n;
      centre += middle * area;
      total += area;
    }
    const double size = length(normal);
    if (total <= 0 || size <= 0) continue;
    const Vec3d to = centre * (1 / total) - points_[v], unit = normal * (1 / size);
    moved[v] = project(points_[v] + to - unit * dot(to, unit), unit);
  }
  points_ = std::move(moved);
}

void Remesher::round(double edge) {
  for (const Edge& e : edges())
    if (e.length > 4.0 / 3 * edge) split(e.a, e.b);
  for (const Edge& e : edges())
    if (length_of(e.a, e.b) < 4.0 / 5 * edge && !vertex_faces_[e.a].empty() && !vertex_faces_[e.b].empty()) collapse(e.a, e.b, 4.0 / 3 * edge);
  flip_all();
  smooth();
}

void Remesher::reach(size_t vertices) {
  for (int attempts = 0; live_ != vertices && attempts < 20; ++attempts) {
    std::vector<Edge> list = edges();
    std::stable_sort(list.begin(), list.end(), [](const Edge& x, const Edge& y) { return x.length < y.length; });
    if (live_ > vertices) {
      for (const Edge& e : list) {
        if (live_ == vertices) break;
        if (!vertex_faces_[e.a].empty() && !vertex_faces_[e.b].empty()) collapse(e.a, e.b, HUGE_VAL);
      }
    } else {
      for (auto e = list.rbegin(); e != list.rend() && live_ < vertices; ++e) split(e->a, e->b);
    }
    settle(1);
  }
}

void Remesher::settle(int rounds) {
  for (int i = 0; i < rounds; ++i) {
    flip_all();
    smooth();
  }
}

TriangleMesh Remesher::result() const {
  TriangleMesh mesh;
  std::vector<uint32_t> fresh(points_.size(), kGone);
  for (uint32_t v = 0; v < points_.size(); ++v)
    if (!vertex_faces_[v].empty()) {
      fresh[v] = static_cast<uint32_t>(mesh.points.size());
      mesh.points.push_back(points_[v]);
    }
  for (uint32_t v : faces_)
    if (v != kGone) mesh.triangles.push_back(fresh[v]);
  return mesh;
}

TriangleMesh contour_even(ImplicitFunction value, const Vec3d& lower, const Vec3d& upper, int vertices, ImplicitFunction edge) {
  const auto area_of = [&](const TriangleMesh& mesh) {  // in units of the squared edge asked for
    double area = 0;
    for (size_t t = 0; t < mesh.triangles.size(); t += 3) {
      const Vec3d& a = mesh.points[mesh.triangles[t]];
      const double wanted = edge(a);
      area += 0.5 * length(cross(mesh.points[mesh.triangles[t + 1]] - a, mesh.points[mesh.triangles[t + 2]] - a)) / (wanted * wanted);
    }
    return area;
  };
  const double span = std::max({upper.x - lower.x, upper.y - lower.y, upper.z - lower.z});
  // Equilateral triangles, two a vertex; splits at 4/3 and collapses at 4/5 settle a little below the edge asked for.
  const auto edge_for = [&](double area) { return 1.02 * std::sqrt(area / vertices * 2 / std::sqrt(3.0)); };
  const double coarse = edge_for(area_of(contour(value, lower, upper, span / 24)));
  TriangleMesh start = contour(value, lower, upper, std::clamp(0.7 * coarse, span / 160, span / 60));
  const double unit = edge_for(area_of(start));
  Remesher remesher(std::move(start), value, edge);
  for (int i = 0; i < 8; ++i) remesher.round(unit);
  for (int i = 0; i < 3; ++i) {
    remesher.reach(static_cast<size_t>(vertices));
    remesher.settle(4);
  }
  return remesher.result();
}

}  // namespace knead
