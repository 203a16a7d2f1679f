#include "kernels/equilibrium/rest_tables.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <numeric>

#include "graph/error.h"
#include "kernels/check_size.h"
#include "kernels/equilibrium/energy_simd.h"
#include "kernels/equilibrium/ghost_penalty.h"
#include "kernels/loop/hold.h"
#include "kernels/neighbour_table.h"
#include "kernels/parallel.h"

namespace knead {
namespace {

constexpr uint32_t kLanes = NeighbourTable::kLaneBlock;
constexpr double kLeastVolume = 1e-5;     // A surface that encloses less than this part of its diagonal's cube has no volume to keep.
constexpr float kLeastStiffness = 1e-3f;  // Painted stiffness is at least this: no stiffness at all is no shape at all.
constexpr double kGuard = 4;              // The guard's kappa over the stiffness that a tet lacks,
// and over the flesh's own: of 18 hard presses (docs/study/presses.py: heads, spot and a torus by balls, boxes, fists and pins) 7 end with tets inside out
// without, 2 at 16, and 3 at 64, where 5 do not come to rest instead of 3.
constexpr double kGuardOfFlesh = 16;
constexpr double kGhost =
    0.7;  // The ghost penalty's factor: at 1 the torus of docs/study is 0.3 % further off, at 0.5 some solves take twice as long.
constexpr double kPinHold = 100;  // A half pinned vertex has this hold in addition.

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

// Gradients of the shape functions of corners 1, 2 and 3: rows of the inverse of [b-a c-a d-a].
std::array<Vec3d, 3> shape_gradients(const std::array<Vec3d, 3>& e) {
  const double over = 1 / dot(e[0], cross(e[1], e[2]));
  return {over * cross(e[1], e[2]), over * cross(e[2], e[0]), over * cross(e[0], e[1])};
}

struct Assembly {
  const TetMesh& tets;
  const Lattice& lattice;
  const EquilibriumMaterial& material;
  std::vector<float> stiffness, volume;  // per vertex of H, empty: all 1
  std::vector<double> mass;              // per vertex of H, cells^3
  std::vector<float> material_part;      // per tet, the part of its stiffness and mass that it has; empty: all

  double part(size_t t) const { return material_part.empty() ? 1 : static_cast<double>(material_part[t]); }
  std::array<Vec3d, 3> edges(const std::array<uint32_t, 4>& t) const {
    const auto x = tets.rest.host();
    const Vec3d a = to_double(x[t[0]]);
    return {to_double(x[t[1]]) - a, to_double(x[t[2]]) - a, to_double(x[t[3]]) - a};
  }
  static double mean_of(const std::vector<float>& paint, const std::array<uint32_t, 4>& t) {
    return paint.empty() ? 1 : 0.25 * (static_cast<double>(paint[t[0]]) + paint[t[1]] + paint[t[2]] + paint[t[3]]);
  }
  double mu(size_t t) const { return mean_of(stiffness, tets.tets.host()[t]); }
  double lame(size_t t) const {  // Lame's first parameter
    const double nu = material.poisson_ratio;
    return 2 * nu / (1 - 2 * nu) * mu(t) * mean_of(volume, tets.tets.host()[t]);
  }
};

std::vector<float> painted(Executor& executor, const Buffer<float>* paint, const Lattice& lattice, const char* what, bool largest) {
  if (!paint) return {};
  require_size(paint->size(), lattice.rest.vertices(), "equilibrium", what, "vertices of the surface that the lattice binds");
  const auto values = paint->host();
  for (const float v : values)
    if (!(v >= 0) || !std::isfinite(v)) throw Error(ErrorCode::kInput, std::string("equilibrium: ") + what + " must be zero or positive numbers");
  const double mean = std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(std::max<size_t>(1, values.size()));
  const Buffer<float> on_tets = paint_to_tets(executor, *paint, lattice, largest, largest ? 0.0f : static_cast<float>(mean));
  return {on_tets.host().begin(), on_tets.host().end()};
}

// H's edges between permuted vertices, and what the ghost penalty ties, lower first, rising.
std::vector<std::array<uint32_t, 2>> make_edges(const TetMesh& tets, const std::vector<uint32_t>& permuted, std::span<const float> free,
                                                const SparseRows& ghosts) {
  std::vector<std::array<uint32_t, 2>> edges;
  edges.reserve(tets.edges.size());
  for (const auto& edge : tets.edges.host()) {
    const auto [p, q] = std::minmax(permuted[edge[0]], permuted[edge[1]]);
    if (free[p] != 0 && free[q] != 0) edges.push_back({p, q});
  }
  for (uint32_t p = 0; p < ghosts.rows(); ++p)
    for (uint32_t e = ghosts.offsets[p]; e < ghosts.offsets[p + 1]; ++e)
      if (ghosts.index[e] > p && free[p] != 0 && free[ghosts.index[e]] != 0) edges.push_back({p, ghosts.index[e]});
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  return edges;
}

// Whether every directed edge has its opposite.
bool is_closed(const std::vector<uint32_t>& triangles) {
  std::vector<std::array<uint32_t, 2>> edges, opposites;
  for (size_t c = 0; c < triangles.size(); ++c) {
    const uint32_t a = triangles[c], b = triangles[c % 3 == 2 ? c - 2 : c + 1];
    edges.push_back({a, b});
    opposites.push_back({b, a});
  }
  std::sort(edges.begin(), edges.end());
  std::sort(opposites.begin(), opposites.end());
  return edges == opposites;
}

// The link of each vertex of M: the edges opposite to the vertex in its triangles. Left empty unless M encloses a volume worth the name.
void make_links(const Lattice& lattice, EquilibriumRest& rest) {
  if (!lattice.rest.topology) return;
  const std::vector<uint32_t>& triangles = lattice.rest.topology->triangles;
  if (triangles.empty() || !is_closed(triangles)) return;
  double enclosed = 0;
  const auto points = lattice.rest.points.host();
  for (size_t c = 0; c + 2 < triangles.size(); c += 3) {
    const Vec3d o = to_double(points[triangles[0]]), p = to_double(points[triangles[c]]) - o, q = to_double(points[triangles[c + 1]]) - o;
    enclosed += dot(p, cross(q, to_double(points[triangles[c + 2]]) - o)) / 6;
  }
  if (!(std::abs(enclosed) > kLeastVolume * std::pow(lattice.rest.diagonal(), 3))) return;
  rest.link_offsets.assign(lattice.rest.vertices() + 1, 0);
  for (const uint32_t v : triangles) ++rest.link_offsets[v + 1];
  for (size_t v = 0; v + 1 < rest.link_offsets.size(); ++v) rest.link_offsets[v + 1] += rest.link_offsets[v];
  rest.link_edges.resize(2 * triangles.size());
  std::vector<uint32_t> cursor(rest.link_offsets.begin(), rest.link_offsets.end() - 1);
  for (size_t c = 0; c < triangles.size(); ++c) {
    const size_t t = c / 3 * 3, next = (c - t + 1) % 3, after = (c - t + 2) % 3, at = 2 * size_t{cursor[triangles[c]]++};
    rest.link_edges[at] = triangles[t + next];
    rest.link_edges[at + 1] = triangles[t + after];
  }
}

void make_tet_tables(const Assembly& a, const std::vector<uint32_t>& permuted, EquilibriumRest& rest) {
  const auto tets = a.tets.tets.host();
  const auto volumes = a.tets.rest_volumes.host();
  // Tets in the order of their first permuted vertex: neighbours in memory are neighbours in space.
  std::vector<std::pair<uint32_t, uint32_t>> order(tets.size());
  for (uint32_t t = 0; t < tets.size(); ++t)
    order[t] = {std::min({permuted[tets[t][0]], permuted[tets[t][1]], permuted[tets[t][2]], permuted[tets[t][3]]}), t};
  std::sort(order.begin(), order.end());
  rest.tets = tets.size();
  rest.stride = (tets.size() + kLanes - 1) / kLanes * kLanes;
  rest.corners = Buffer<uint32_t>(4 * rest.stride);
  rest.shape = Buffer<float>(9 * rest.stride);
  rest.mu = Buffer<float>(rest.stride);
  rest.lambda = Buffer<float>(rest.stride);
  uint32_t* corners = rest.corners.data_for_write();
  float *shape = rest.shape.data_for_write(), *mu = rest.mu.data_for_write(), *lambda = rest.lambda.data_for_write();
  std::fill_n(corners, 4 * rest.stride, 0u);
  std::fill_n(shape, 9 * rest.stride, 0.0f);
  std::fill_n(mu, rest.stride, 0.0f);
  std::fill_n(lambda, rest.stride, 0.0f);
  rest.guard.assign(rest.stride, 0);
  rest.incident_offsets.assign(permuted.size() + 1, 0);
  for (size_t k = 0; k < order.size(); ++k) {
    const uint32_t t = order[k].second;
    const auto e = a.edges(tets[t]);
    const auto s = rest.term == ElasticTerm::kEdges ? e : shape_gradients(e);
    for (size_t c = 0; c < 4; ++c) {
      corners[c * rest.stride + k] = permuted[tets[t][c]];
      ++rest.incident_offsets[permuted[tets[t][c]] + 1];
    }
    for (size_t c = 0; c < 3; ++c)
      for (int d = 0; d < 3; ++d) shape[(3 * c + static_cast<size_t>(d)) * rest.stride + k] = static_cast<float>(s[c][d]);
    const double part = a.part(t), m = part * a.mu(t), l = part * a.lame(t) + (rest.term == ElasticTerm::kStableNeoHookean ? m : 0);
    mu[k] = static_cast<float>(m * volumes[t]);
    rest.stiffness += m * volumes[t];
    lambda[k] = static_cast<float>(l * volumes[t]);
    rest.guard[k] = static_cast<float>((kGuard * (1 - part) + kGuardOfFlesh * part) * (a.mu(t) + a.lame(t)) * volumes[t]);
  }
  for (size_t p = 0; p < permuted.size(); ++p) rest.incident_offsets[p + 1] += rest.incident_offsets[p];
  rest.incident_corners.resize(4 * tets.size());
  std::vector<uint32_t> cursor(rest.incident_offsets.begin(), rest.incident_offsets.end() - 1);
  for (size_t k = 0; k < order.size(); ++k)
    for (size_t c = 0; c < 4; ++c) rest.incident_corners[cursor[corners[c * rest.stride + k]]++] = static_cast<uint32_t>(c * rest.stride + k);
}

void check_memory(const RestFigures& figures, double limit) {
  if (figures.metric_bytes <= limit) return;
  char text[200];
  std::snprintf(text, sizeof text, "equilibrium: the metric of H's %zu vertices would take %.2g GB; the limit is %.2g GB", figures.vertices,
                figures.metric_bytes * 1e-9, limit * 1e-9);
  throw Error(ErrorCode::kMemory, text, "build a coarser H (build_tets: lower max_depth or min_depth), or raise memory_limit");
}

// Where in the metric's rows the blocks of a corner of a tet and each of the four go.
void find_incident_entries(EquilibriumRest& rest) {
  const SparseRows& pattern = rest.grids->pattern();
  const uint32_t* corners = rest.corners.host().data();
  rest.incident_entries.resize(4 * rest.incident_corners.size());
  for (uint32_t p = 0; p < rest.vertices; ++p) {
    const auto begin = pattern.index.begin() + pattern.offsets[p], end = pattern.index.begin() + pattern.offsets[p + 1];
    for (uint32_t e = rest.incident_offsets[p]; e < rest.incident_offsets[p + 1]; ++e)
      for (size_t c = 0; c < 4; ++c) {
        const uint32_t q = corners[c * rest.stride + rest.incident_corners[e] % rest.stride];
        const auto at = std::lower_bound(begin, end, q);
        const bool none = rest.free[p] == 0 || rest.free[q] == 0;
        rest.incident_entries[4 * size_t{e} + c] = q == p ? HessianRow::kOwn : none ? HessianRow::kNone : static_cast<uint16_t>(at - begin);
      }
  }
}

void find_ghost_entries(EquilibriumRest& rest) {
  const SparseRows &pattern = rest.grids->pattern(), &ghosts = rest.ghosts;
  rest.ghost_entries.resize(ghosts.index.size());
  for (uint32_t p = 0; p < ghosts.rows(); ++p) {
    const auto begin = pattern.index.begin() + pattern.offsets[p], end = pattern.index.begin() + pattern.offsets[p + 1];
    for (uint32_t e = ghosts.offsets[p]; e < ghosts.offsets[p + 1]; ++e) {
      const uint32_t q = ghosts.index[e];
      const bool none = rest.free[p] == 0 || rest.free[q] == 0;
      rest.ghost_entries[e] = none ? HessianRow::kNone : static_cast<uint16_t>(std::lower_bound(begin, end, q) - begin);
    }
  }
}

void make_ghosts(const Assembly& a, const std::vector<std::array<uint32_t, 4>>& corners, const std::vector<Vec3d>& at, EquilibriumRest& rest) {
  if (a.material_part.empty()) return;
  std::vector<float> stiffness(corners.size());
  for (size_t t = 0; t < corners.size(); ++t) stiffness[t] = static_cast<float>(a.mu(t));
  rest.ghosts = ghost_penalty(corners, at, a.material_part, stiffness, kGhost);
}

std::vector<GridPosition> grid_positions(const TetMesh& tets) {
  std::vector<GridPosition> positions;
  positions.reserve(tets.vertices());
  for (const Vec3f& x : tets.rest.host()) {
    const auto eighths = [](float at) { return static_cast<int32_t>(std::lround(static_cast<double>(kGridUnit) * static_cast<double>(at))); };
    positions.push_back({eighths(x.x), eighths(x.y), eighths(x.z)});
  }
  return positions;
}

// What needs no table. Throws when the metric would not fit.
void begin_rest(const TetMesh& tets, const Lattice& lattice, const EquilibriumMaterial& material, EquilibriumRest& rest) {
  rest.term = material.term;
  rest.vertices = static_cast<uint32_t>(tets.vertices());
  rest.rows = (rest.vertices + 15) / 16 * 16;
  rest.rest = tets.rest;
  rest.to_local = lattice.to_local;
  rest.surface = lattice.rest;
  rest.diagonal = std::max(lattice.rest.diagonal() / lattice.to_local.scale, 1e-6);
  rest.lame = 2 * material.poisson_ratio / (1 - 2 * material.poisson_ratio);
  rest.contact_scale = (1 + rest.lame) / std::max(tets.mean_edge, 1e-6f);
  rest.figures.vertices = rest.vertices;
  rest.figures.metric_bytes = MultigridGrids::expected_bytes(rest.vertices, tets.edges.size());
  check_memory(rest.figures, material.memory_limit);
}

Assembly make_assembly(Executor& host, const TetMesh& tets, const Lattice& lattice, const EquilibriumMaterial& material) {
  Assembly a{tets,
             lattice,
             material,
             painted(host, material.stiffness_weights, lattice, "stiffness weights", false),
             painted(host, material.volume_weights, lattice, "volume weights", false),
             std::vector<double>(tets.vertices(), 0),
             {}};
  if (material.inside && material.outside_stiffness < 1) {
    require_size(material.inside->size(), tets.tets.size(), "equilibrium", "parts inside", "tets");
    for (const float part : material.inside->host()) a.material_part.push_back(std::max(part, static_cast<float>(material.outside_stiffness)));
  }
  for (float& w : a.stiffness) w = std::max(w, kLeastStiffness);
  for (size_t t = 0; t < tets.tets.size(); ++t)
    for (const uint32_t v : tets.tets.host()[t]) a.mass[v] += 0.25 * a.part(t) * tets.rest_volumes.host()[t];
  return a;
}

// Finds the order of the vertices; returns their grid positions in that order.
std::vector<GridPosition> permute(const TetMesh& tets, EquilibriumRest& rest) {
  const std::vector<GridPosition> by_vertex = grid_positions(tets);
  rest.vertex_at = order_in_space(by_vertex);
  std::vector<GridPosition> positions(rest.vertices);
  for (uint32_t p = 0; p < rest.vertices; ++p) positions[p] = by_vertex[rest.vertex_at[p]];
  return positions;
}

// The pull to rest, and pins: below 1 they pull too, at 1 they hold for good.
void make_hold(Executor& host, const Assembly& a, const std::vector<uint32_t>& permuted, EquilibriumRest& rest) {
  const std::vector<float> hold = painted(host, a.material.hold_weights, a.lattice, "hold weights", false);
  const std::vector<float> pins = painted(host, a.material.pins, a.lattice, "pins", true);
  rest.hold.resize(rest.vertices);
  rest.free.assign(rest.vertices, 1);
  for (uint32_t v = 0; v < rest.vertices; ++v) {
    double pull = a.material.hold * (hold.empty() ? 1.0 : hold[v]);
    const double pin = pins.empty() ? 0 : pins[v];
    if (pin >= 1)
      rest.free[permuted[v]] = 0, rest.any_pinned = true;
    else if (pin > 0)
      pull += kPinHold * pin / (1 - pin);
    rest.hold[permuted[v]] = static_cast<float>(pull / (rest.diagonal * rest.diagonal) * a.mass[v]);
  }
}

void find_floating_parts(const Assembly& a, const std::vector<std::array<uint32_t, 4>>& corners, const std::vector<Vec3d>& at,
                         EquilibriumRest& rest) {
  if (!a.material.keep_place) return;
  std::vector<double> mass(rest.vertices);
  std::vector<uint8_t> held(rest.vertices);
  for (uint32_t p = 0; p < rest.vertices; ++p) {
    mass[p] = a.mass[rest.vertex_at[p]];
    held[p] = rest.hold[p] > 0 || rest.free[p] == 0;
  }
  rest.floating = floating_parts(corners, at, mass, held);
}

}  // namespace

std::shared_ptr<const EquilibriumRest> prepare_equilibrium(Executor& executor, const TetMesh& tets, const Lattice& lattice,
                                                           const EquilibriumMaterial& material) {
  const bool on_host = executor.device() == Device{};
  Executor& host = on_host ? executor : stand_in();  // What is made once is made on the host.
  require_size(lattice.tet_rest.size(), tets.vertices(), "equilibrium", "vertices in the lattice", "vertices of the tet mesh");
  const auto start = std::chrono::steady_clock::now();
  auto made = std::make_shared<EquilibriumRest>();
  EquilibriumRest& rest = *made;
  rest.device = executor.device();
  begin_rest(tets, lattice, material, rest);
  const Assembly assembly = make_assembly(host, tets, lattice, material);
  const std::vector<GridPosition> positions = permute(tets, rest);
  std::vector<uint32_t> permuted(rest.vertices);
  for (uint32_t p = 0; p < rest.vertices; ++p) permuted[rest.vertex_at[p]] = p;
  make_tet_tables(assembly, permuted, rest);
  std::vector<std::array<uint32_t, 4>> corners(tets.tets.host().begin(), tets.tets.host().end());  // permuted, in the mesh's order
  for (auto& tet : corners)
    for (uint32_t& p : tet) p = permuted[p];
  std::vector<Vec3d> at(rest.vertices);
  for (uint32_t p = 0; p < rest.vertices; ++p) at[p] = to_double(tets.rest.host()[rest.vertex_at[p]]);
  make_ghosts(assembly, corners, at, rest);
  material.check();
  rest.samples = make_samples(lattice, permuted, material.contact_samples, !on_host);
  material.check();
  make_hold(host, assembly, permuted, rest);
  find_floating_parts(assembly, corners, at, rest);
  if (material.keep_volume) make_links(lattice, rest);

  const auto before_metric = std::chrono::steady_clock::now();
  rest.figures.tets = rest.tets;
  rest.figures.samples = rest.samples.size();
  rest.grids =
      std::make_unique<MultigridGrids>(host, positions, make_edges(tets, permuted, rest.free, rest.ghosts), rest.free, material.check_cancelled);
  find_incident_entries(rest);
  find_ghost_entries(rest);
  rest.make_device_tables(host);
  rest.make_rest_hessian(host);
  rest.grids->measure(host, energy_simd(host), rest.hessian);
  if (!on_host) {
    rest.grids->make_device_tables(executor);
    rest.rest = device_copy(executor, tets.rest.host());
    rest.make_device_tables(executor);
    rest.make_rest_hessian(executor);
    executor.synchronise();  // Other threads use the tables.
  }
  rest.figures.metric_bytes = rest.grids->bytes();
  rest.figures.metric_seconds = seconds_since(before_metric);
  rest.figures.seconds = seconds_since(start);
  return made;
}

void EquilibriumRest::make_device_tables(Executor& executor) {
  const auto put = [&](const auto& table) { return device_tables_(executor, table); };
  on.corners = put(corners.host());
  on.incident_offsets = put(incident_offsets);
  on.incident_corners = put(incident_corners);
  on.incident_entries = put(incident_entries);
  on.link_offsets = put(link_offsets);
  on.link_edges = put(link_edges);
  on.vertex_at = put(vertex_at);
  on.shape = put(shape.host());
  on.mu = put(mu.host());
  on.lambda = put(lambda.host());
  on.guard = put(guard);
  on.ghost_offsets = ghosts.index.empty() ? nullptr : put(ghosts.offsets);
  on.ghosts = put(ghosts.index);
  on.ghost_values = put(ghosts.value);
  on.ghost_entries = put(ghost_entries);
  on.hold = put(hold);
  on.free = put(free);
  on.part_of = put(floating.of_vertex);
  on.mass = put(floating.mass);
  on.arms = put(floating.arms);
  on.part_inverse = put(floating.inverse);
  on.members = put(floating.members);
  for (size_t row = 0; row < floating.tree.size(); ++row) on.part_tree[row] = put(floating.tree[row]);
  on.rest = rest.view(executor.device()).data();
  on.samples = put_samples(executor, samples, device_tables_);
  executor.synchronise();  // other threads use them
}

const MeshDistance& EquilibriumRest::searchable(Executor& executor) const {
  std::call_once(searchable_once_,
                 [&] { searchable_ = std::make_unique<MeshDistance>(surface.points.host(), surface.topology->triangles, &executor); });
  return *searchable_;
}

const RestFigures& figures_of(const EquilibriumRest& rest) {
  return rest.figures;
}

}  // namespace knead
