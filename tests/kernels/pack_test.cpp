#include "kernels/pack.h"

#include <gtest/gtest.h>

#include <vector>

#include "kernels/loop/lattice_map_body.h"

namespace {

using knead::Lane;
using knead::Vec3f;

// Vector code at the level of this test's own flags; the wider levels are compared through simd_level in the kernels' tests.
#if defined(__SSE2__)
constexpr int kWidth = 4;
#endif

std::vector<Vec3f> pack_test_rows(size_t n) {
  std::vector<Vec3f> rows(n);
  for (size_t i = 0; i < n; ++i) rows[i] = {static_cast<float>(i), static_cast<float>(i) + 0.25f, -static_cast<float>(i)};
  return rows;
}

#if defined(__SSE2__)
TEST(Pack, GathersRowsOfVectorsInLaneOrder) {
  using F = knead::Pack<kWidth>;
  const std::vector<Vec3f> rows = pack_test_rows(41);  // one more than is asked for: rows are over-read by four bytes
  const uint32_t indices[kWidth] = {39, 0, 7, 7};
  const knead::Vec3<F> got = Lane<F>::rows(rows.data(), indices);
  for (int l = 0; l < kWidth; ++l)
    for (int k = 0; k < 3; ++k) EXPECT_EQ(got[k][l], rows[indices[l]][k]) << "lane " << l << " component " << k;
}

TEST(Pack, GathersAndLoadsNumbers) {
  using F = knead::Pack<kWidth>;
  const float values[] = {1, 2, 4, 8, 16, 32};
  const uint32_t indices[kWidth] = {5, 0, 0, 3};
  const F gathered = Lane<F>::gather(values, indices), loaded = Lane<F>::load(values + 1);
  for (int l = 0; l < kWidth; ++l) {
    EXPECT_EQ(gathered[l], values[indices[l]]);
    EXPECT_EQ(loaded[l], values[l + 1]);
  }
}

TEST(Pack, WritesNoMoreRowsThanAsked) {
  using F = knead::Pack<kWidth>;
  std::vector<Vec3f> rows = pack_test_rows(8);
  const uint32_t indices[kWidth] = {6, 2, 4, 5};
  const F x = Lane<F>::all(100);
  Lane<F>::put_rows(rows.data(), indices, 2, {x, x + 1.0f, x + 2.0f});
  const std::vector<Vec3f> before = pack_test_rows(8);
  for (uint32_t i = 0; i < 8; ++i) {
    const bool written = i == 6 || i == 2;
    EXPECT_EQ(rows[i].x, written ? 100 : before[i].x) << i;
    EXPECT_EQ(rows[i].z, written ? 102 : before[i].z) << i;
  }
}

TEST(Pack, RootsAreCorrectlyRounded) {
  using F = knead::Pack<kWidth>;
  const float values[] = {0, 2, 1e-30f, 12345.678f};
  const F got = Lane<F>::root(Lane<F>::load(values));
  for (int l = 0; l < kWidth; ++l) EXPECT_EQ(got[l], std::sqrt(values[l]));
}
#endif

TEST(Pack, ZeroStepsKeepNegativeZeros) {
  const Vec3f x{-0.0f, 0.0f, 3};
  const Vec3f same = knead::moved(x, Vec3f{0, -0.0f, 0});
  EXPECT_TRUE(std::signbit(same.x));
  EXPECT_FALSE(std::signbit(same.y));
  EXPECT_EQ(same.z, 3);
}

TEST(Pack, ClampsLongVectorsAlone) {
  const Vec3f inside = knead::clamped(Vec3f{0.3f, 0, 0.4f}, 0.5f), outside = knead::clamped(Vec3f{0, -3, 4}, 0.5f),
              zero = knead::clamped(Vec3f{0, 0, 0}, 0.0f);
  EXPECT_NEAR(length(inside), 0.5f, 1e-6f);
  EXPECT_EQ(inside.y, 0);
  EXPECT_NEAR(outside.y, -0.3f, 1e-6f);
  EXPECT_NEAR(outside.z, 0.4f, 1e-6f);
  EXPECT_EQ(zero.x, 0);
  EXPECT_EQ(knead::clamped(Vec3f{1, 1, 1}, 0.0f).x, 0);
}

}  // namespace
