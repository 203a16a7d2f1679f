#include "kernels/surface/triangle_box.h"

#include <gtest/gtest.h>

#include <random>
#include <vector>

namespace knead {
namespace triangle_box_test {

// The oracle cuts the triangle down to the box by its six planes (Sutherland and Hodgman) and looks whether anything is left.
bool something_left(std::vector<Vec3d> polygon, double half) {
  for (int plane = 0; plane < 6; ++plane) {
    const double sign = plane % 2 == 0 ? 1 : -1;
    const auto depth = [&](const Vec3d& p) { return half - sign * p[plane / 2]; };
    std::vector<Vec3d> cut;
    for (size_t i = 0; i < polygon.size(); ++i) {
      const Vec3d p = polygon[i], q = polygon[(i + 1) % polygon.size()];
      if (depth(p) >= 0) cut.push_back(p);
      if (depth(p) * depth(q) < 0) cut.push_back(p + depth(p) / (depth(p) - depth(q)) * (q - p));
    }
    polygon = cut;
  }
  return !polygon.empty();
}

bool touches(const Vec3d& a, const Vec3d& b, const Vec3d& c, double half = 1) {
  return triangle_touches_box(a, b, c, {0, 0, 0}, {half, half, half});
}

TEST(TriangleBox, AgreesWithClippingOnRandomTriangles) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> place(-2.5, 2.5);
  int in = 0, out = 0;
  for (int i = 0; i < 20000; ++i) {
    Vec3d v[3];
    for (Vec3d& p : v) p = {place(random), place(random), place(random)};
    if (i % 3 == 0) v[2] = v[1] + 0.05 * (v[2] - v[1]);  // slivers
    const bool met = touches(v[0], v[1], v[2]);
    (met ? in : out) += 1;
    if (something_left({v[0], v[1], v[2]}, 1 - 1e-9)) EXPECT_TRUE(met);
    if (!something_left({v[0], v[1], v[2]}, 1 + 1e-9)) EXPECT_FALSE(met);
  }
  EXPECT_GT(in, 4000);
  EXPECT_GT(out, 4000);
}

TEST(TriangleBox, KnowsTheDegenerateCases) {
  const Vec3d inside{0.2, -0.3, 0.4}, outside{0.2, 1.3, 0.4};
  EXPECT_TRUE(touches(inside, inside, inside));  // a point
  EXPECT_FALSE(touches(outside, outside, outside));
  EXPECT_TRUE(touches({-2, 0.9, 0.9}, {2, 0.9, 0.9}, {2, 0.9, 0.9}));  // a segment
  EXPECT_FALSE(touches({1.5, -3, 0}, {4, 3, 0}, {4, 3, 0}));
  EXPECT_FALSE(touches({0, 2.1, 0}, {2.1, 0, 0}, {2.1, 0, 0}));  // passes an edge of the box
  EXPECT_TRUE(touches({0, 1.9, 0}, {1.9, 0, 0}, {1.9, 0, 0}));
  EXPECT_TRUE(touches({-9, -9, 1}, {9, -9, 1}, {0, 9, 1}));  // in the plane of a face
  EXPECT_FALSE(touches({-9, -9, 1.001}, {9, -9, 1.001}, {0, 9, 1.001}));
  EXPECT_TRUE(touches({1, 1, 1}, {2, 2, 2}, {3, 2, 2}));         // one corner
  EXPECT_FALSE(touches({3.1, 0, 0}, {0, 3.1, 0}, {0, 0, 3.1}));  // cuts the corner of the box's box, not the box
  EXPECT_TRUE(touches({2.9, 0, 0}, {0, 2.9, 0}, {0, 0, 2.9}));
}

TEST(TriangleBox, TakesABoxWithoutThickness) {
  const Vec3d flat{1, 1, 0};
  EXPECT_TRUE(triangle_touches_box({0, 0, -1}, {0.2, 0, 1}, {0, 0.2, 1}, {0, 0, 0}, flat));
  EXPECT_FALSE(triangle_touches_box({0, 0, 0.1}, {0.2, 0, 1}, {0, 0.2, 1}, {0, 0, 0}, flat));
}

}  // namespace triangle_box_test
}  // namespace knead
