#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

#include "kernels/build_tets/build_tets.h"
#include "kernels/equilibrium/rest_tables.h"
#include "kernels/shapes/primitives.h"

namespace knead {
namespace shape_hessian_test {

struct Ball {
  std::unique_ptr<Executor> executor = make_cpu_executor(2);
  BuiltTets built;
  std::shared_ptr<const EquilibriumRest> rest;
  ShapeHessian shape;

  Ball() {
    std::vector<std::string> warnings;
    BuildTetsOptions options;
    options.max_depth = 5;
    options.min_depth = 3;
    built = build_tets(make_sphere(1, 3), options, *executor, warnings);
    EquilibriumMaterial material;
    material.hold = 0;
    rest = prepare_equilibrium(*executor, built.tets, built.lattice, material);
  }
  // Displaced so that x goes to move(x), in cells.
  template <class Move>
  void follow(const Move& move) {
    std::vector<Row4> u(rest->rows, Row4{0, 0, 0, 0});
    for (uint32_t p = 0; p < rest->vertices; ++p) {
      const Vec3f x = rest->rest.host()[rest->vertex_at[p]];
      u[p] = to_row(move(x) - x);
    }
    rest->follow(*executor, u.data(), static_cast<float>(MetricConstants{}.tolerance), shape);
  }
  size_t changed() const {
    size_t sum = 0;
    for (const uint8_t is : shape.changed.host()) sum += is;
    return sum;
  }
};

template <class T>
bool same(const Buffer<T>& a, const Buffer<T>& b) {
  return a.size() == b.size() && std::memcmp(a.host().data(), b.host().data(), a.bytes()) == 0;
}

// What follows from the entries is what it would be had all of it been made anew.
void expect_complete(const Ball& ball) {
  const auto copy = [](const Buffer<float>& from) { return Buffer<float>(from.host()); };
  const Hessian& now = ball.shape.now;
  const Hessian whole = make_hessian(*ball.executor, *ball.rest->grids, copy(now.entries), copy(now.diagonal));
  EXPECT_TRUE(same(now.coarse_entries, whole.coarse_entries));
  EXPECT_TRUE(same(now.coarse_diagonal, whole.coarse_diagonal));
}

TEST(ShapeHessian, StaysThatOfTheRestShapeWhereNothingMoves) {
  Ball ball;
  ball.follow([](const Vec3f& x) { return x + Vec3f{3, 1, 2}; });
  EXPECT_EQ(ball.changed(), 0u);
  EXPECT_TRUE(same(ball.shape.now.entries, ball.rest->hessian.entries));
  EXPECT_TRUE(same(ball.shape.now.diagonal, ball.rest->hessian.diagonal));
  EXPECT_TRUE(same(ball.shape.now.coarse_entries, ball.rest->hessian.coarse_entries));
}

TEST(ShapeHessian, TurnsWithTheBody) {
  Ball ball;
  ball.follow([](const Vec3f& x) { return Vec3f{-x.y, x.x, x.z}; });
  EXPECT_EQ(ball.changed(), ball.rest->vertices);
  const auto before = ball.rest->hessian.diagonal.host(), now = ball.shape.now.diagonal.host();
  constexpr size_t kFrom[3] = {1, 0, 2};  // x' = -y, y' = x
  constexpr float kSign[3] = {-1, 1, 1};
  for (size_t p = 0; p < ball.rest->vertices; ++p)
    for (size_t c = 0; c < 3; ++c)
      for (size_t r = 0; r < 3; ++r) {
        const float expected = kSign[r] * kSign[c] * before[kBlock * p + 3 * kFrom[c] + kFrom[r]];
        ASSERT_NEAR(now[kBlock * p + 3 * c + r], expected, 1e-4f * before[kBlock * p]) << p;
      }
  expect_complete(ball);
}

TEST(ShapeHessian, ChangesWhereTheBodyDoesAndNowhereElse) {
  Ball ball;
  float lowest = 1e30f, highest = -1e30f;
  for (const Vec3f& x : ball.rest->rest.host()) lowest = std::min(lowest, x.y), highest = std::max(highest, x.y);
  const float from = highest - 0.2f * (highest - lowest);
  const auto dent = [&](float depth) { return [=](const Vec3f& x) { return x.y > from ? Vec3f{x.x, x.y - depth * (x.y - from), x.z} : x; }; };
  ball.follow(dent(0.3f));
  const size_t rows = ball.changed();
  EXPECT_GT(rows, 0u);
  EXPECT_LT(rows, ball.rest->vertices / 2);
  const auto before = ball.rest->hessian.diagonal.host(), now = ball.shape.now.diagonal.host();
  for (size_t p = 0; p < ball.rest->vertices; ++p) {
    const bool is_same = std::memcmp(&before[kBlock * p], &now[kBlock * p], kBlock * sizeof(float)) == 0;
    ASSERT_EQ(is_same, ball.shape.changed.host()[p] == 0) << p;
  }
  expect_complete(ball);
  ball.follow(dent(0.31f));  // nearly the same
  EXPECT_EQ(ball.changed(), 0u);
  ball.follow(dent(0));
  EXPECT_GT(ball.changed(), rows * 4 / 5);
  const auto back = ball.shape.now.diagonal.host();
  for (size_t k = 0; k < back.size(); ++k) ASSERT_NEAR(back[k], before[k], 0.2f * before[k / kBlock * kBlock]);
  expect_complete(ball);
}

}  // namespace shape_hessian_test
}  // namespace knead
