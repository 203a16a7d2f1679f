// What every H must be, whatever surface it was built from; each is checked from the result alone.
#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <string>
#include <vector>

#include "kernels/build_tets/build_tets.h"
#include "kernels/neighbour_table.h"

namespace knead::tet_build_properties {

inline double volume_at_rest(const TetMesh& mesh, const std::array<uint32_t, 4>& tet) {
  const auto x = mesh.rest.host();
  const Vec3d a = to_double(x[tet[0]]), b = to_double(x[tet[1]]), c = to_double(x[tet[2]]), d = to_double(x[tet[3]]);
  return dot(cross(b - a, c - a), d - a) / 6;
}

// Every triangle with the tets it belongs to, sorted by vertices.
inline std::vector<std::array<uint32_t, 4>> triangles_of(const TetMesh& mesh) {
  std::vector<std::array<uint32_t, 4>> triangles;
  for (uint32_t t = 0; t < mesh.tets.size(); ++t)
    for (size_t skip = 0; skip < 4; ++skip) {
      std::array<uint32_t, 4> triangle{0, 0, 0, t};
      for (size_t k = 0, n = 0; k < 4; ++k)
        if (k != skip) triangle[n++] = mesh.tets.host()[t][k];
      std::sort(triangle.begin(), triangle.begin() + 3);
      triangles.push_back(triangle);
    }
  std::sort(triangles.begin(), triangles.end());
  return triangles;
}

inline std::string wrong_tets(const BuiltTets& build) {
  const TetMesh& mesh = build.tets;
  double sum = 0, cells = 0;
  for (const float v : mesh.rest_volumes.host()) sum += double{v};
  std::vector<uint32_t> valence(mesh.vertices(), 0);
  for (size_t t = 0; t < mesh.tets.size(); ++t) {
    for (const uint32_t v : mesh.tets.host()[t]) {
      if (v >= mesh.vertices()) return "index out of range";
      ++valence[v];
    }
    const double v0 = double{mesh.rest_volumes.host()[t]};
    if (!(v0 > 1e-12 * sum / static_cast<double>(mesh.tets.size()))) return "flat or inverted tet";
    if (std::abs(volume_at_rest(mesh, mesh.tets.host()[t]) - v0) > 1e-6 * v0) return "V0 is not the volume at rest";
  }
  if (*std::min_element(valence.begin(), valence.end()) < 3) return "a vertex in fewer than three tets";
  for (size_t v = 1; v < valence.size(); ++v)
    if (v % kSortWindow != 0 && valence[v] > valence[v - 1]) return "vertices are not sorted by valence";
  for (const TetCell& cell : build.cells) cells += std::pow(8.0, build.depth - cell.level);
  if (std::abs(cells - sum) > 1e-5 * cells) return "tets do not fill their cells: " + std::to_string(sum) + " of " + std::to_string(cells);
  const auto triangles = triangles_of(mesh);
  for (size_t i = 0; i + 2 < triangles.size(); ++i)
    if (std::equal(triangles[i].begin(), triangles[i].begin() + 3, triangles[i + 2].begin())) return "a triangle in three tets";
  return {};
}

inline std::string wrong_tables(const BuiltTets& build) {
  const TetMesh& mesh = build.tets;
  const uint32_t vertices = static_cast<uint32_t>(mesh.vertices());
  if (const auto wrong = check_neighbour_table(mesh.vertex_tets, vertices, PadIndex::kOwnVertex); !wrong.empty()) return "vertex_tets: " + wrong;
  if (const auto wrong = check_neighbour_table(mesh.vertex_edges, vertices, PadIndex::kOwnVertex); !wrong.empty()) return "vertex_edges: " + wrong;
  std::vector<std::array<uint32_t, 4>> wanted, met;  // each tet once for each of its corners
  for (std::array<uint32_t, 4> tet : mesh.tets.host()) {
    std::sort(tet.begin(), tet.end());
    wanted.insert(wanted.end(), 4, tet);
  }
  const auto around = neighbours_by_vertex(mesh.vertex_tets, vertices);
  for (uint32_t a = 0; a < vertices; ++a)
    for (const Neighbour& n : around[a]) {
      std::array<uint32_t, 4> tet{a, n.indices[0], n.indices[1], n.indices[2]};
      if (std::abs(volume_at_rest(mesh, tet) - double{n.value}) > 1e-6 * double{n.value}) return "vertex_tets loses the orientation";
      std::sort(tet.begin(), tet.end());
      met.push_back(tet);
    }
  std::sort(wanted.begin(), wanted.end());
  std::sort(met.begin(), met.end());
  if (met != wanted) return "vertex_tets holds other tets than H";
  std::vector<std::array<uint32_t, 2>> edges;
  for (const auto& tet : mesh.tets.host())
    for (size_t i = 0; i < 4; ++i)
      for (size_t j = i + 1; j < 4; ++j) edges.push_back({std::min(tet[i], tet[j]), std::max(tet[i], tet[j])});
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  if (!std::ranges::equal(edges, mesh.edges.host())) return "edges are not those of the tets, sorted";
  const auto ends = neighbours_by_vertex(mesh.vertex_edges, vertices);
  size_t count = 0;
  for (uint32_t a = 0; a < vertices; ++a)
    for (const Neighbour& n : ends[a]) {
      if (!std::binary_search(edges.begin(), edges.end(), std::array{std::min(a, n.indices[0]), std::max(a, n.indices[0])}))
        return "vertex_edges holds an edge that is not there";
      const double size = length(to_double(mesh.rest.host()[a]) - to_double(mesh.rest.host()[n.indices[0]]));
      if (std::abs(size - double{n.value}) > 1e-6 * size) return "wrong rest length";
      ++count;
    }
  return count == 2 * edges.size() ? "" : "vertex_edges misses an edge";
}

// Kept leaves that touch at a face, an edge or a corner differ by at most one level.
inline std::string wrong_levels(const BuiltTets& build) {
  std::vector<std::array<uint32_t, 4>> cells;
  for (const TetCell& c : build.cells) cells.push_back({static_cast<uint32_t>(c.level), c.x, c.y, c.z});
  std::sort(cells.begin(), cells.end());
  std::set<std::array<uint32_t, 4>> asked;
  for (const TetCell& c : build.cells)
    for (int n = 0; n < 27; ++n) {
      const int64_t x = int64_t{c.x} + n % 3 - 1, y = int64_t{c.y} + n / 3 % 3 - 1, z = int64_t{c.z} + n / 9 - 1;
      if (x < 0 || y < 0 || z < 0) continue;
      const std::array<uint32_t, 4> above{static_cast<uint32_t>(std::max(0, c.level - 2)), static_cast<uint32_t>(x >> 2),
                                          static_cast<uint32_t>(y >> 2), static_cast<uint32_t>(z >> 2)};
      if (c.level < 2 || !asked.insert(above).second) continue;
      for (uint32_t up = 0; up <= above[0]; ++up)
        if (std::binary_search(cells.begin(), cells.end(), std::array{above[0] - up, above[1] >> up, above[2] >> up, above[3] >> up}))
          return "neighbouring leaves differ by two levels";
    }
  return {};
}

inline std::string wrong_lattice(const BuiltTets& build, const Surface& surface, LatticeKind kind) {
  const Lattice& lattice = build.lattice;
  const uint32_t vertices = static_cast<uint32_t>(surface.vertices()), nodes = static_cast<uint32_t>(build.tets.vertices());
  if (const auto wrong = check_neighbour_table(lattice.map, nodes, PadIndex::kZero); !wrong.empty()) return "map: " + wrong;
  if (const auto wrong = check_neighbour_table(lattice.gather, vertices, PadIndex::kZero); !wrong.empty()) return "gather: " + wrong;
  std::vector<uint8_t> used(vertices, 0);
  for (const uint32_t v : surface.topology->face_vertices) used[v] = 1;
  std::vector<std::array<uint32_t, 4>> tets(build.tets.tets.host().begin(), build.tets.tets.host().end());
  for (auto& tet : tets) std::sort(tet.begin(), tet.end());
  std::sort(tets.begin(), tets.end());
  const double slack = 1e-5 * surface.diagonal();
  const auto rows = neighbours_by_vertex(lattice.map, vertices);
  std::vector<double> influence(nodes, 0);
  for (uint32_t i = 0; i < vertices; ++i) {
    Vec3d at{0, 0, 0};
    double sum = 0;
    std::vector<uint32_t> corners;
    for (const Neighbour& n : rows[i]) {
      if (!(n.value >= -1e-6f)) return "a negative coordinate";
      sum += double{n.value};
      at += double{n.value} * to_double(build.tets.rest.host()[n.indices[0]]);
      corners.push_back(n.indices[0]);
    }
    if (std::abs(sum - 1) > 1e-6) return "coordinates of vertex " + std::to_string(i) + " sum to " + std::to_string(sum);
    const Vec3d p = to_double(surface.points.host()[i]);
    const bool finite = std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z);
    if (!used[i] || !finite) continue;
    for (const Neighbour& n : rows[i]) influence[n.indices[0]] += double{n.value};
    if (!(length(lattice.to_local.apply(at) - p) <= slack)) return "vertex " + std::to_string(i) + " is not reproduced";
    if (kind != LatticeKind::kBarycentric || corners.size() < 4) continue;
    std::sort(corners.begin(), corners.end());
    if (corners.size() != 4 || !std::binary_search(tets.begin(), tets.end(), std::array{corners[0], corners[1], corners[2], corners[3]}))
      return "a row that is not one tet's";
  }
  const auto back = neighbours_by_vertex(lattice.gather, nodes);
  for (uint32_t j = 0; j < nodes; ++j) {
    double sum = 0;
    for (const Neighbour& n : back[j]) sum += double{n.value};
    if (back[j].empty() != (influence[j] == 0) || (influence[j] > 0 && std::abs(sum - 1) > 1e-5)) return "gather does not sum to 1";
  }
  return {};
}

// "" or the first thing wrong.
inline std::string wrong(const BuiltTets& build, const Surface& surface, LatticeKind kind = BuildTetsOptions{}.lattice) {
  for (const std::string& what : {wrong_tets(build), wrong_tables(build), wrong_levels(build), wrong_lattice(build, surface, kind)})
    if (!what.empty()) return what;
  return {};
}

// The vertices of H that hang together with each vertex, named by the lowest.
inline std::vector<uint32_t> components(const TetMesh& mesh) {
  std::vector<uint32_t> parent(mesh.vertices());
  for (uint32_t v = 0; v < parent.size(); ++v) parent[v] = v;
  const auto root = [&](uint32_t v) {
    while (parent[v] != v) v = parent[v] = parent[parent[v]];
    return v;
  };
  for (const auto& edge : mesh.edges.host()) {
    const uint32_t a = root(edge[0]), b = root(edge[1]);
    parent[std::max(a, b)] = std::min(a, b);
  }
  for (uint32_t v = 0; v < parent.size(); ++v) parent[v] = root(v);
  return parent;
}

}  // namespace knead::tet_build_properties
