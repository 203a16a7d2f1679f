#include "kernels/surface/closed_mesh.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "kernels/surface/disjoint_sets.h"
#include "kernels/surface/edges.h"
#include "kernels/surface/volume.h"
#include "kernels/surface/weld.h"
#include "kernels/surface/winding_number.h"

namespace knead {
namespace {

bool finite(const Vec3f& p) {
  return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z);
}

void copy_welded(std::span<const Vec3f> points, std::span<const uint32_t> triangles, ClosedMesh& mesh) {
  std::vector<uint8_t> used(points.size(), 0);
  for (uint32_t v : triangles)
    if (v < points.size() && finite(points[v])) used[v] = 1;
  const std::vector<uint32_t> first = first_at_same_place(points, used);
  std::vector<uint32_t> name(points.size(), ~0u);
  for (uint32_t i = 0; i < points.size(); ++i) {
    if (!used[i]) continue;
    if (first[i] == i) {
      name[i] = static_cast<uint32_t>(mesh.points.size());
      mesh.points.push_back(points[i]);
    }
    name[i] = name[first[i]];
  }
  for (size_t t = 0; t + 2 < triangles.size(); t += 3) {
    uint32_t v[3];
    bool good = true;
    for (int k = 0; k < 3; ++k) {
      v[k] = triangles[t + k] < points.size() ? name[triangles[t + k]] : ~0u;
      good = good && v[k] != ~0u;
    }
    if (good) {
      const Vec3d a = to_double(mesh.points[v[0]]), b = to_double(mesh.points[v[1]]), c = to_double(mesh.points[v[2]]);
      good = length(cross(b - a, c - a)) > 0;
    }
    if (good) {
      mesh.triangles.insert(mesh.triangles.end(), v, v + 3);
    } else {
      ++mesh.dropped;
    }
  }
}

void turn(std::vector<uint32_t>& triangles, size_t t) {
  std::swap(triangles[3 * t + 1], triangles[3 * t + 2]);
}

double area_of(const ClosedMesh& mesh, size_t t) {
  const Vec3d a = to_double(mesh.points[mesh.triangles[3 * t]]);
  return 0.5 * length(cross(to_double(mesh.points[mesh.triangles[3 * t + 1]]) - a, to_double(mesh.points[mesh.triangles[3 * t + 2]]) - a));
}

// Makes neighbours over clean edges agree; in each patch the side that covers less area is turned.
void agree(ClosedMesh& mesh) {
  const size_t count = mesh.triangles.size() / 3;
  std::vector<std::array<std::pair<uint32_t, bool>, 3>> neighbours(count);  // (triangle, turned against it)
  std::vector<uint8_t> degree(count, 0);
  bool any = false;
  EdgeUses(mesh.points.size(), mesh.triangles).each_edge([&](uint32_t, std::span<const EdgeUse> uses) {
    if (uses.size() != 2) return;
    const uint32_t one = uses[0].triangle(), other = uses[1].triangle();
    const bool against = uses[0].forward == uses[1].forward;
    any = any || against;
    neighbours[one][degree[one]++] = {other, against};
    neighbours[other][degree[other]++] = {one, against};
  });
  if (!any) return;
  std::vector<uint8_t> side(count, 2);
  std::vector<uint32_t> patch;
  for (uint32_t seed = 0; seed < count; ++seed) {
    if (side[seed] != 2) continue;
    patch.assign(1, seed);
    side[seed] = 0;
    double balance = 0;
    for (size_t k = 0; k < patch.size(); ++k) {
      const uint32_t t = patch[k];
      balance += side[t] ? -area_of(mesh, t) : area_of(mesh, t);
      for (int n = 0; n < degree[t]; ++n) {
        const auto [other, against] = neighbours[t][n];
        if (side[other] != 2) continue;
        side[other] = side[t] ^ static_cast<uint8_t>(against);
        patch.push_back(other);
      }
    }
    const uint8_t minority = balance >= 0 ? 1 : 0;
    for (uint32_t t : patch)
      if (side[t] == minority) turn(mesh.triangles, t), ++mesh.turned;
  }
}

struct Piece {
  std::vector<uint32_t> triangles;
  Vec3d lower{1e300, 1e300, 1e300}, upper{-1e300, -1e300, -1e300};
  double volume = 0;  // signed, about the centre of its box
  bool turned = false;
};

std::vector<Piece> find_pieces(const ClosedMesh& mesh) {
  DisjointSets sets(mesh.points.size());
  for (size_t t = 0; t < mesh.triangles.size(); t += 3)
    sets.join(mesh.triangles[t], mesh.triangles[t + 1]), sets.join(mesh.triangles[t], mesh.triangles[t + 2]);
  std::vector<uint32_t> number(mesh.points.size(), ~0u);
  std::vector<Piece> pieces;
  for (uint32_t t = 0; t < mesh.triangles.size() / 3; ++t) {
    uint32_t& piece = number[sets.find(mesh.triangles[3 * t])];
    if (piece == ~0u) piece = static_cast<uint32_t>(pieces.size()), pieces.emplace_back();
    pieces[piece].triangles.push_back(t);
    for (int k = 0; k < 3; ++k) {
      const Vec3d p = to_double(mesh.points[mesh.triangles[3 * t + k]]);
      for (int axis = 0; axis < 3; ++axis) {
        pieces[piece].lower[axis] = std::min(pieces[piece].lower[axis], p[axis]);
        pieces[piece].upper[axis] = std::max(pieces[piece].upper[axis], p[axis]);
      }
    }
  }
  for (Piece& piece : pieces) {
    const Vec3d centre = (piece.lower + piece.upper) * 0.5;
    for (uint32_t t : piece.triangles) piece.volume += volume_part(std::span<const Vec3f>(mesh.points), &mesh.triangles[3 * t], centre);
  }
  return pieces;
}

double winding_about(const std::vector<Vec3d>& points, const ClosedMesh& mesh, const Piece& piece, const Vec3d& p) {
  std::vector<uint32_t> triangles;
  for (uint32_t t : piece.triangles) triangles.insert(triangles.end(), mesh.triangles.begin() + 3 * t, mesh.triangles.begin() + 3 * t + 3);
  return winding_number_exact(points, triangles, p);
}

void face_outwards(ClosedMesh& mesh) {
  std::vector<Piece> pieces = find_pieces(mesh);
  if (std::none_of(pieces.begin(), pieces.end(), [](const Piece& p) { return p.volume < 0; })) return;
  std::stable_sort(pieces.begin(), pieces.end(), [](const Piece& a, const Piece& b) { return std::abs(a.volume) > std::abs(b.volume); });
  std::vector<Vec3d> points(mesh.points.size());
  std::transform(mesh.points.begin(), mesh.points.end(), points.begin(), [](const Vec3f& p) { return to_double(p); });
  for (size_t k = 0; k < pieces.size(); ++k) {
    const Vec3d p = to_double(mesh.points[mesh.triangles[3 * pieces[k].triangles[0]]]);
    const Piece* container = nullptr;  // the smallest piece around this one
    for (size_t j = 0; j < k; ++j) {
      bool within = true;
      for (int axis = 0; axis < 3; ++axis) within = within && p[axis] > pieces[j].lower[axis] && p[axis] < pieces[j].upper[axis];
      if (within && std::abs(winding_about(points, mesh, pieces[j], p)) > 0.5) container = &pieces[j];
    }
    pieces[k].turned = container ? container->turned : pieces[k].volume < 0;
  }
  for (const Piece& piece : pieces) {
    if (!piece.turned) continue;
    ++mesh.pieces_turned;
    for (uint32_t t : piece.triangles) turn(mesh.triangles, t);
  }
}

// The simple loops that the unmatched edges form, each as its vertices in order, against the direction of the triangles at it. There always are such
// loops: what is left over of closed triangle outlines has as many edges into every vertex as out of it.
std::vector<std::vector<uint32_t>> find_rims(const ClosedMesh& mesh) {
  std::vector<std::pair<uint32_t, uint32_t>> loose;
  EdgeUses(mesh.points.size(), mesh.triangles).each_edge([&](uint32_t low, std::span<const EdgeUse> uses) {
    int net = net_use(uses);
    for (; net > 0; --net) loose.emplace_back(uses[0].high, low);
    for (; net < 0; ++net) loose.emplace_back(low, uses[0].high);
  });
  std::sort(loose.begin(), loose.end());
  std::vector<size_t> next(mesh.points.size() + 1, 0), place(mesh.points.size(), ~size_t{0});
  for (const auto& [from, to] : loose) ++next[from + 1];
  for (size_t v = 0; v + 1 < next.size(); ++v) next[v + 1] += next[v];
  std::vector<size_t> end(next.begin() + 1, next.end());
  std::vector<std::vector<uint32_t>> rims;
  std::vector<uint32_t> path;
  for (const auto& [seed, unused] : loose) {
    if (next[seed] == end[seed]) continue;
    path.assign(1, seed);
    place[seed] = 0;
    while (!path.empty()) {
      const uint32_t from = path.back();
      if (next[from] == end[from]) {  // every loop through it has been taken off
        place[from] = ~size_t{0};
        path.pop_back();
        continue;
      }
      const uint32_t to = loose[next[from]++].second;
      if (place[to] == ~size_t{0}) {
        place[to] = path.size();
        path.push_back(to);
        continue;
      }
      rims.emplace_back(path.begin() + static_cast<std::ptrdiff_t>(place[to]), path.end());
      while (path.back() != to) place[path.back()] = ~size_t{0}, path.pop_back();
    }
  }
  return rims;
}

void close_rims(ClosedMesh& mesh) {
  for (const std::vector<uint32_t>& rim : find_rims(mesh)) {
    Vec3d sum{0, 0, 0};
    double around = 0, area = 0;
    for (size_t k = 0; k < rim.size(); ++k) {
      const Vec3d a = to_double(mesh.points[rim[k]]), b = to_double(mesh.points[rim[(k + 1) % rim.size()]]);
      sum += (a + b) * (0.5 * length(b - a));
      around += length(b - a);
    }
    const uint32_t apex = static_cast<uint32_t>(mesh.points.size());
    mesh.points.push_back(to_float(sum * (1 / around)));
    for (size_t k = 0; k < rim.size(); ++k) {
      mesh.triangles.insert(mesh.triangles.end(), {rim[k], rim[(k + 1) % rim.size()], apex});
      area += area_of(mesh, mesh.triangles.size() / 3 - 1);
    }
    // A rim without area is the seam of a dropped flat triangle: closed as well, but nothing to tell the user about.
    if (area > 1e-5 * around * around) ++mesh.rims, mesh.rim_edges += rim.size(), mesh.openings_area += area;
  }
}

}  // namespace

std::string ClosedMesh::assumptions() const {
  std::string text;
  auto add = [&](const std::string& part) { text += (text.empty() ? "" : "; ") + part; };
  if (rims > 0)
    add(std::to_string(rims) + (rims == 1 ? " opening of " : " openings of ") + std::to_string(rim_edges) +
        " edges closed by a cone to the rim's centre");
  if (pieces_turned > 0)
    add(std::to_string(pieces_turned) + (pieces_turned == 1 ? " piece faces" : " pieces face") + " inwards and was taken inside out");
  if (turned > 0) add(std::to_string(turned) + " triangles turned to agree with their neighbours");
  if (dropped > 0) add(std::to_string(dropped) + " triangles without area or with a non-finite corner left out");
  return text;
}

ClosedMesh close_mesh(std::span<const Vec3f> points, std::span<const uint32_t> triangles) {
  ClosedMesh mesh;
  copy_welded(points, triangles, mesh);
  if (mesh.triangles.empty()) return mesh;
  agree(mesh);
  face_outwards(mesh);
  mesh.own_triangles = mesh.triangles.size() / 3;
  for (size_t t = 0; t < mesh.own_triangles; ++t) mesh.own_area += area_of(mesh, t);
  close_rims(mesh);
  bool first = true;
  for (uint32_t v : mesh.triangles)
    for (int k = 0; k < 3; ++k) {
      const double x = mesh.points[v][k];
      mesh.lower[k] = first ? x : std::min(mesh.lower[k], x);
      mesh.upper[k] = first ? x : std::max(mesh.upper[k], x);
      first = first && k < 2;
    }
  for (const Piece& piece : find_pieces(mesh)) mesh.volume += piece.volume;
  for (size_t t = 0; t < mesh.triangles.size() / 3; ++t) mesh.area += area_of(mesh, t);
  return mesh;
}

}  // namespace knead
