#include <gtest/gtest.h>

#include <random>
#include <vector>

#include "kernels/history_body.h"
#include "kernels/parallel.h"

// The host sums pieces of rows by a way of its own (`over`), devices row by row: both must say the same, and leave the same behind.
namespace knead {
namespace history_test {

constexpr size_t kRows = 203;

std::vector<Row4> random_rows(size_t n, uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> at(-1, 1);
  std::vector<Row4> rows(n);
  for (Row4& r : rows) r = {at(random), at(random), at(random), 0};
  return rows;
}

void expect_equal(const HistoryDots& a, const HistoryDots& b) {
  constexpr double kRounding = 1e-4;
  for (uint32_t k = 0; k < History::kMost; ++k) EXPECT_NEAR(a.of[k], b.of[k], kRounding) << k;
  EXPECT_NEAR(a.steps, b.steps, kRounding);
  EXPECT_NEAR(a.changes, b.changes, kRounding);
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
  std::vector<Row4> steps = random_rows(History::kMost * kRows, 1), changes = random_rows(History::kMost * kRows, 2);
  std::vector<Row4> a = random_rows(kRows, 3), b = random_rows(kRows, 4), c = random_rows(kRows, 5), d = random_rows(kRows, 6);
  History history{};
  Ring ring{5, 2};  // round the end
  PairRows rows() { return {steps.data(), changes.data(), kRows}; }
};

TEST(History, RemembersAPairByRowAsByPiece) {
  Scene one, other;
  const auto body = [](Scene& s) {
    const size_t at = s.ring.newest * kRows;
    return RememberPair{s.rows(), s.ring, s.a.data(), s.b.data(), s.c.data(), s.d.data(), s.steps.data() + at, s.changes.data() + at, &s.history};
  };
  const HistoryDots dots = body(one).over(0, kRows);
  expect_equal(dots, by_row(body(other)));
  EXPECT_GT(dots.steps, 1);
  EXPECT_NE(dots.of[one.ring.slot(4)], 0);
  EXPECT_EQ(dots.of[3], 0) << "a slot without a pair";
  for (size_t p = 0; p < kRows; ++p) {
    EXPECT_EQ(one.steps[2 * kRows + p].y, other.steps[2 * kRows + p].y);
    EXPECT_EQ(one.changes[2 * kRows + p].z, one.d[p].z - one.c[p].z);
  }
}

TEST(History, SumsBothLoopsByRowAsByPiece) {
  Scene one, other;
  const auto first = [](Scene& s) { return FirstLoop{s.rows(), s.ring, s.a.data(), &s.history}; };
  expect_equal(first(one).over(0, kRows), by_row(first(other)));
  one.history.bulk = other.history.bulk = 0.3;
  const auto second = [](Scene& s) { return SecondLoop{s.rows(), s.ring, s.b.data(), s.c.data(), &s.history, 0.7f}; };
  expect_equal(second(one).over(0, kRows), by_row(second(other)));
  for (size_t p = 0; p < kRows; ++p) EXPECT_EQ(one.c[p].x, other.c[p].x);
  EXPECT_NEAR(one.c[7].x, 0.7f * (Scene().c[7].x - 0.3f * one.b[7].x), 1e-6f);
}

TEST(History, SumsPiecesOfAnyLength) {
  Scene s;
  const BulkAlong along{s.a.data(), s.b.data(), &s.history};
  expect_equal(along.over(0, kRows), by_row(along));
  for (const size_t cut : {size_t{1}, size_t{6}, size_t{101}}) expect_equal(along.over(0, cut) + along.over(cut, kRows), by_row(along));
  const BulkOver over{s.a.data(), s.b.data(), 1, &s.history};
  expect_equal(over.over(0, kRows), by_row(over));
}

}  // namespace history_test
}  // namespace knead
