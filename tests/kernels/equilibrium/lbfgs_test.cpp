#include <gtest/gtest.h>

#include <random>
#include <vector>

#include "kernels/equilibrium/lbfgs_body.h"
#include "kernels/parallel.h"

// The host sums pieces of rows by a way of its own (`over`), devices row by row: both must say the same, and leave the same behind.
namespace knead {
namespace lbfgs_test {

constexpr size_t kRows = 203;

std::vector<Row4> random_rows(size_t n, uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> at(-1, 1);
  std::vector<Row4> rows(n);
  for (Row4& r : rows) r = {at(random), at(random), at(random), 0};
  return rows;
}

void expect_equal(const LbfgsDots& a, const LbfgsDots& b) {
  constexpr double kRounding = 1e-4;
  for (uint32_t k = 0; k < LbfgsSums::kMost; ++k) EXPECT_NEAR(a.of[k], b.of[k], kRounding) << k;
  EXPECT_NEAR(a.steps, b.steps, kRounding);
  EXPECT_NEAR(a.changes, b.changes, kRounding);
  EXPECT_NEAR(a.steep, b.steep, kRounding);
}
void expect_equal(double a, double b) {
  EXPECT_NEAR(a, b, 1e-4);
}

template <class Body>
auto by_row(const Body& body) {
  SumOf<Body> sum{};
  for (uint32_t p = 0; p < kRows; ++p) sum = Body::combine(sum, body(p));
  return sum;
}

struct Scene {
  std::vector<Row4> steps = random_rows(LbfgsSums::kMost * kRows, 1), changes = random_rows(LbfgsSums::kMost * kRows, 2);
  std::vector<Row4> a = random_rows(kRows, 3), b = random_rows(kRows, 4), c = random_rows(kRows, 5), d = random_rows(kRows, 6);
  LbfgsSums sums{};
  LbfgsRing ring{5, 2};  // round the end
  PairRows rows() { return {steps.data(), changes.data(), kRows}; }
};

TEST(Lbfgs, RemembersAPairByRowAsByPiece) {
  Scene one, other;
  const auto body = [](Scene& s) {
    const size_t at = s.ring.newest * kRows;
    return RememberPair{s.rows(), s.ring, s.a.data(), s.b.data(), s.c.data(), s.d.data(), s.steps.data() + at, s.changes.data() + at, &s.sums, 0.5};
  };
  const LbfgsDots dots = body(one).over(0, kRows);
  expect_equal(dots, by_row(body(other)));
  EXPECT_GT(dots.steps, 1);
  EXPECT_NE(dots.of[one.ring.slot(4)], 0);
  EXPECT_EQ(dots.of[3], 0) << "a slot without a pair";
  for (size_t p = 0; p < kRows; ++p) {
    EXPECT_EQ(one.steps[2 * kRows + p].y, other.steps[2 * kRows + p].y);
    EXPECT_EQ(one.changes[2 * kRows + p].z, one.d[p].z - one.c[p].z);
  }
}

// Two iterations with the metric 1 on the energy sum of bend / 2 x^2, the second pair with a gradient that bends as `bend` says: s . y over s . B s.
double curvature_after(float bend) {
  std::vector<Row4> steps(LbfgsSums::kMost * kRows), changes(LbfgsSums::kMost * kRows);
  const std::vector<Row4> x0 = random_rows(kRows, 1);
  std::vector<Row4> x = x0, g = x0, next(kRows), next_gradient(kRows), d(kRows);
  LbfgsSums sums{};
  LbfgsRing ring{0, LbfgsSums::kMost - 1};
  const PairRows rows{steps.data(), changes.data(), kRows};
  const double along = 0.5;
  double slope = 0;
  for (int iteration = 0; iteration < 2; ++iteration) {
    const float bent = iteration == 0 ? 0.8f : bend;
    FirstLoop first{rows, ring, g.data(), &sums};
    first.finish(by_row(first));
    for (uint32_t p = 0; p < kRows; ++p) WithoutChanges{rows, ring, g.data(), &sums, d.data()}(p);
    SecondLoop second{rows, ring, nullptr, d.data(), &sums, 1};
    second.finish(by_row(second));
    Downhill down{rows, ring, &sums, g.data(), d.data(), &slope};
    down.finish(by_row(down));
    for (uint32_t p = 0; p < kRows; ++p) {
      next[p] = to_row(to_vec(x[p]) + static_cast<float>(along) * to_vec(d[p]));
      next_gradient[p] = to_row(to_vec(g[p]) + bent * (to_vec(next[p]) - to_vec(x[p])));
    }
    ring = {ring.pairs + 1, (ring.newest + 1) % LbfgsSums::kMost};
    const size_t at = ring.newest * kRows;
    RememberPair pair{rows, ring, x.data(), next.data(), g.data(), next_gradient.data(), steps.data() + at, changes.data() + at, &sums, along};
    pair.finish(by_row(pair));
    for (uint32_t p = 0; p < kRows; ++p) DampPair{changes.data() + at, g.data(), &sums}(p);
    if (iteration == 1) break;
    x = next;
    g = next_gradient;
  }
  // What was told of the products is what the rows have.
  for (uint32_t age = 0; age < ring.pairs; ++age) {
    const uint32_t i = ring.slot(age);
    EXPECT_NEAR(sums.sy[i][ring.newest], product(rows.step(i), rows.change(ring.newest), 0, kRows), 1e-4 * std::abs(slope)) << bend;
  }
  EXPECT_NEAR(sums.over[ring.newest] * sums.sy[ring.newest][ring.newest], 1, 1e-9) << bend;
  return sums.sy[ring.newest][ring.newest] / (-along * along * slope);
}

TEST(Lbfgs, APairSaysAtLeastAPartOfTheMetricsCurvature) {
  EXPECT_NEAR(curvature_after(0.8f), 1, 1e-3);  // as the first pair said
  EXPECT_NEAR(curvature_after(0.4f), 0.5, 1e-3);
  EXPECT_NEAR(curvature_after(0.04f), LbfgsSums::kLeastCurvature, 1e-3);
  EXPECT_NEAR(curvature_after(-2.0f), LbfgsSums::kLeastCurvature, 1e-3);
}

TEST(Lbfgs, SumsBothLoopsByRowAsByPiece) {
  Scene one, other;
  const auto first = [](Scene& s) { return FirstLoop{s.rows(), s.ring, s.a.data(), &s.sums}; };
  expect_equal(first(one).over(0, kRows), by_row(first(other)));
  one.sums.volume = other.sums.volume = 0.3;
  const auto second = [](Scene& s) { return SecondLoop{s.rows(), s.ring, s.b.data(), s.c.data(), &s.sums, 0.7f}; };
  expect_equal(second(one).over(0, kRows), by_row(second(other)));
  for (size_t p = 0; p < kRows; ++p) EXPECT_EQ(one.c[p].x, other.c[p].x);
  EXPECT_NEAR(one.c[7].x, 0.7f * (Scene().c[7].x - 0.3f * one.b[7].x), 1e-6f);
}

TEST(Lbfgs, SumsPiecesOfAnyLength) {
  Scene s;
  const VolumeTermPart along{s.a.data(), s.b.data(), &s.sums};
  expect_equal(along.over(0, kRows), by_row(along));
  for (const size_t cut : {size_t{1}, size_t{6}, size_t{101}}) expect_equal(along.over(0, cut) + along.over(cut, kRows), by_row(along));
  const VolumeTermScale over{s.a.data(), s.b.data(), 1, &s.sums};
  expect_equal(over.over(0, kRows), by_row(over));
}

}  // namespace lbfgs_test
}  // namespace knead
