#include "kernels/measure.h"

#include <nanovdb/NanoVDB.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "kernels/check_size.h"
#include "kernels/lane_table.h"
#include "kernels/parallel.h"
#include "kernels/sdf_sample.h"
#include "kernels/surface/mesh_distance.h"
#include "kernels/surface/volume.h"

namespace knead {
namespace {

constexpr double kFar = std::numeric_limits<double>::infinity();

double sampled_distance(const Sdf& sdf, const Vec3d& local) {
  const auto* grid = reinterpret_cast<const nanovdb::NanoGrid<float>*>(sdf.grid.host().data());
  const auto box = grid->indexBBox();
  SdfView view{grid, {}, {}};
  for (int k = 0; k < 3; ++k) {
    view.lower[k] = static_cast<float>(box.min()[k]) - 1;
    view.upper[k] = static_cast<float>(box.max()[k]) + 1;
  }
  return SdfSampler(view).value(to_float((1.0 / sdf.voxel_size) * (local - to_double(sdf.index_origin))));
}

// Points of a barycentric grid with `steps` intervals an edge.
std::vector<std::array<double, 3>> barycentric_grid(int face_samples) {
  const int steps = static_cast<int>((std::sqrt(8.0 * face_samples + 1) - 3) / 2 + 1e-9);
  if (steps < 1) return {{1.0 / 3, 1.0 / 3, 1.0 / 3}};
  std::vector<std::array<double, 3>> grid;
  for (int i = 0; i <= steps; ++i)
    for (int j = 0; i + j <= steps; ++j)
      grid.push_back({static_cast<double>(i) / steps, static_cast<double>(j) / steps, static_cast<double>(steps - i - j) / steps});
  return grid;
}

// A point of M and how deep it is.
struct Depth {
  double depth = 0;
  Vec3d at{0, 0, 0};
  static Depth deeper(const Depth& a, const Depth& b) { return a.depth < b.depth ? b : a; }
};

struct VertexSums {
  Depth deepest;
  double squares = 0, inside = 0;
};

struct TetSums {
  double rest = 0, now = 0, inverted = 0;
};

struct EdgeSums {
  double sum = 0, largest = 0;
};

}  // namespace

void ColliderDistance::add(const Sdf& sdf) {
  colliders_.push_back({&sdf, nullptr, sdf.placement.inverse()});
}
void ColliderDistance::add(const Sdf& sdf, std::shared_ptr<const ExactDistance> exact) {
  colliders_.push_back({&sdf, std::move(exact), sdf.placement.inverse()});
}

double ColliderDistance::Collider::distance(const Vec3d& world) const {
  const Vec3d p = to_local.apply(world);
  const Vec3d below = to_double(sdf->lower) - p, above = p - to_double(sdf->upper);
  const double to_box = length(Vec3d{std::max({below.x, above.x, 0.0}), std::max({below.y, above.y, 0.0}), std::max({below.z, above.z, 0.0})});
  const double local = to_box > 0 ? to_box : exact ? exact->signed_distance(p).distance : sampled_distance(*sdf, p);
  return local * sdf->placement.scale;
}

double ColliderDistance::operator()(const Vec3d& world) const {
  double nearest = kFar;
  for (const Collider& collider : colliders_) nearest = std::min(nearest, collider.distance(world));
  return nearest;
}

size_t ColliderDistance::nearest(const Vec3d& world) const {
  const auto nearer = [&](const Collider& a, const Collider& b) { return a.distance(world) < b.distance(world); };
  return static_cast<size_t>(std::min_element(colliders_.begin(), colliders_.end(), nearer) - colliders_.begin());
}

Penetration measure_penetration(Executor& executor, const Surface& surface, const ColliderDistance& colliders, int face_samples) {
  Penetration found;
  const auto points = surface.points.view(executor.device());
  if (colliders.empty() || points.empty()) return found;
  const auto world = [&](uint32_t i) { return surface.placement.apply(to_double(points[i])); };
  const VertexSums vertices = parallel_reduce(
      executor, points.size(), "measure", VertexSums{},
      [&](uint32_t i) {
        const Vec3d at = world(i);
        const double depth = std::max(0.0, -colliders(at));
        return VertexSums{{depth, at}, depth * depth, depth > 0 ? 1.0 : 0.0};
      },
      [](const VertexSums& a, const VertexSums& b) {
        return VertexSums{Depth::deeper(a.deepest, b.deepest), a.squares + b.squares, a.inside + b.inside};
      });
  found.vertices_max = vertices.deepest.depth;
  found.deepest_at = vertices.deepest.at;
  found.vertices_rms = std::sqrt(vertices.squares / static_cast<double>(points.size()));
  found.vertices_inside = static_cast<size_t>(vertices.inside);
  if (face_samples < 1 || !surface.topology) return found;

  const auto grid = barycentric_grid(face_samples);
  const std::vector<uint32_t>& triangles = surface.topology->triangles;
  const auto deepest_of = [&](uint32_t t) {
    const Vec3d a = world(triangles[3 * t]), b = world(triangles[3 * t + 1]), c = world(triangles[3 * t + 2]);
    // A distance changes no faster than its place does, so most triangles are done after one look.
    const Vec3d middle = (1.0 / 3) * (a + b + c);
    if (colliders(middle) > 1.01 * std::max({length(a - middle), length(b - middle), length(c - middle)})) return Depth{};
    Depth deepest;
    for (const auto& [u, v, w] : grid) {
      const Vec3d at = u * a + v * b + w * c;
      deepest = Depth::deeper(deepest, {-colliders(at), at});
    }
    return deepest;
  };
  const Depth faces = parallel_reduce(executor, triangles.size() / 3, "measure", Depth{}, deepest_of, Depth::deeper);
  found.faces_max = faces.depth;
  if (faces.depth > vertices.deepest.depth) found.deepest_at = faces.at;
  return found;
}

double signed_volume(Executor& executor, std::span<const Vec3f> points, std::span<const uint32_t> triangles) {
  if (triangles.empty()) return 0;
  const Vec3d origin = to_double(points[triangles[0]]);
  return reduce_sum(executor, triangles.size() / 3, "signed_volume", [&](uint32_t t) { return volume_part(points, &triangles[3 * t], origin); });
}

double largest_displacement(Executor& executor, const Surface& before, const Surface& after) {
  const auto from = before.points.view(executor.device()), to = after.points.view(executor.device());
  const bool moved_as_one = !(before.placement == after.placement);
  return reduce_max(executor, from.size(), "largest_displacement", [&](uint32_t i) {
    if (!moved_as_one) return after.placement.scale * length(to_double(to[i]) - to_double(from[i]));
    return length(after.placement.apply(to_double(to[i])) - before.placement.apply(to_double(from[i])));
  });
}

TetFigures measure_tets(Executor& executor, const Buffer<Vec3f>& points, const TetMesh& tets) {
  require_size(points.size(), tets.vertices(), "measure", "points", "vertices of the tet mesh");
  const Device device = executor.device();
  const auto x = points.view(device);
  const auto corners = tets.tets.view(device);
  const auto volumes = tets.rest_volumes.view(device), lengths = tets.rest_lengths.view(device);
  const auto edges = tets.edges.view(device);
  const auto edge = [&](uint32_t a, uint32_t b) { return to_double(x[b]) - to_double(x[a]); };
  const TetSums sums = parallel_reduce(
      executor, corners.size(), "measure_tets", TetSums{},
      [&](uint32_t t) {
        const auto& [a, b, c, d] = corners[t];
        const double volume = dot(cross(edge(a, b), edge(a, c)), edge(a, d)) / 6;
        return TetSums{volumes[t], volume, volume > 0 ? 0.0 : 1.0};
      },
      [](const TetSums& a, const TetSums& b) {
        return TetSums{a.rest + b.rest, a.now + b.now, a.inverted + b.inverted};
      });
  const EdgeSums stretch = parallel_reduce(
      executor, edges.size(), "measure_edges", EdgeSums{},
      [&](uint32_t e) {
        const double part = std::abs(length(edge(edges[e][0], edges[e][1])) / lengths[e] - 1);
        return EdgeSums{part, part};
      },
      [](const EdgeSums& a, const EdgeSums& b) {
        return EdgeSums{a.sum + b.sum, std::max(a.largest, b.largest)};
      });
  TetFigures figures;
  figures.rest_volume = sums.rest;
  figures.volume = sums.now;
  figures.inverted = static_cast<size_t>(sums.inverted);
  figures.stretch_mean = edges.empty() ? 0 : stretch.sum / static_cast<double>(edges.size());
  figures.stretch_max = stretch.largest;
  return figures;
}

Buffer<float> volume_change(Executor& executor, const Buffer<Vec3f>& points, const TetMesh& tets, const Lattice& lattice) {
  require_size(points.size(), tets.vertices(), "measure", "points", "vertices of the tet mesh");
  require_size(lattice.tet_rest.size(), tets.vertices(), "measure", "vertices in the lattice", "vertices of the tet mesh");
  const Device device = executor.device();
  const auto x = points.view(device);
  const LaneTable around = lane_table(tets.vertex_tets, device), map = lane_table(lattice.map, device);
  Buffer<float> of_tets(tets.vertices(), executor.memory()), of_surface(lattice.rest.vertices(), executor.memory());
  float* change = of_tets.data_for_write();
  float* out = of_surface.data_for_write();
  std::fill_n(change, of_tets.size(), 0.0f);
  std::fill_n(out, of_surface.size(), 0.0f);
  parallel_for(executor, around.lanes, "volume_change", [=](uint32_t t) {
    const Vec3d a = to_double(x[around.order[t]]);
    double now = 0, rest = 0;
    for (uint32_t k = 0; k < around.valence[t]; ++k) {
      const uint32_t* at = around.indices + around.entry(t, k);
      const Vec3d b = to_double(x[at[0]]) - a, c = to_double(x[at[around.entries]]) - a, d = to_double(x[at[2 * around.entries]]) - a;
      now += dot(cross(b, c), d) / 6;
      rest += around.values[around.entry(t, k)];
    }
    change[around.order[t]] = rest > 0 ? static_cast<float>(now / rest - 1) : 0.0f;
  });
  parallel_for(executor, map.lanes, "volume_change", [=](uint32_t t) {
    float sum = 0;
    for (uint32_t k = 0; k < map.valence[t]; ++k) sum += map.values[map.entry(t, k)] * change[map.indices[map.entry(t, k)]];
    out[map.order[t]] = sum;
  });
  return of_surface;
}

}  // namespace knead
