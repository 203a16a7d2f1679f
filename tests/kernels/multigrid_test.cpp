#include "kernels/multigrid.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <random>

#include "graph/error.h"
#include "io/vdb.h"
#include "kernels/energy_lanes.h"
#include "kernels/equilibrium.h"
#include "kernels/lattice_map.h"
#include "kernels/multigrid_device.h"
#include "kernels/primitives.h"
#include "kernels/tet_build.h"
#include "tests/kernels/on_device.h"

namespace knead {
namespace multigrid_test {

// H's Laplacian with a weak hold, in an order of its own; vertices in the lowest part may be pinned.
struct Matrix {
  std::unique_ptr<Executor> executor = make_cpu_executor(2);
  std::vector<GridPlace> places;
  std::vector<std::array<uint32_t, 2>> edges;
  std::vector<float> entries, diagonal, free;

  explicit Matrix(const TetMesh& mesh, bool pinned = false) : free(mesh.vertices(), 1.0f) {
    const auto x = mesh.rest.host();
    std::vector<GridPlace> by_vertex;
    for (const Vec3f& v : x)
      by_vertex.push_back({static_cast<int>(std::lround(8 * v.x)), static_cast<int>(std::lround(8 * v.y)), static_cast<int>(std::lround(8 * v.z))});
    const std::vector<uint32_t> order = order_in_space(by_vertex);
    std::vector<uint32_t> place(order.size());
    float lowest = 0;
    for (const Vec3f& v : x) lowest = std::min(lowest, v.y);
    for (uint32_t p = 0; p < order.size(); ++p) {
      place[order[p]] = p;
      places.push_back(by_vertex[order[p]]);
      if (pinned && x[order[p]].y < 0.7f * lowest) free[p] = 0;
    }
    for (const auto& edge : mesh.edges.host()) {
      const auto [a, b] = std::minmax(place[edge[0]], place[edge[1]]);
      edges.push_back({a, b});
    }
    std::sort(edges.begin(), edges.end());
    std::vector<double> by_edge(edges.size(), 0), by_place(order.size(), 0);
    for (const auto& tet : mesh.tets.host()) {
      const Vec3d a = to_double(x[tet[0]]), e1 = to_double(x[tet[1]]) - a, e2 = to_double(x[tet[2]]) - a, e3 = to_double(x[tet[3]]) - a;
      const double six = dot(e1, cross(e2, e3));
      const Vec3d g1 = (1 / six) * cross(e2, e3), g2 = (1 / six) * cross(e3, e1), g3 = (1 / six) * cross(e1, e2);
      const std::array<Vec3d, 4> n{-(g1 + g2 + g3), g1, g2, g3};
      for (size_t i = 0; i < 4; ++i) {
        by_place[place[tet[i]]] += six / 6 * dot(n[i], n[i]) + 1e-5 * six;
        for (size_t j = i + 1; j < 4; ++j) {
          const auto [p, q] = std::minmax(place[tet[i]], place[tet[j]]);
          const auto edge = std::lower_bound(edges.begin(), edges.end(), std::array<uint32_t, 2>{p, q});
          if (free[p] != 0 && free[q] != 0) by_edge[static_cast<size_t>(edge - edges.begin())] += six / 6 * dot(n[i], n[j]);
        }
      }
    }
    for (uint32_t p = 0; p < places.size(); ++p) by_place[p] = free[p] == 0 ? 1 : by_place[p] * (1 + 1e-5);
    entries.assign(by_edge.begin(), by_edge.end());
    diagonal.assign(by_place.begin(), by_place.end());
  }

  // Contacts on the upper side, `stiff` times what the diagonal is there.
  std::vector<float> with_contacts(float stiff) const {
    int32_t highest = 0;
    for (const GridPlace& p : places) highest = std::max(highest, p[1]);
    std::vector<float> changed = diagonal;
    for (size_t p = 0; p < places.size(); ++p)
      if (5 * places[p][1] > 4 * highest && free[p] != 0) changed[p] *= 1 + stiff * static_cast<float>(1 + p % 3);
    return changed;
  }

  std::unique_ptr<Multigrid> multigrid(Executor& on) const {
    return std::make_unique<Multigrid>(on, energy_lanes(on), places, edges, free, entries, diagonal);
  }

  using Vector = std::vector<Vec3d>;
  Vector times(const std::vector<float>& d, const Vector& x) const {
    Vector y(x.size());
    for (size_t p = 0; p < x.size(); ++p) y[p] = static_cast<double>(d[p]) * x[p];
    for (size_t e = 0; e < edges.size(); ++e) {
      y[edges[e][0]] += static_cast<double>(entries[e]) * x[edges[e][1]];
      y[edges[e][1]] += static_cast<double>(entries[e]) * x[edges[e][0]];
    }
    return y;
  }
  Vector random(uint32_t seed) const {
    std::mt19937 engine(seed);
    std::normal_distribution<double> normal;
    Vector x(places.size());
    for (size_t p = 0; p < x.size(); ++p) x[p] = static_cast<double>(free[p]) * Vec3d{normal(engine), normal(engine), normal(engine)};
    return x;
  }
};

Buffer<Row4> solved(const Metric& metric, Executor& on, const Matrix::Vector& right) {
  Buffer<Row4> rows(metric.solve_rows()), scratch(metric.scratch_floats() / 4 + 1);
  Row4* x = rows.data_for_write();
  std::fill_n(x, rows.size(), Row4{0, 0, 0, 0});
  for (size_t p = 0; p < right.size(); ++p) x[p] = to_row(to_float(right[p]));
  metric.solve(on, energy_lanes(on), x, &scratch.data_for_write()->x);
  return rows;
}
Matrix::Vector applied(const Metric& metric, Executor& on, const Matrix::Vector& right) {
  const Buffer<Row4> rows = solved(metric, on, right);
  Matrix::Vector x(right.size());
  for (size_t p = 0; p < x.size(); ++p) x[p] = to_double(to_vec(rows.host()[p]));
  return x;
}

double inner(const Matrix::Vector& a, const Matrix::Vector& b) {
  double sum = 0;
  for (size_t i = 0; i < a.size(); ++i) sum += dot(a[i], b[i]);
  return sum;
}

TetMesh sphere(int depth, int least, int resolution, bool split = false) {
  std::vector<std::string> warnings;
  TetBuildOptions options;
  options.max_depth = depth;
  options.min_depth = least;
  options.split_pieces = split;
  return build_tets(make_sphere(1, resolution), options, *make_cpu_executor(2), warnings).tets;
}

// The largest factor by which a cycle's error falls, after the first few, in the energy's norm.
double worst_factor(const Matrix& matrix, const Metric& metric, const std::vector<float>& diagonal) {
  Matrix::Vector error = matrix.random(7);
  double before = 0, worst = 0;
  for (int cycle = 0; cycle < 8; ++cycle) {
    const Matrix::Vector residual = matrix.times(diagonal, error);
    const double now = std::sqrt(inner(error, residual));
    if (cycle > 0) worst = std::max(worst, now / before);
    before = now;
    const Matrix::Vector step = applied(metric, *matrix.executor, residual);
    for (size_t p = 0; p < error.size(); ++p) error[p] = error[p] - step[p];
  }
  return worst;
}

TEST(Multigrid, IsSymmetricAndPositiveWithPinsAndContacts) {
  const Matrix matrix(sphere(5, 4, 4), true);
  const auto rest = matrix.multigrid(*matrix.executor);
  ASSERT_GE(rest->levels(), 3u);
  const auto contacts = rest->renewed(*matrix.executor, energy_lanes(*matrix.executor), matrix.with_contacts(50), {});
  for (const Metric* metric : {static_cast<const Metric*>(rest.get()), static_cast<const Metric*>(contacts.get())}) {
    for (uint32_t seed = 0; seed < 4; ++seed) {
      Matrix::Vector x = matrix.random(2 * seed + 1), y = matrix.random(2 * seed + 2);
      if (seed > 1)  // smooth ones, which only the coarse grids see
        for (size_t p = 0; p < x.size(); ++p) {
          const double at = static_cast<double>(matrix.places[p][seed % 3]) / 100;
          x[p] = static_cast<double>(matrix.free[p]) * Vec3d{std::sin(at), 1, at};
          y[p] = static_cast<double>(matrix.free[p]) * Vec3d{1, std::cos(at), 1};
        }
      const Matrix::Vector mx = applied(*metric, *matrix.executor, x), my = applied(*metric, *matrix.executor, y);
      const double size = std::sqrt(inner(x, mx) * inner(y, my));
      EXPECT_GT(inner(x, mx), 0);
      EXPECT_GT(inner(y, my), 0);
      EXPECT_LT(std::abs(inner(x, my) - inner(y, mx)), 1e-5 * size) << "seed " << seed;
      for (size_t p = 0; p < x.size(); ++p)
        if (matrix.free[p] == 0) EXPECT_EQ(length(mx[p]), 0) << "a pinned vertex moves";
    }
  }
}

TEST(Multigrid, TakesMostOfTheErrorAtAnyDepthWithPinsAndContacts) {
  struct Case {
    int depth, least, resolution;
  };
  for (const Case& c : {Case{4, 2, 3}, Case{5, 3, 4}, Case{6, 3, 4}, Case{4, 4, 3}})
    for (const bool pinned : {false, true}) {
      const Matrix matrix(sphere(c.depth, c.least, c.resolution), pinned);
      const auto rest = matrix.multigrid(*matrix.executor);
      EXPECT_LT(worst_factor(matrix, *rest, matrix.diagonal), 0.45) << "depth " << c.depth << ", pinned " << pinned;
      const std::vector<float> diagonal = matrix.with_contacts(5);
      const auto contacts = rest->renewed(*matrix.executor, energy_lanes(*matrix.executor), diagonal, {});
      EXPECT_LT(worst_factor(matrix, *contacts, diagonal), 0.65) << "depth " << c.depth << ", pinned " << pinned << ", contacts";
    }
}

TEST(Multigrid, IsTheSameRenewedAsMadeAnew) {
  Matrix matrix(sphere(5, 3, 3));
  const auto rest = matrix.multigrid(*matrix.executor);
  const EnergyLanes& lanes = energy_lanes(*matrix.executor);
  const std::vector<float> diagonal = matrix.with_contacts(20);
  const auto renewed = rest->renewed(*matrix.executor, lanes, diagonal, {});
  for (float& e : matrix.entries) e *= 2;
  std::vector<float> twice = diagonal;
  for (float& d : twice) d *= 2;
  const auto remade = rest->remade(*matrix.executor, lanes, matrix.entries, twice, {});
  for (float& e : matrix.entries) e /= 2;
  matrix.diagonal = diagonal;
  const auto whole = matrix.multigrid(*matrix.executor);
  const Matrix::Vector right = matrix.random(3);
  const Matrix::Vector x = applied(*whole, *matrix.executor, right), y = applied(*renewed, *matrix.executor, right),
                       z = applied(*remade, *matrix.executor, right), other = applied(*rest, *matrix.executor, right);
  double size = 0, by_renewal = 0, by_remaking = 0, difference = 0;
  for (size_t p = 0; p < x.size(); ++p) {
    size = std::max(size, length(x[p]));
    by_renewal = std::max(by_renewal, length(x[p] - y[p]));
    by_remaking = std::max(by_remaking, length(x[p] - 2.0 * z[p]));
    difference = std::max(difference, length(x[p] - other[p]));
  }
  EXPECT_LT(by_renewal, 1e-4 * size);
  EXPECT_LT(by_remaking, 1e-4 * size);
  EXPECT_GT(difference, 0.05 * size) << "the contacts must matter";
}

TEST(Multigrid, IsTheSameBitsForAnyNumberOfThreads) {
  const Matrix matrix(sphere(6, 4, 4));
  const auto one = make_cpu_executor(1), two = make_cpu_executor(2);
  const Matrix::Vector right = matrix.random(5);
  std::vector<Buffer<Row4>> results;
  for (Executor* executor : {one.get(), two.get()}) {
    const auto rest = matrix.multigrid(*executor);
    results.push_back(solved(*rest->renewed(*executor, energy_lanes(*executor), matrix.with_contacts(9), {}), *executor, right));
  }
  EXPECT_EQ(std::memcmp(results[0].host().data(), results[1].host().data(), results[0].bytes()), 0);
}

// What the metric on a device makes of `right`.
Matrix::Vector applied_there(const Metric& metric, Executor& device, const Matrix::Vector& right) {
  std::vector<Row4> rows(metric.solve_rows(), Row4{0, 0, 0, 0});
  for (size_t p = 0; p < right.size(); ++p) rows[p] = to_row(to_float(right[p]));
  Buffer<Row4> x = placed_copy(device, std::span<const Row4>(rows));
  Buffer<float> scratch(metric.scratch_floats(), device.memory());
  metric.solve(device, energy_lanes(device), x.data_for_write(), scratch.data_for_write());
  Matrix::Vector result;
  const std::vector<Row4> there = on_device::back(device, x);
  for (size_t p = 0; p < right.size(); ++p) result.push_back(to_double(to_vec(there[p])));
  return result;
}

double relative_difference(const Matrix::Vector& a, const Matrix::Vector& b) {
  double most = 0, apart = 0;
  for (size_t p = 0; p < a.size(); ++p) most = std::max(most, length(a[p])), apart = std::max(apart, length(a[p] - b[p]));
  return apart / most;
}

class MultigridOnDevice : public testing::TestWithParam<const char*> {};

// The same cycle over the same matrices: roundings apart, which the coarsest system amplifies by its condition.
TEST_P(MultigridOnDevice, IsTheHostsAtRestRenewedAndRemade) {
  const auto device = on_device::device_named(GetParam());
  KNEAD_NEEDS(device);
  for (const bool pinned : {false, true}) {
    Matrix matrix(sphere(5, 4, 4), pinned);
    const EnergyLanes& lanes = energy_lanes(*matrix.executor);
    const auto here = matrix.multigrid(*matrix.executor);
    ASSERT_GE(here->levels(), 3u);
    const DeviceMultigrid there(*device, *here);
    const Matrix::Vector right = matrix.random(3);
    EXPECT_LT(relative_difference(applied(*here, *matrix.executor, right), applied_there(there, *device, right)), 1e-4);
    const std::vector<float> contacts = matrix.with_contacts(20);
    const Buffer<float> far = placed_copy(*device, std::span<const float>(contacts));
    const auto renewed = here->renewed(*matrix.executor, lanes, contacts, {});
    const auto renewed_there = there.renewed(*device, lanes, far.view(device->device()), {});
    EXPECT_LT(relative_difference(applied(*renewed, *matrix.executor, right), applied_there(*renewed_there, *device, right)), 1e-4);
    EXPECT_GT(relative_difference(applied(*renewed, *matrix.executor, right), applied(*here, *matrix.executor, right)), 0.05) << "contacts must matter";
    for (float& e : matrix.entries) e *= 0.5f;
    const auto remade = here->remade(*matrix.executor, lanes, matrix.entries, contacts, {});
    const auto remade_there = there.remade(*device, lanes, matrix.entries, contacts, {});
    EXPECT_LT(relative_difference(applied(*remade, *matrix.executor, right), applied_there(*remade_there, *device, right)), 1e-4);
    EXPECT_GT(relative_difference(applied(*remade, *matrix.executor, right), applied(*renewed, *matrix.executor, right)), 0.05);
  }
}

// Many loose bars: the coarsest grid has a node for each, too many for a dense inverse.
TEST_P(MultigridOnDevice, SmoothsALargeCoarsestGrid) {
  const auto device = on_device::device_named(GetParam());
  KNEAD_NEEDS(device);
  Matrix matrix(TetMesh{});
  for (int bar = 0; bar < 1200; ++bar)
    for (int k = 0; k < 3; ++k) {
      const auto node = static_cast<uint32_t>(matrix.places.size());
      matrix.places.push_back({8 * k, 1 << (bar % 8), 8 * bar});
      if (k > 0) matrix.edges.push_back({node - 1, node});
    }
  std::sort(matrix.edges.begin(), matrix.edges.end());
  matrix.free.assign(matrix.places.size(), 1.0f);
  matrix.entries.assign(matrix.edges.size(), -1.0f);
  matrix.diagonal.assign(matrix.places.size(), 0.3f);
  for (const auto& [a, b] : matrix.edges) matrix.diagonal[a] += 1, matrix.diagonal[b] += 1;
  const auto here = matrix.multigrid(*matrix.executor);
  ASSERT_GT(here->size(here->levels() - 1), 1000u);
  const DeviceMultigrid there(*device, *here);
  Matrix::Vector error = matrix.random(7);
  const double before = std::sqrt(inner(error, matrix.times(matrix.diagonal, error)));
  for (int cycle = 0; cycle < 4; ++cycle) {
    const Matrix::Vector step = applied_there(there, *device, matrix.times(matrix.diagonal, error));
    for (size_t p = 0; p < error.size(); ++p) error[p] = error[p] - step[p];
  }
  EXPECT_LT(std::sqrt(inner(error, matrix.times(matrix.diagonal, error))), 0.05 * before);
}

INSTANTIATE_TEST_SUITE_P(Devices, MultigridOnDevice, testing::Values("fake", "cuda"), [](const auto& info) { return std::string(info.param); });

// Two bars side by side, closer than any coarse cell, are joined at one end only: what moves them apart must not be lost on coarse grids.
TEST(Multigrid, KeepsApartWhatHangsTogetherElsewhere) {
  std::vector<GridPlace> places;
  std::vector<std::array<uint32_t, 2>> edges;
  const int length_of_bar = 120;
  for (int x = 0; x < length_of_bar; ++x)
    for (int bar = 0; bar < 2; ++bar)
      for (int y = 0; y < 2; ++y)
        for (int z = 0; z < 2; ++z) places.push_back({8 * x, 8 * (2 * bar + y), 8 * z});
  for (uint32_t a = 0; a < places.size(); ++a)
    for (uint32_t b = a + 1; b < places.size() && b < a + 17; ++b) {
      int far = 0;
      for (size_t k = 0; k < 3; ++k) far = std::max(far, std::abs(places[a][k] - places[b][k]));
      const bool same_bar = (places[a][1] < 16) == (places[b][1] < 16);
      if (far <= 8 && (same_bar || (places[a][0] == 0 && places[b][0] == 0))) edges.push_back({a, b});
    }
  Matrix matrix(TetMesh{});
  matrix.places = places;
  matrix.edges = edges;
  matrix.free.assign(places.size(), 1.0f);
  matrix.entries.assign(edges.size(), -1.0f);
  matrix.diagonal.assign(places.size(), 1e-4f);
  for (const auto& [a, b] : edges) matrix.diagonal[a] += 1, matrix.diagonal[b] += 1;
  const auto metric = matrix.multigrid(*matrix.executor);
  ASSERT_GE(metric->levels(), 2u);
  EXPECT_LT(worst_factor(matrix, *metric, matrix.diagonal), 0.45);
}

TEST(Multigrid, TakesNoVerticesOneVertexAndNothingFree) {
  const auto executor = make_serial_executor();
  Matrix none{TetMesh{}};
  EXPECT_EQ(applied(*none.multigrid(*executor), *executor, {}).size(), 0u);
  Matrix one{TetMesh{}};
  one.places = {{3, 4, 5}};
  one.free = {1};
  one.diagonal = {2};
  EXPECT_NEAR(applied(*one.multigrid(*executor), *executor, {{1, 2, -3}})[0].z, -1.5, 1e-4);
  Matrix pinned(sphere(4, 3, 2));
  std::fill(pinned.free.begin(), pinned.free.end(), 0.0f);
  std::fill(pinned.entries.begin(), pinned.entries.end(), 0.0f);
  std::fill(pinned.diagonal.begin(), pinned.diagonal.end(), 1.0f);
  for (const Vec3d& x : applied(*pinned.multigrid(*executor), *executor, pinned.random(1))) ASSERT_EQ(length(x), 0);
}

struct Pressed {
  std::unique_ptr<Executor> executor = make_cpu_executor(2);
  TetBuild built;
  Sdf ball;
  std::vector<float> pins;

  explicit Pressed(int depth) {
    std::vector<std::string> warnings;
    TetBuildOptions options;
    options.max_depth = depth;
    options.min_depth = 3;
    const Surface surface = make_sphere(1, 3);
    built = build_tets(surface, options, *executor, warnings);
    SdfPlan plan;
    plan.voxel_size = 0.03;
    plan.lower = {-0.5, -0.5, -0.5};
    plan.upper = {0.5, 0.5, 0.5};
    ball = build_sdf(*executor, plan, [](const Vec3d& p, uint32_t&) { return length(p) - 0.5; });
    ball.placement.translation = {0.05, 1.12, 0.02};
    for (const Vec3f& p : surface.points.host()) pins.push_back(p.y < -0.8f ? 1.0f : 0.0f);
  }

  Buffer<Vec3f> by(MetricKind kind, double poisson, bool pinned, EquilibriumFigures& figures, double limit = 4e9) {
    EquilibriumMaterial material;
    const Buffer<float> weights(pins);
    material.metric = kind;
    material.poisson_ratio = poisson;
    material.memory_limit = limit;
    if (pinned) material.pins = &weights;
    const auto rest = prepare_equilibrium(*executor, built.tets, built.lattice, material);
    of_rest = figures_of(*rest);
    EquilibriumSettings settings;
    settings.max_iterations = 300;
    settings.gradient = 1e-4;
    settings.penetration = 1e-5;
    const std::vector<const Sdf*> colliders{&ball};
    return map_to_surface(*executor, solve_equilibrium(*executor, *rest, built.lattice.rest.placement, colliders, settings, figures), built.lattice);
  }
  RestFigures of_rest;
};

TEST(Multigrid, EndsAtTheShapeThatTheFactorEndsAt) {
  Pressed pressed(5);
  for (const bool pinned : {false, true}) {
    EquilibriumFigures exact, cycle;
    const Buffer<Vec3f> a = pressed.by(MetricKind::kFactor, 0.45, pinned, exact), b = pressed.by(MetricKind::kMultigrid, 0.45, pinned, cycle);
    EXPECT_EQ(exact.ended, "rest");
    EXPECT_EQ(cycle.ended, "rest");
    EXPECT_LT(cycle.iterations, 1.3 * exact.iterations);
    double dent = 0, apart = 0;
    for (size_t i = 0; i < a.size(); ++i) {
      dent = std::max(dent, static_cast<double>(length(a.host()[i] - pressed.built.lattice.rest.points.host()[i])));
      apart = std::max(apart, static_cast<double>(length(a.host()[i] - b.host()[i])));
    }
    EXPECT_GT(dent, 0.2);
    EXPECT_LT(apart, 0.002 * dent) << "pinned " << pinned << ": of the dent's depth " << apart / dent;
  }
}

TEST(Multigrid, TakesOverWhereTheFactorWouldNotFit) {
  Pressed pressed(5);
  EquilibriumFigures figures;
  pressed.by(MetricKind::kAuto, 0.45, false, figures);
  EXPECT_EQ(pressed.of_rest.metric, "factor");
  const double too_little = 0.9 * pressed.of_rest.metric_bytes;
  EXPECT_THROW(pressed.by(MetricKind::kFactor, 0.45, false, figures, too_little), Error);
  pressed.by(MetricKind::kAuto, 0.45, false, figures, too_little);
  EXPECT_EQ(pressed.of_rest.metric, "multigrid");
  EXPECT_EQ(figures.ended, "rest");
  EXPECT_LT(pressed.of_rest.metric_bytes, too_little);
  EXPECT_THROW(pressed.by(MetricKind::kMultigrid, 0.45, false, figures, 0.1 * pressed.of_rest.metric_bytes), Error);
}

}  // namespace multigrid_test
}  // namespace knead
