// A body-centred grid of tets about a surface, made without build_tets, for tests of the loop's kernels: simple enough to be checked by eye.
#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <random>
#include <vector>

#include "kernels/build_tets/strips.h"
#include "kernels/neighbour_table.h"
#include "kernels/port_types.h"
#include "kernels/shapes/primitives.h"

namespace knead::loop_fixture {

using Grid = std::array<int, 3>;

inline Vec3d edge_of(const std::vector<Vec3f>& x, uint32_t a, uint32_t b) {
  return to_double(x[b]) - to_double(x[a]);
}

inline double six_volume(const std::vector<Vec3f>& x, const std::array<uint32_t, 4>& t) {
  return dot(cross(edge_of(x, t[0], t[1]), edge_of(x, t[0], t[2])), edge_of(x, t[0], t[3]));
}

template <size_t Columns>
NeighbourTable table_of(const std::vector<std::vector<std::pair<std::array<uint32_t, Columns>, float>>>& lists, PadIndex pad, Lanes lanes,
                        Executor& executor) {
  std::vector<uint32_t> offsets{0}, indices;
  std::vector<float> values;
  for (const auto& list : lists) {
    for (const auto& [index, value] : list) {
      indices.insert(indices.end(), index.begin(), index.end());
      values.push_back(value);
    }
    offsets.push_back(static_cast<uint32_t>(values.size()));
  }
  return make_neighbour_table({offsets, indices, values, Columns}, pad, lanes, executor);
}

// The tables and rest figures of positively oriented tets.
inline TetMesh make_tet_mesh(const std::vector<Vec3f>& x, const std::vector<std::array<uint32_t, 4>>& tets, Executor& executor) {
  TetMesh mesh;
  std::vector<std::vector<std::pair<std::array<uint32_t, 3>, float>>> by_vertex(x.size());
  std::vector<std::vector<std::pair<std::array<uint32_t, 1>, float>>> ends(x.size());
  std::vector<float> volumes, lengths;
  std::vector<std::array<uint32_t, 2>> edges;
  for (const auto& [a, b, c, d] : tets) {
    const float v0 = static_cast<float>(six_volume(x, {a, b, c, d}) / 6);
    volumes.push_back(v0);
    by_vertex[a].push_back({{b, c, d}, v0});
    by_vertex[b].push_back({{a, d, c}, v0});
    by_vertex[c].push_back({{a, b, d}, v0});
    by_vertex[d].push_back({{a, c, b}, v0});
    for (const auto& [p, q] : {std::pair{a, b}, {a, c}, {a, d}, {b, c}, {b, d}, {c, d}}) edges.push_back({std::min(p, q), std::max(p, q)});
  }
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  double sum = 0;
  for (const auto& [a, b] : edges) {
    lengths.push_back(static_cast<float>(length(edge_of(x, a, b))));
    sum += lengths.back();
    ends[a].push_back({{b}, lengths.back()});
    ends[b].push_back({{a}, lengths.back()});
  }
  mesh.rest = Buffer<Vec3f>(x);
  mesh.tets = Buffer<std::array<uint32_t, 4>>(tets);
  mesh.rest_volumes = Buffer<float>(volumes);
  mesh.edges = Buffer<std::array<uint32_t, 2>>(edges);
  mesh.rest_lengths = Buffer<float>(lengths);
  mesh.mean_edge = static_cast<float>(sum / static_cast<double>(std::max<size_t>(1, edges.size())));
  mesh.vertex_tets = table_of<3>(by_vertex, PadIndex::kOwnVertex, Lanes::kAll, executor);
  mesh.vertex_strips = make_strips(mesh.vertex_tets, executor);
  mesh.lane_volumes = lane_sums(mesh.vertex_tets);
  mesh.vertex_edges = table_of<1>(ends, PadIndex::kOwnVertex, Lanes::kAll, executor);
  return mesh;
}

struct Scene {
  TetMesh tets;
  Lattice lattice;
  Surface surface;
};

// Cells of size `cell` (local units of `surface`) whose centre is `kept`, each with a vertex at its centre; coordinates of H are multiples of half a cell.
class GridBuilder {
 public:
  GridBuilder(const Surface& surface, double cell, const std::function<bool(const Vec3d&)>& kept) : surface_(surface), cell_(cell) {
    origin_ = 0.5 * (to_double(surface.lower) + to_double(surface.upper));
    Grid low, high;
    for (int k = 0; k < 3; ++k) {
      low[k] = static_cast<int>(std::floor((surface.lower[k] - origin_[k]) / cell)) - 1;
      high[k] = static_cast<int>(std::ceil((surface.upper[k] - origin_[k]) / cell)) + 1;
    }
    for (int i = low[0]; i < high[0]; ++i)
      for (int j = low[1]; j < high[1]; ++j)
        for (int k = low[2]; k < high[2]; ++k) {
          const Vec3d centre{i + 0.5, j + 0.5, k + 0.5};
          if (kept(cell * centre + origin_)) cells_[{i, j, k}] = {};
        }
    for (auto& [at, holds] : cells_) add_cell(at);
  }

  Scene scene(Executor& executor) const {
    Scene scene;
    scene.surface = surface_;
    scene.tets = make_tet_mesh(x_, tets_, executor);
    scene.tets.to_local.scale = cell_;
    scene.tets.to_local.translation = origin_;
    scene.lattice.rest = surface_;
    scene.lattice.tet_rest = scene.tets.rest;
    scene.lattice.to_local = scene.tets.to_local;
    std::vector<std::vector<std::pair<std::array<uint32_t, 1>, float>>> map, gather(x_.size());
    const auto points = surface_.points.host();
    for (uint32_t i = 0; i < points.size(); ++i) {
      map.push_back(coordinates((1 / cell_) * (to_double(points[i]) - origin_)));
      for (const auto& [j, w] : map[i])
        if (w > 1e-6f) gather[j[0]].push_back({{i}, w});
    }
    for (auto& list : gather) {
      double sum = 0;
      for (const auto& [i, w] : list) sum += w;
      for (auto& [i, w] : list) w = static_cast<float>(w / sum);
    }
    scene.lattice.map = table_of<1>(map, PadIndex::kZero, Lanes::kAll, executor);
    scene.lattice.gather = table_of<1>(gather, PadIndex::kZero, Lanes::kWithNeighbours, executor);
    return scene;
  }

 private:
  uint32_t vertex(const Grid& twice) {
    const auto [it, added] = ids_.try_emplace(twice, static_cast<uint32_t>(x_.size()));
    if (added) x_.push_back({0.5f * static_cast<float>(twice[0]), 0.5f * static_cast<float>(twice[1]), 0.5f * static_cast<float>(twice[2])});
    return it->second;
  }
  void add_tet(const Grid& cell, std::array<uint32_t, 4> t) {
    if (six_volume(x_, t) < 0) std::swap(t[2], t[3]);
    cells_[cell].push_back(static_cast<uint32_t>(tets_.size()));
    tets_.push_back(t);
  }
  void add_cell(const Grid& at) {
    const auto corner = [&](int i, int j, int k) { return vertex({2 * at[0] + i, 2 * at[1] + j, 2 * at[2] + k}); };
    const uint32_t centre = corner(1, 1, 1);
    for (int axis = 0; axis < 3; ++axis)
      for (int side = 0; side < 2; ++side) {
        std::array<uint32_t, 4> ring;
        for (int r = 0; r < 4; ++r) {
          Grid g;
          g[axis] = 2 * side;
          g[(axis + 1) % 3] = r == 1 || r == 2 ? 2 : 0;
          g[(axis + 2) % 3] = r >= 2 ? 2 : 0;
          ring[r] = corner(g[0], g[1], g[2]);
        }
        Grid next = at;
        next[axis] += side ? 1 : -1;
        if (!cells_.count(next)) {
          add_tet(at, {centre, ring[0], ring[1], ring[2]});
          add_tet(at, {centre, ring[0], ring[2], ring[3]});
        } else if (side) {
          const uint32_t other = vertex({2 * next[0] + 1, 2 * next[1] + 1, 2 * next[2] + 1});
          for (int r = 0; r < 4; ++r) {
            add_tet(at, {centre, other, ring[r], ring[(r + 1) % 4]});
            cells_[next].push_back(static_cast<uint32_t>(tets_.size() - 1));
          }
        }
      }
  }
  // Barycentric coordinates of p (tet space) in the tet of its cell that holds it best.
  std::vector<std::pair<std::array<uint32_t, 1>, float>> coordinates(const Vec3d& p) const {
    const Grid at{static_cast<int>(std::floor(p.x)), static_cast<int>(std::floor(p.y)), static_cast<int>(std::floor(p.z))};
    std::array<double, 4> best{};
    uint32_t held_by = 0;
    double deepest = -1e30;
    for (int i = -1; i <= 1; ++i)
      for (int j = -1; j <= 1; ++j)
        for (int k = -1; k <= 1; ++k) {
          const auto cell = cells_.find({at[0] + i, at[1] + j, at[2] + k});
          if (cell == cells_.end()) continue;
          for (const uint32_t t : cell->second) {
            std::array<double, 4> w;
            for (size_t c = 0; c < 4; ++c) {
              std::array<Vec3d, 4> q;
              for (size_t v = 0; v < 4; ++v) q[v] = v == c ? p : to_double(x_[tets_[t][v]]);
              w[c] = dot(cross(q[1] - q[0], q[2] - q[0]), q[3] - q[0]) / six_volume(x_, tets_[t]);
            }
            const double least = *std::min_element(w.begin(), w.end());
            if (least > deepest) {
              deepest = least;
              best = w;
              held_by = t;
            }
          }
        }
    std::vector<std::pair<std::array<uint32_t, 1>, float>> result;
    for (size_t c = 0; c < 4; ++c) result.push_back({{tets_[held_by][c]}, static_cast<float>(best[c])});
    return result;
  }

  Surface surface_;
  double cell_;
  Vec3d origin_;
  std::map<Grid, std::vector<uint32_t>> cells_;  // the tets that reach into each
  std::map<Grid, uint32_t> ids_;
  std::vector<Vec3f> x_;
  std::vector<std::array<uint32_t, 4>> tets_;
};

// A ball of radius 1 in cells of `cell`.
inline Scene ball(double cell, int subdivisions, Executor& executor) {
  const double reach = 1 + 0.9 * cell;
  return GridBuilder(make_sphere(1, subdivisions), cell, [=](const Vec3d& p) { return length(p) < reach; }).scene(executor);
}

inline Buffer<Vec3f> shaken(const Buffer<Vec3f>& points, float by, uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> offset(-by, by);
  std::vector<Vec3f> result;
  for (const Vec3f& p : points.host()) {
    const float dx = offset(random), dy = offset(random), dz = offset(random);
    result.push_back(p + Vec3f{dx, dy, dz});
  }
  return Buffer<Vec3f>(result);
}

inline std::vector<Vec3f> vector_of(const Buffer<Vec3f>& points) {
  return {points.host().begin(), points.host().end()};
}

}  // namespace knead::loop_fixture
