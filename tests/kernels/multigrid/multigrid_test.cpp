#include "kernels/multigrid/multigrid.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <random>

#include "graph/error.h"
#include "io/vdb/vdb.h"
#include "kernels/build_tets/build_tets.h"
#include "kernels/equilibrium/energy_simd.h"
#include "kernels/equilibrium/equilibrium.h"
#include "kernels/loop/lattice_map.h"
#include "kernels/shapes/primitives.h"

namespace knead {
namespace multigrid_test {

using Block = std::array<double, kBlock>;  // columns one after the other

// Linear elasticity of H (lambda = 9 mu, a Poisson's ratio of 0.45) with a weak hold, in an order of its own; vertices in the lowest part may be pinned.
struct Matrix {
  std::unique_ptr<Executor> executor = make_cpu_executor(2);
  std::vector<GridPosition> places;
  std::vector<std::array<uint32_t, 2>> edges;  // of free vertices
  std::vector<Block> entries, diagonal;        // by edge, row the lower vertex; by vertex
  std::vector<float> free;

  explicit Matrix(const TetMesh& mesh, bool pinned = false) : free(mesh.vertices(), 1.0f) {
    const auto x = mesh.rest.host();
    std::vector<GridPosition> by_vertex;
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
      if (free[a] != 0 && free[b] != 0) edges.push_back({a, b});
    }
    std::sort(edges.begin(), edges.end());
    entries.assign(edges.size(), Block{});
    diagonal.assign(order.size(), Block{});
    for (const auto& tet : mesh.tets.host()) {
      const Vec3d a = to_double(x[tet[0]]), e1 = to_double(x[tet[1]]) - a, e2 = to_double(x[tet[2]]) - a, e3 = to_double(x[tet[3]]) - a;
      const double six = dot(e1, cross(e2, e3));
      const Vec3d g1 = (1 / six) * cross(e2, e3), g2 = (1 / six) * cross(e3, e1), g3 = (1 / six) * cross(e1, e2);
      const std::array<Vec3d, 4> n{-(g1 + g2 + g3), g1, g2, g3};
      for (size_t i = 0; i < 4; ++i) {
        add(diagonal[place[tet[i]]], six / 6 * dot(n[i], n[i]) + 1e-5 * six, six / 6 * 10 * n[i], n[i]);
        for (size_t j = 0; j < 4; ++j) {
          const uint32_t p = place[tet[i]], q = place[tet[j]];
          if (p >= q || free[p] == 0 || free[q] == 0) continue;
          const auto edge = std::lower_bound(edges.begin(), edges.end(), std::array<uint32_t, 2>{p, q});
          add(entries[static_cast<size_t>(edge - edges.begin())], six / 6 * dot(n[i], n[j]), six / 6 * 10 * n[i], n[j]);
        }
      }
    }
    for (uint32_t p = 0; p < places.size(); ++p)
      if (free[p] == 0) diagonal[p] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  }

  static void add(Block& to, double same, const Vec3d& left, const Vec3d& right) {
    for (int c = 0; c < 3; ++c)
      for (int r = 0; r < 3; ++r) to[static_cast<size_t>(3 * c + r)] += left[r] * right[c] + (r == c ? same : 0);
  }

  // Contacts on the upper side, which push along one direction each, `stiff` times what the diagonal is there.
  std::vector<Block> contacts(double stiff) const {
    int32_t highest = 0;
    for (const GridPosition& p : places) highest = std::max(highest, p[1]);
    std::vector<Block> added(places.size(), Block{});
    for (size_t p = 0; p < places.size(); ++p) {
      const Vec3d normal = (1 / std::sqrt(2.0)) * Vec3d{std::sin(0.1 * static_cast<double>(p)), 1, std::cos(0.1 * static_cast<double>(p))};
      if (5 * places[p][1] > 4 * highest && free[p] != 0) add(added[p], 0, stiff * static_cast<double>(1 + p % 3) * diagonal[p][4] * normal, normal);
    }
    return added;
  }

  static Buffer<float> floats(const std::vector<Block>& blocks) {
    Buffer<float> to(kBlock * blocks.size());
    float* out = to.data_for_write();
    for (const Block& block : blocks)
      for (const double v : block) *out++ = static_cast<float>(v);
    return to;
  }
  Hessian hessian(Executor& on, const MultigridGrids& grids) const {
    const SparseRows& pattern = grids.pattern();
    std::vector<Block> by_row(pattern.index.size());
    for (size_t e = 0; e < edges.size(); ++e) {
      const auto [p, q] = edges[e];
      const auto at = [&](uint32_t row, uint32_t column) -> Block& {
        const auto begin = pattern.index.begin() + pattern.offsets[row], end = pattern.index.begin() + pattern.offsets[row + 1];
        return by_row[static_cast<size_t>(std::lower_bound(begin, end, column) - pattern.index.begin())];
      };
      at(p, q) = entries[e];
      const Block& b = entries[e];
      at(q, p) = {b[0], b[3], b[6], b[1], b[4], b[7], b[2], b[5], b[8]};
    }
    return make_hessian(on, grids, floats(by_row), floats(diagonal));
  }

  using Vector = std::vector<Vec3d>;
  static Vec3d product(const Block& b, const Vec3d& v, bool transposed) {
    return transposed ? Vec3d{b[0] * v.x + b[1] * v.y + b[2] * v.z, b[3] * v.x + b[4] * v.y + b[5] * v.z, b[6] * v.x + b[7] * v.y + b[8] * v.z}
                      : Vec3d{b[0] * v.x + b[3] * v.y + b[6] * v.z, b[1] * v.x + b[4] * v.y + b[7] * v.z, b[2] * v.x + b[5] * v.y + b[8] * v.z};
  }
  Vector times(const std::vector<Block>& added, const Vector& x) const {
    Vector y(x.size());
    for (size_t p = 0; p < x.size(); ++p)
      y[p] = product(diagonal[p], x[p], false) + (added.empty() ? Vec3d{0, 0, 0} : product(added[p], x[p], false));
    for (size_t e = 0; e < edges.size(); ++e) {
      y[edges[e][0]] += product(entries[e], x[edges[e][1]], false);
      y[edges[e][1]] += product(entries[e], x[edges[e][0]], true);
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

// The grids, the matrix and what a cycle makes of vectors.
struct Cycle {
  Executor& on;
  MultigridGrids grids;
  Hessian hessian;

  Cycle(const Matrix& matrix, Executor& executor) : on(executor), grids(executor, matrix.places, matrix.edges, matrix.free) {
    hessian = matrix.hessian(executor, grids);
    grids.measure(executor, energy_simd(executor), hessian);
  }
  Buffer<Row4> solved(const std::vector<Block>& added, const Matrix::Vector& right, size_t grid = 0) const {
    const Buffer<float> contacts = Matrix::floats(added);
    const Multigrid metric(on, grids, hessian, added.empty() ? nullptr : contacts.host().data());
    Buffer<Row4> rows(grids.solve_rows()), work(grids.work_rows());
    Row4* x = rows.data_for_write();
    std::fill_n(x, rows.size(), Row4{0, 0, 0, 0});
    for (size_t p = 0; p < right.size(); ++p) x[p] = to_row(to_float(right[p]));
    metric.solve(on, energy_simd(on), x, work.data_for_write(), grid);
    return rows;
  }
  Matrix::Vector applied(const std::vector<Block>& added, const Matrix::Vector& right, size_t grid = 0) const {
    const Buffer<Row4> rows = solved(added, right, grid);
    Matrix::Vector x(right.size());
    for (size_t p = 0; p < x.size(); ++p) x[p] = to_double(to_vec(rows.host()[p]));
    return x;
  }
};

double inner(const Matrix::Vector& a, const Matrix::Vector& b) {
  double sum = 0;
  for (size_t i = 0; i < a.size(); ++i) sum += dot(a[i], b[i]);
  return sum;
}

TetMesh sphere(int depth, int least, int resolution, bool split = false) {
  std::vector<std::string> warnings;
  BuildTetsOptions options;
  options.max_depth = depth;
  options.min_depth = least;
  options.split_pieces = split;
  return build_tets(make_sphere(1, resolution), options, *make_cpu_executor(2), warnings).tets;
}

// The largest factor by which a cycle's error falls, after the first few, in the energy's norm.
double worst_factor(const Matrix& matrix, const Cycle& cycle, const std::vector<Block>& added) {
  Matrix::Vector error = matrix.random(7);
  double before = 0, worst = 0;
  for (int round = 0; round < 8; ++round) {
    const Matrix::Vector residual = matrix.times(added, error);
    const double now = std::sqrt(inner(error, residual));
    if (round > 0) worst = std::max(worst, now / before);
    before = now;
    const Matrix::Vector step = cycle.applied(added, residual);
    for (size_t p = 0; p < error.size(); ++p) error[p] = error[p] - step[p];
  }
  return worst;
}

TEST(Multigrid, IsSymmetricAndPositiveWithPinsAndContacts) {
  const Matrix matrix(sphere(5, 4, 4), true);
  const Cycle cycle(matrix, *matrix.executor);
  ASSERT_GE(cycle.grids.levels().size(), 3u);
  for (const std::vector<Block>& added : {std::vector<Block>{}, matrix.contacts(50)}) {
    for (uint32_t seed = 0; seed < 4; ++seed) {
      Matrix::Vector x = matrix.random(2 * seed + 1), y = matrix.random(2 * seed + 2);
      if (seed > 1)  // smooth ones, which only the coarse grids see
        for (size_t p = 0; p < x.size(); ++p) {
          const double at = static_cast<double>(matrix.places[p][seed % 3]) / 100;
          x[p] = static_cast<double>(matrix.free[p]) * Vec3d{std::sin(at), 1, at};
          y[p] = static_cast<double>(matrix.free[p]) * Vec3d{1, std::cos(at), 1};
        }
      const Matrix::Vector mx = cycle.applied(added, x), my = cycle.applied(added, y);
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
      const Cycle cycle(matrix, *matrix.executor);
      EXPECT_LT(worst_factor(matrix, cycle, {}), 0.8) << "depth " << c.depth << ", pinned " << pinned;
      EXPECT_LT(worst_factor(matrix, cycle, matrix.contacts(5)), 0.85) << "depth " << c.depth << ", pinned " << pinned << ", contacts";
    }
}

// The body then moves as that grid can and no otherwise: what is left asks for next to nothing of it, and for much of the finer ones.
TEST(Multigrid, MovesAsACoarseGridCan) {
  const Matrix matrix(sphere(5, 4, 4), true);
  const Cycle cycle(matrix, *matrix.executor);
  const std::vector<Block> added = matrix.contacts(50);
  for (size_t grid = 1; grid < cycle.grids.levels().size(); ++grid) {
    const Matrix::Vector x = matrix.random(1), y = matrix.random(2), mx = cycle.applied(added, x, grid), my = cycle.applied(added, y, grid);
    EXPECT_LT(std::abs(inner(x, my) - inner(y, mx)), 1e-5 * std::sqrt(inner(x, mx) * inner(y, my))) << "grid " << grid;
    for (size_t p = 0; p < x.size(); ++p)
      if (matrix.free[p] == 0) ASSERT_EQ(length(mx[p]), 0) << "a pinned vertex moves";
    Matrix::Vector left = x, sum = mx;
    for (int round = 0; round < 6; ++round) {
      const Matrix::Vector moved = matrix.times(added, sum);
      for (size_t p = 0; p < x.size(); ++p) left[p] = x[p] - moved[p];
      const Matrix::Vector more = cycle.applied(added, left, grid);
      for (size_t p = 0; p < x.size(); ++p) sum[p] += more[p];
    }
    EXPECT_LT(inner(left, cycle.applied(added, left, grid)), 0.02 * inner(x, mx)) << "grid " << grid;
    EXPECT_GT(inner(left, cycle.applied(added, left, grid - 1)), 0.2 * inner(x, mx)) << "grid " << grid;
  }
}

// What pushes on the finest grid must reach the others as if it had been in the matrix.
TEST(Multigrid, TakesContactsAsIfTheyWereInTheMatrix) {
  Matrix matrix(sphere(5, 3, 3));
  const std::vector<Block> added = matrix.contacts(20);
  const Cycle cycle(matrix, *matrix.executor);
  const Matrix::Vector right = matrix.random(3);
  const Matrix::Vector x = cycle.applied(added, right), without = cycle.applied({}, right);
  for (size_t p = 0; p < added.size(); ++p)
    for (size_t k = 0; k < kBlock; ++k) matrix.diagonal[p][k] += added[p][k];
  Cycle whole = cycle;
  whole.hessian = matrix.hessian(*matrix.executor, whole.grids);
  const Matrix::Vector y = whole.applied({}, right);
  double size = 0, apart = 0, difference = 0;
  for (size_t p = 0; p < x.size(); ++p) {
    size = std::max(size, length(x[p]));
    apart = std::max(apart, length(x[p] - y[p]));
    difference = std::max(difference, length(x[p] - without[p]));
  }
  EXPECT_LT(apart, 1e-4 * size);
  EXPECT_GT(difference, 0.05 * size) << "the contacts must matter";
}

TEST(Multigrid, IsTheSameBitsForAnyNumberOfThreads) {
  const Matrix matrix(sphere(6, 4, 4));
  const auto one = make_cpu_executor(1), two = make_cpu_executor(2);
  const Matrix::Vector right = matrix.random(5);
  const Buffer<Row4> a = Cycle(matrix, *one).solved(matrix.contacts(9), right), b = Cycle(matrix, *two).solved(matrix.contacts(9), right);
  EXPECT_EQ(std::memcmp(a.host().data(), b.host().data(), a.bytes()), 0);
}

// Two bars side by side, closer than any coarse cell, are joined at one end only: what moves them apart must not be lost on coarse grids.
TEST(Multigrid, KeepsApartWhatHangsTogetherElsewhere) {
  Matrix matrix(TetMesh{});
  const int length_of_bar = 120;
  for (int x = 0; x < length_of_bar; ++x)
    for (int bar = 0; bar < 2; ++bar)
      for (int y = 0; y < 2; ++y)
        for (int z = 0; z < 2; ++z) matrix.places.push_back({8 * x, 8 * (2 * bar + y), 8 * z});
  const std::vector<GridPosition>& places = matrix.places;
  for (uint32_t a = 0; a < places.size(); ++a)
    for (uint32_t b = a + 1; b < places.size() && b < a + 17; ++b) {
      int far = 0;
      for (size_t k = 0; k < 3; ++k) far = std::max(far, std::abs(places[a][k] - places[b][k]));
      const bool same_bar = (places[a][1] < 16) == (places[b][1] < 16);
      if (far <= 8 && (same_bar || (places[a][0] == 0 && places[b][0] == 0))) matrix.edges.push_back({a, b});
    }
  const auto same = [](double v) { return Block{v, 0, 0, 0, v, 0, 0, 0, v}; };
  matrix.free.assign(places.size(), 1.0f);
  matrix.entries.assign(matrix.edges.size(), same(-1));
  std::vector<double> sums(places.size(), 1e-4);
  for (const auto& [a, b] : matrix.edges) sums[a] += 1, sums[b] += 1;
  for (const double sum : sums) matrix.diagonal.push_back(same(sum));
  const Cycle cycle(matrix, *matrix.executor);
  ASSERT_GE(cycle.grids.levels().size(), 2u);
  EXPECT_LT(worst_factor(matrix, cycle, {}), 0.75);
}

TEST(Multigrid, TakesNoVerticesOneVertexAndNothingFree) {
  const auto executor = make_serial_executor();
  EXPECT_EQ(Cycle(Matrix{TetMesh{}}, *executor).applied({}, {}).size(), 0u);
  Matrix one{TetMesh{}};
  one.places = {{3, 4, 5}};
  one.free = {1};
  one.diagonal = {{2, 0, 0, 0, 2, 0, 0, 0, 2}};
  EXPECT_NEAR(Cycle(one, *executor).applied({}, {{1, 2, -3}})[0].z, -1.5, 1e-4);
  Matrix pinned(sphere(4, 3, 2));
  std::fill(pinned.free.begin(), pinned.free.end(), 0.0f);
  pinned.edges.clear();
  pinned.entries.clear();
  for (const Vec3d& x : Cycle(pinned, *executor).applied({}, pinned.random(1))) ASSERT_EQ(length(x), 0);
}

// Many bodies that touch nowhere have no grid that is coarse enough for an inverse.
TEST(Multigrid, TakesMoreBodiesThanAnInverseTakes) {
  Matrix matrix(TetMesh{});
  for (int body = 0; body < 400; ++body) {
    const uint32_t first = static_cast<uint32_t>(matrix.places.size());
    for (int x = 0; x < 2; ++x) matrix.places.push_back({8 * (10 * body + x), 0, 0});
    matrix.edges.push_back({first, first + 1});
    matrix.entries.push_back({-1, 0, 0, 0, -1, 0, 0, 0, -1});
  }
  matrix.free.assign(matrix.places.size(), 1.0f);
  matrix.diagonal.assign(matrix.places.size(), {1.5, 0, 0, 0, 1.5, 0, 0, 0, 1.5});
  EXPECT_LT(worst_factor(matrix, Cycle(matrix, *matrix.executor), {}), 0.5);
}

struct Pressed {
  std::unique_ptr<Executor> executor = make_cpu_executor(2);
  BuiltTets built;
  Sdf ball;

  explicit Pressed(int depth) {
    std::vector<std::string> warnings;
    BuildTetsOptions options;
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
  }

  Buffer<Vec3f> by(double poisson, EquilibriumFigures& figures, double limit = 4e9) {
    EquilibriumMaterial material;
    material.poisson_ratio = poisson;
    material.memory_limit = limit;
    const auto rest = prepare_equilibrium(*executor, built.tets, built.lattice, material);
    of_rest = figures_of(*rest);
    EquilibriumSettings settings;
    settings.max_iterations = 300;
    settings.threshold = 1e-4;
    settings.penetration = 1e-5;
    const std::vector<const Sdf*> colliders{&ball};
    return map_to_surface(*executor, solve_equilibrium(*executor, *rest, built.lattice.rest.placement, colliders, settings, figures), built.lattice);
  }
  RestFigures of_rest;
};

// The material that is hardest on a metric: nearly incompressible.
TEST(Multigrid, LetsTheEquilibriumConvergeWhateverPoissonsRatio) {
  Pressed pressed(5);
  for (const double poisson : {0.0, 0.3, 0.45, 0.49}) {
    EquilibriumFigures figures;
    pressed.by(poisson, figures);
    EXPECT_EQ(figures.ended, Ended::kAtRest) << poisson;
    EXPECT_LT(figures.iterations, 60) << poisson;
  }
}

TEST(Multigrid, IsRefusedWhereItWouldNotFit) {
  Pressed pressed(5);
  EquilibriumFigures figures;
  pressed.by(0.45, figures);
  EXPECT_GT(pressed.of_rest.metric_bytes, 0);
  EXPECT_THROW(pressed.by(0.45, figures, 0.1 * pressed.of_rest.metric_bytes), Error);
  const double expected = MultigridGrids::expected_bytes(pressed.of_rest.vertices, pressed.built.tets.edges.size());
  EXPECT_GT(expected, 0.9 * pressed.of_rest.metric_bytes);
  EXPECT_LT(expected, 2 * pressed.of_rest.metric_bytes);
}

}  // namespace multigrid_test
}  // namespace knead
