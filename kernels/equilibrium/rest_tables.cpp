#include "kernels/equilibrium/rest_tables.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <map>
#include <numeric>

#include "graph/error.h"
#include "kernels/equilibrium/energy_simd.h"
#include "kernels/loop/hold.h"
#include "kernels/loop/loop_points.h"
#include "kernels/neighbour_table.h"
#include "kernels/parallel.h"

namespace knead {
namespace {

constexpr uint32_t kLanes = NeighbourTable::kLaneBlock;
constexpr float kChanged = 0.05f;      // of TetGradients: a metric that is off by so much in some tets serves as well
constexpr double kLeastVolume = 1e-5;  // of the diagonal's cube: a surface that encloses less has no volume to keep

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

// H's edges in places, lower first, rising.
std::vector<std::array<uint32_t, 2>> make_edges(const TetMesh& tets, const std::vector<uint32_t>& place, std::span<const float> free) {
  std::vector<std::array<uint32_t, 2>> edges;
  edges.reserve(tets.edges.size());
  for (const auto& edge : tets.edges.host()) {
    const auto [p, q] = std::minmax(place[edge[0]], place[edge[1]]);
    if (free[p] != 0 && free[q] != 0) edges.push_back({p, q});
  }
  std::sort(edges.begin(), edges.end());
  return edges;
}

// The triangles round each vertex of M, when they enclose a volume worth the name: every directed edge has its opposite.
void make_fans(const Lattice& lattice, EquilibriumRest& rest) {
  if (!lattice.rest.topology) return;
  const std::vector<uint32_t>& triangles = lattice.rest.topology->triangles;
  std::map<std::pair<uint32_t, uint32_t>, int> edges;
  for (size_t c = 0; c < triangles.size(); ++c) {
    const uint32_t a = triangles[c], b = triangles[c % 3 == 2 ? c - 2 : c + 1];
    edges[{std::min(a, b), std::max(a, b)}] += a < b ? 1 : -1;
  }
  if (triangles.empty() || std::any_of(edges.begin(), edges.end(), [](const auto& e) { return e.second != 0; })) return;
  double enclosed = 0;
  const auto points = lattice.rest.points.host();
  for (size_t c = 0; c + 2 < triangles.size(); c += 3) {
    const Vec3d o = to_double(points[triangles[0]]), p = to_double(points[triangles[c]]) - o, q = to_double(points[triangles[c + 1]]) - o;
    enclosed += dot(p, cross(q, to_double(points[triangles[c + 2]]) - o)) / 6;
  }
  if (!(std::abs(enclosed) > kLeastVolume * std::pow(lattice.rest.diagonal(), 3))) return;
  rest.fan_offsets.assign(lattice.rest.vertices() + 1, 0);
  for (const uint32_t v : triangles) ++rest.fan_offsets[v + 1];
  for (size_t v = 0; v + 1 < rest.fan_offsets.size(); ++v) rest.fan_offsets[v + 1] += rest.fan_offsets[v];
  rest.fans.resize(2 * triangles.size());
  std::vector<uint32_t> cursor(rest.fan_offsets.begin(), rest.fan_offsets.end() - 1);
  for (size_t c = 0; c < triangles.size(); ++c) {
    const size_t t = c / 3 * 3, next = (c - t + 1) % 3, after = (c - t + 2) % 3, at = 2 * size_t{cursor[triangles[c]]++};
    rest.fans[at] = triangles[t + next];
    rest.fans[at + 1] = triangles[t + after];
  }
}

void make_tet_tables(const Assembly& a, const std::vector<uint32_t>& place, EquilibriumRest& rest) {
  const auto tets = a.tets.tets.host();
  const auto volumes = a.tets.rest_volumes.host();
  // Tets in the order of their first place: neighbours in memory are neighbours in space.
  std::vector<std::pair<uint32_t, uint32_t>> order(tets.size());
  for (uint32_t t = 0; t < tets.size(); ++t) order[t] = {std::min({place[tets[t][0]], place[tets[t][1]], place[tets[t][2]], place[tets[t][3]]}), t};
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
  rest.slot_offsets.assign(place.size() + 1, 0);
  for (size_t k = 0; k < order.size(); ++k) {
    const uint32_t t = order[k].second;
    const auto e = a.edges(tets[t]);
    const auto s = rest.term == ElasticTerm::kEdges ? e : shape_gradients(e);
    for (size_t c = 0; c < 4; ++c) {
      corners[c * rest.stride + k] = place[tets[t][c]];
      ++rest.slot_offsets[place[tets[t][c]] + 1];
    }
    for (size_t c = 0; c < 3; ++c)
      for (int d = 0; d < 3; ++d) shape[(3 * c + static_cast<size_t>(d)) * rest.stride + k] = static_cast<float>(s[c][d]);
    const double m = a.mu(t), l = a.lame(t) + (rest.term == ElasticTerm::kStableNeoHookean ? m : 0);
    mu[k] = static_cast<float>(m * volumes[t]);
    rest.stiffness += m * volumes[t];
    lambda[k] = static_cast<float>(l * volumes[t]);
  }
  for (size_t p = 0; p < place.size(); ++p) rest.slot_offsets[p + 1] += rest.slot_offsets[p];
  rest.slots.resize(4 * tets.size());
  std::vector<uint32_t> cursor(rest.slot_offsets.begin(), rest.slot_offsets.end() - 1);
  for (size_t k = 0; k < order.size(); ++k)
    for (size_t c = 0; c < 4; ++c) rest.slots[cursor[corners[c * rest.stride + k]]++] = static_cast<uint32_t>(c * rest.stride + k);
}

void check_memory(const RestFigures& figures, double limit) {
  if (figures.metric_bytes <= limit) return;
  char text[200];
  std::snprintf(text, sizeof text, "equilibrium: the metric of H's %zu vertices would take %.2g GB; the limit is %.2g GB", figures.vertices,
                figures.metric_bytes * 1e-9, limit * 1e-9);
  throw Error(ErrorCode::kMemory, text, "build a coarser H (build_tets: lower max_depth or min_depth), or raise memory_limit");
}

// Where in the metric's rows the blocks of a corner of a tet and each of the four go.
void find_slot_places(EquilibriumRest& rest) {
  const SparseRows& pattern = rest.grids->pattern();
  const uint32_t* corners = rest.corners.host().data();
  rest.slot_places.resize(4 * rest.slots.size());
  for (uint32_t p = 0; p < rest.places; ++p) {
    const auto begin = pattern.index.begin() + pattern.offsets[p], end = pattern.index.begin() + pattern.offsets[p + 1];
    for (uint32_t e = rest.slot_offsets[p]; e < rest.slot_offsets[p + 1]; ++e)
      for (size_t c = 0; c < 4; ++c) {
        const uint32_t q = corners[c * rest.stride + rest.slots[e] % rest.stride];
        const auto at = std::lower_bound(begin, end, q);
        const bool none = rest.free[p] == 0 || rest.free[q] == 0;
        rest.slot_places[4 * size_t{e} + c] = q == p ? HessianRow::kOwn : none ? HessianRow::kNone : static_cast<uint16_t>(at - begin);
      }
  }
}

std::vector<GridPlace> grid_places(const TetMesh& tets) {
  std::vector<GridPlace> places;
  places.reserve(tets.vertices());
  for (const Vec3f& x : tets.rest.host()) {
    const auto place = [](float at) { return static_cast<int32_t>(std::lround(static_cast<double>(kGridUnit) * static_cast<double>(at))); };
    places.push_back({place(x.x), place(x.y), place(x.z)});
  }
  return places;
}

}  // namespace

std::shared_ptr<const EquilibriumRest> prepare_equilibrium(Executor& executor, const TetMesh& tets, const Lattice& lattice,
                                                           const EquilibriumMaterial& material) {
  const bool on_host = executor.device() == Device{};
  Executor& host = on_host ? executor : stand_in();  // what is made once is made there
  require_size(lattice.tet_rest.size(), tets.vertices(), "equilibrium", "vertices in the lattice", "vertices of the tet mesh");
  const auto start = std::chrono::steady_clock::now();
  auto made = std::make_shared<EquilibriumRest>();
  EquilibriumRest& rest = *made;
  const uint32_t n = static_cast<uint32_t>(tets.vertices());
  rest.term = material.term;
  rest.places = n;
  rest.rows = (n + 15) / 16 * 16;
  rest.device = executor.device();
  rest.rest = tets.rest;
  rest.to_local = lattice.to_local;
  rest.surface = lattice.rest;
  rest.diagonal = std::max(lattice.rest.diagonal() / lattice.to_local.scale, 1e-6);

  Assembly a{tets,
             lattice,
             material,
             painted(host, material.stiffness_weights, lattice, "stiffness weights", false),
             painted(host, material.volume_weights, lattice, "volume weights", false),
             std::vector<double>(n, 0)};
  for (float& w : a.stiffness) w = std::max(w, 1e-3f);  // no stiffness at all is no shape at all
  const std::vector<float> hold = painted(host, material.hold_weights, lattice, "hold weights", false);
  const std::vector<float> pins = painted(host, material.pins, lattice, "pins", true);
  for (size_t t = 0; t < tets.tets.size(); ++t)
    for (const uint32_t v : tets.tets.host()[t]) a.mass[v] += 0.25 * tets.rest_volumes.host()[t];

  rest.figures.vertices = n;
  rest.figures.metric_bytes = MultigridGrids::expected_bytes(n, tets.edges.size());
  check_memory(rest.figures, material.memory_limit);
  const std::vector<GridPlace> by_vertex = grid_places(tets);
  rest.vertex_at = order_in_space(by_vertex);
  std::vector<uint32_t> place(n);
  std::vector<GridPlace> places(n);
  for (uint32_t p = 0; p < n; ++p) place[rest.vertex_at[p]] = p, places[p] = by_vertex[rest.vertex_at[p]];
  make_tet_tables(a, place, rest);
  material.check();
  rest.samples = make_samples(lattice, place, material.contact_samples, !on_host);
  material.check();

  rest.hold.resize(n);
  rest.free.assign(n, 1);
  for (uint32_t v = 0; v < n; ++v) {
    double pull = material.hold * (hold.empty() ? 1.0 : hold[v]);
    const double pin = pins.empty() ? 0 : pins[v];
    if (pin >= 1)
      rest.free[place[v]] = 0, rest.any_pinned = true;
    else if (pin > 0)
      pull += 100 * pin / (1 - pin);
    rest.hold[place[v]] = static_cast<float>(pull / (rest.diagonal * rest.diagonal) * a.mass[v]);
  }
  const double mean_lame = 2 * material.poisson_ratio / (1 - 2 * material.poisson_ratio);
  rest.bulk = mean_lame;
  if (material.keep_volume) make_fans(lattice, rest);
  rest.contact_scale = (1 + mean_lame) / std::max(tets.mean_edge, 1e-6f);

  const auto before_metric = std::chrono::steady_clock::now();
  rest.figures.tets = rest.tets;
  rest.figures.samples = rest.samples.size();
  rest.grids = std::make_unique<MultigridGrids>(host, places, make_edges(tets, place, rest.free), rest.free, material.check_cancelled);
  find_slot_places(rest);
  rest.make_device_tables(host);
  rest.make_rest_hessian(host);
  rest.grids->measure(host, energy_simd(host), rest.hessian);
  if (!on_host) {
    rest.grids->place(executor);
    rest.rest = device_copy(executor, tets.rest.host());
    rest.make_device_tables(executor);
    rest.make_rest_hessian(executor);
    executor.synchronise();  // other threads use them
  }
  rest.figures.metric_bytes = rest.grids->bytes();
  rest.figures.metric_seconds = seconds_since(before_metric);
  rest.figures.seconds = seconds_since(start);
  return made;
}

TetGradients EquilibriumRest::gradients_at(const Row4* u, float* to, uint8_t* changed) const {
  return {u, on.corners, on.shape, on.mu, on.lambda, stride, to, changed, term, kChanged};
}

HessianRow EquilibriumRest::rows_of(const float* gradients, float* entries, float* diagonal, const uint8_t* changed_tets, uint8_t* changed) const {
  return {gradients, stride,   on.slot_offsets, on.slots, on.slot_places, on.hold, on.free, grids->levels().front().a.offsets,
          entries,   diagonal, changed_tets,    changed};
}

void EquilibriumRest::make_rest_hessian(Executor& executor) {
  Buffer<float> gradients(TetGradients::kFloats * stride, executor.memory()), entries(kBlock * grids->levels().front().entries, executor.memory()),
      diagonal(kBlock * size_t{places}, executor.memory());
  float* of_tets = gradients.data_for_write();
  parallel_for(executor, stride, "tet_gradients", gradients_at(nullptr, of_tets, nullptr));
  parallel_for(executor, places, "hessian_row", rows_of(of_tets, entries.data_for_write(), diagonal.data_for_write(), nullptr, nullptr));
  hessian = make_hessian(executor, *grids, std::move(entries), std::move(diagonal));
}

void EquilibriumRest::follow(Executor& executor, const Row4* u, ShapeHessian& shape) const {
  if (shape.gradients.empty()) {
    const auto copy = [&](const Buffer<float>& from) {
      Buffer<float> to(from.size(), executor.memory());
      parallel_for(executor, from.size(), "add_floats", AddFloats{from.view(executor.device()).data(), nullptr, to.data_for_write()},
                   size_t{1} << 14);
      return to;
    };
    shape.now = {copy(hessian.entries), copy(hessian.diagonal), copy(hessian.coarse_entries), copy(hessian.coarse_diagonal)};
    shape.gradients = Buffer<float>(TetGradients::kFloats * stride, executor.memory());
    shape.changed_tets = Buffer<uint8_t>(stride, executor.memory());
    shape.changed = Buffer<uint8_t>(places, executor.memory());
    parallel_for(executor, stride, "tet_gradients", gradients_at(nullptr, shape.gradients.data_for_write(), nullptr));
  }
  float* gradients = shape.gradients.data_for_write();
  uint8_t *changed_tets = shape.changed_tets.data_for_write(), *changed = shape.changed.data_for_write();
  parallel_for(executor, stride, "tet_gradients", gradients_at(u, gradients, changed_tets));
  parallel_for(executor, places, "hessian_row",
               rows_of(gradients, shape.now.entries.data_for_write(), shape.now.diagonal.data_for_write(), changed_tets, changed));
  renew_coarse(executor, *grids, shape.now, changed);
}

void EquilibriumRest::make_device_tables(Executor& executor) {
  const auto place = [&](const auto& table) { return device_tables_(executor, table); };
  on.corners = place(corners.host());
  on.slot_offsets = place(slot_offsets);
  on.slots = place(slots);
  on.slot_places = place(slot_places);
  on.offsets = place(samples.offsets);
  on.indices = place(samples.indices);
  on.back_offsets = place(samples.back_offsets);
  on.back_samples = place(samples.back_samples);
  on.fan_offsets = place(fan_offsets);
  on.fans = place(fans);
  on.vertex_at = place(vertex_at);
  on.shape = place(shape.host());
  on.mu = place(mu.host());
  on.lambda = place(lambda.host());
  on.hold = place(hold);
  on.free = place(free);
  on.weights = place(samples.weights);
  on.area = place(samples.area);
  on.back_weights = place(samples.back_weights);
  on.rest = rest.view(executor.device()).data();
  on.sample_rest = place(samples.rest);
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
