#include "kernels/sparse_cholesky.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cstring>
#include <random>

#include "graph/error.h"
#include "kernels/energy_lanes.h"
#include "kernels/simd_level.h"

namespace knead {
namespace sparse_cholesky_test {

// A box of points joined to their neighbours, diagonals too.
struct Box {
  std::vector<Vec3f> points;
  std::vector<std::array<uint32_t, 2>> edges;
  explicit Box(int n) {
    for (int z = 0; z < n; ++z)
      for (int y = 0; y < n; ++y)
        for (int x = 0; x < n; ++x) points.push_back({static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)});
    for (uint32_t a = 0; a < points.size(); ++a)
      for (uint32_t b = a + 1; b < points.size(); ++b)
        if (length(points[a] - points[b]) < 1.5f) edges.push_back({a, b});
  }
};

TEST(NestedDissection, OrdersEveryVertexOnceAndJoinsOnlyAncestors) {
  const Box box(7);
  const Dissection found = nested_dissection(box.points, box.edges, 12);
  std::vector<uint32_t> place(box.points.size(), 9999), node(box.points.size());
  for (uint32_t p = 0; p < found.order.size(); ++p) {
    EXPECT_EQ(place[found.order[p]], 9999u);
    place[found.order[p]] = p;
  }
  uint32_t next = 0;
  for (uint32_t n = 0; n < found.nodes.size(); ++n) {
    EXPECT_EQ(found.nodes[n].first, next);
    next += found.nodes[n].count;
    if (found.nodes[n].parent != DissectionNode::kNone) EXPECT_GT(found.nodes[n].parent, n);
    for (uint32_t i = found.nodes[n].first; i < next; ++i) node[i] = n;
  }
  EXPECT_EQ(next, box.points.size());
  for (const auto& [a, b] : box.edges) {
    uint32_t low = node[std::min(place[a], place[b])];
    const uint32_t high = node[std::max(place[a], place[b])];
    while (low < high) low = found.nodes[low].parent;
    EXPECT_EQ(low, high) << "an edge between separated parts";
  }
}

TEST(NestedDissection, TakesNoVerticesOneVertexAndParts) {
  EXPECT_TRUE(nested_dissection({}, {}, 4).order.empty());
  const std::vector<Vec3f> one{{0, 0, 0}};
  EXPECT_EQ(nested_dissection(one, {}, 4).order.size(), 1u);
  const std::vector<Vec3f> same(50, Vec3f{1, 2, 3});
  EXPECT_EQ(nested_dissection(same, {}, 4).order.size(), 50u);
  std::vector<Vec3f> line;
  for (int i = 0; i < 40; ++i) line.push_back({static_cast<float>(i), 0, 0});
  EXPECT_EQ(nested_dissection(line, {}, 4).order.size(), 40u);
}

void expect_solves(int n, uint32_t leaf) {
  const Box box(n);
  const Dissection dissection = nested_dissection(box.points, box.edges, leaf);
  const size_t size = box.points.size();
  std::vector<uint32_t> place(size);
  for (uint32_t p = 0; p < size; ++p) place[dissection.order[p]] = p;
  std::mt19937 random(1);
  std::uniform_real_distribution<double> part(0.1, 1);
  std::vector<std::array<uint32_t, 2>> edges;
  std::vector<float> entries, diagonal(size, 0.01f);
  Eigen::MatrixXd dense = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(size), static_cast<Eigen::Index>(size));
  for (const auto& [a, b] : box.edges) {
    const float w = static_cast<float>(part(random));
    edges.push_back({place[a], place[b]});
    entries.push_back(-w);
    dense(place[a], place[b]) = dense(place[b], place[a]) = -w;
    diagonal[place[a]] += w;
    diagonal[place[b]] += w;
  }
  for (size_t i = 0; i < size; ++i) dense(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(i)) = diagonal[i];
  const auto executor = make_cpu_executor(2);
  const auto plan = std::make_shared<const FactorPlan>(dissection, edges);
  const SparseCholesky factor(*executor, energy_lanes(*executor), plan, entries, diagonal);
  Eigen::MatrixXd right = Eigen::MatrixXd::Random(static_cast<Eigen::Index>(size), 3);
  const Eigen::MatrixXd exact = dense.llt().solve(right);
  for (const EnergyLanes* lanes : {energy_lanes_scalar(), &energy_lanes(*executor)}) {
    Buffer<Row4> x(factor.solve_rows());
    for (size_t i = 0; i < size; ++i) {
      const auto k = static_cast<Eigen::Index>(i);
      x.data_for_write()[i] = {static_cast<float>(right(k, 0)), static_cast<float>(right(k, 1)), static_cast<float>(right(k, 2)), 0};
    }
    std::vector<float> scratch(factor.scratch_floats());
    factor.solve(*executor, *lanes, x.data_for_write(), scratch.data());
    double error = 0;
    for (size_t i = 0; i < size; ++i)
      for (int d = 0; d < 3; ++d)
        error = std::max(error, std::abs(static_cast<double>((&x.host()[i].x)[d]) - exact(static_cast<Eigen::Index>(i), d)));
    EXPECT_LT(error, 2e-5 * exact.cwiseAbs().maxCoeff()) << "n " << n << " leaf " << leaf;
  }
}

TEST(SparseCholesky, SolvesAsADenseFactorDoes) {
  expect_solves(1, 4);
  expect_solves(3, 4);
  expect_solves(6, 16);
  expect_solves(9, 8);
  expect_solves(7, 1000);  // one node of several panels
  expect_solves(11, 16);  // several subtrees at once
}

TEST(SparseCholesky, IsTheSameFactorWhenOnlyThePartThatChangedIsMadeAnew) {
  const Box box(8);
  const Dissection dissection = nested_dissection(box.points, box.edges, 8);
  std::vector<uint32_t> place(box.points.size());
  for (uint32_t p = 0; p < place.size(); ++p) place[dissection.order[p]] = p;
  std::vector<std::array<uint32_t, 2>> edges;
  for (const auto& [a, b] : box.edges) edges.push_back({place[a], place[b]});
  std::vector<float> diagonal(box.points.size(), 30), other;
  const auto plan = std::make_shared<const FactorPlan>(dissection, edges);
  const std::vector<float> entries(edges.size(), -1.0f);
  for (const auto& executor : {make_serial_executor(), make_cpu_executor(2)}) {
    const EnergyLanes& lanes = energy_lanes(*executor);
    const SparseCholesky before(*executor, lanes, plan, entries, diagonal);
    other = diagonal;
    for (const uint32_t p : {3u, 4u, 200u}) other[p] = 77;
    const SparseCholesky renewed(*executor, lanes, before, other), whole(*executor, lanes, plan, entries, other);
    std::vector<float> scratch(whole.scratch_floats());
    Buffer<Row4> x(whole.solve_rows()), y(whole.solve_rows());
    for (uint32_t p = 0; p < diagonal.size(); ++p) x.data_for_write()[p] = y.data_for_write()[p] = {1, static_cast<float>(p % 7), -2, 0};
    renewed.solve(*executor, lanes, x.data_for_write(), scratch.data());
    whole.solve(*executor, lanes, y.data_for_write(), scratch.data());
    EXPECT_EQ(std::memcmp(x.host().data(), y.host().data(), diagonal.size() * sizeof(Row4)), 0);
  }
}

TEST(SparseCholesky, RefusesAMatrixThatIsNotPositive) {
  const Box box(2);
  const Dissection dissection = nested_dissection(box.points, box.edges, 100);
  const std::vector<float> entries(box.edges.size(), -1.0f), diagonal(box.points.size(), 0.5f);
  const auto executor = make_serial_executor();
  const auto plan = std::make_shared<const FactorPlan>(dissection, box.edges);
  EXPECT_THROW(SparseCholesky(*executor, energy_lanes(*executor), plan, entries, diagonal), Error);
}

}  // namespace sparse_cholesky_test
}  // namespace knead
