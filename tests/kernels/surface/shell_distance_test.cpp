#include "kernels/surface/shell_distance.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace knead {
namespace shell_distance_test {

// A square of side 2 in the plane z = 0, of 2 * pieces^2 triangles that face up or down.
ShellDistance square(int pieces, double thickness, bool up = true) {
  std::vector<Vec3f> points;
  std::vector<uint32_t> triangles;
  for (int i = 0; i <= pieces; ++i)
    for (int j = 0; j <= pieces; ++j) points.push_back({-1 + 2.0f * i / pieces, -1 + 2.0f * j / pieces, 0});
  for (int i = 0; i < pieces; ++i)
    for (int j = 0; j < pieces; ++j) {
      const uint32_t a = static_cast<uint32_t>(i * (pieces + 1) + j), b = a + static_cast<uint32_t>(pieces) + 1;
      for (const uint32_t v : {a, b, b + 1, a, b + 1, a + 1}) triangles.push_back(v);
    }
  if (!up)
    for (size_t t = 0; t < triangles.size(); t += 3) std::swap(triangles[t], triangles[t + 1]);
  return {points, triangles, thickness};
}

double to_square(const Vec3d& p) {
  const double x = std::max(0.0, std::abs(p.x) - 1), y = std::max(0.0, std::abs(p.y) - 1);
  return std::sqrt(x * x + y * y + p.z * p.z);
}

TEST(ShellDistance, IsTheDistanceFromTheSurfaceLessHalfTheThickness) {
  std::mt19937 random(2);
  std::uniform_real_distribution<double> coordinate(-2, 2);
  for (const double thickness : {0.0, 0.1, 0.6})
    for (const int pieces : {1, 7}) {
      const ShellDistance shell = square(pieces, thickness);
      for (int n = 0; n < 500; ++n) {
        const Vec3d p{coordinate(random), coordinate(random), coordinate(random)};
        const SignedDistance at = shell.signed_distance(p);
        ASSERT_NEAR(at.distance, to_square(p) - 0.5 * thickness, 1e-6);
        // Along the normal to the shell's skin.
        ASSERT_LT(length(p - at.distance * at.normal - at.point), 1e-6);
        ASSERT_NEAR(length(at.normal), 1, 1e-9);
      }
    }
}

TEST(ShellDistance, TellsTheSidesApartAndTheRimFromBoth) {
  for (const bool up : {true, false})
    for (const int pieces : {1, 7}) {
      const ShellDistance shell = square(pieces, 0, up);
      EXPECT_EQ(shell.side_of({0.3, 0.2, 0.5}), up ? 1 : -1);
      EXPECT_EQ(shell.side_of({0.3, 0.2, -0.5}), up ? -1 : 1);
      EXPECT_EQ(shell.side_of({1.3, 0.2, 0.1}), 0);
      EXPECT_EQ(shell.rim().size(), 3u * 4 * static_cast<size_t>(pieces));
    }
}

TEST(ShellDistance, TakesWhatIsBehindForInside) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> coordinate(-0.9, 0.9);
  for (const bool up : {true, false}) {
    const ShellDistance shell = square(7, 0, up);
    const int side = shell.side_of({0.1, 0, 0.5});
    uint32_t hint = ExactDistance::kNoHint;
    for (int n = 0; n < 500; ++n) {
      Vec3d p{coordinate(random), coordinate(random), coordinate(random)};
      if (std::abs(p.z) > 1 - std::max(std::abs(p.x), std::abs(p.y))) continue;
      ASSERT_NEAR(shell.from_side(p, side, hint), p.z, 1e-6);
      ASSERT_NEAR(shell.from_side(p, -side, hint), -p.z, 1e-6);
    }
    EXPECT_NEAR(shell.from_side({1.5, 0, -0.2}, side, hint), to_square({1.5, 0, -0.2}), 1e-6) << "past the rim";
  }
}

TEST(HalfSpaceDistance, IsTheHeight) {
  const HalfSpaceDistance floor;
  EXPECT_EQ(floor.signed_distance({3, -4, 0.5}).distance, 0.5);
  EXPECT_EQ(floor.signed_distance({3, -4, -2}).distance, -2);
  EXPECT_EQ(floor.signed_distance({3, -4, -2}).normal.z, 1);
  EXPECT_FALSE(floor.signed_distance({0, 0, 5}, 1).found());
}

}  // namespace shell_distance_test
}  // namespace knead
