#include "kernels/surface/principal_frame.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <numeric>
#include <random>

#include "io/mesh/mesh_io.h"
#include "kernels/build_tets/build_tets.h"
#include "kernels/motion.h"
#include "kernels/shapes/primitives.h"
#include "tests/paths.h"

namespace knead {
namespace principal_frame_test {

using Matrix = std::array<double, 9>;

std::optional<Matrix> frame_of(const Surface& surface) {
  return principal_frame(surface.points.host(), surface.topology->triangles);
}

Surface turned(const Surface& surface, const Matrix& rotation) {
  Similarity turn;
  turn.rotation = rotation;
  std::vector<Vec3f> points;
  for (const Vec3f& p : surface.points.host()) points.push_back(to_float(turn.rotate(to_double(p))));
  return make_triangle_surface(points, surface.topology->triangles);
}

double furthest(const Matrix& a, const Matrix& b) {
  double most = 0;
  for (size_t k = 0; k < 9; ++k) most = std::max(most, std::abs(a[k] - b[k]));
  return most;
}

Matrix product(const Matrix& a, const Matrix& b) {
  Similarity left, right;
  left.rotation = a;
  right.rotation = b;
  return (left * right).rotation;
}

// A box with one corner drawn out along two axes: second moments mixed, both directions clear.
Surface wedge() {
  const Surface box = make_box({3, 2, 1}, 4);
  std::vector<Vec3f> points;
  for (const Vec3f& p : box.points.host()) points.push_back({p.x * (1 + 0.2f * p.y), p.y * (1 + 0.1f * p.x), p.z});
  return make_triangle_surface(points, box.topology->triangles);
}

TEST(PrincipalFrame, TurnsWithTheShape) {
  for (const Surface& shape : {make_head(2, 2400), make_fist(1, 1500), wedge()}) {
    const auto plain = frame_of(shape);
    ASSERT_TRUE(plain);
    std::mt19937 random(3);
    std::uniform_real_distribution<double> unit(-1, 1);
    for (int i = 0; i < 20; ++i) {
      const Matrix turn = rotation_about({unit(random), unit(random), unit(random)}, 360 * unit(random)).matrix();
      const auto after = frame_of(turned(shape, turn));
      ASSERT_TRUE(after);
      EXPECT_LT(furthest(product(turn, *plain), *after), 1e-6);
    }
  }
}

TEST(PrincipalFrame, IsARightHandedRotation) {
  for (const Surface& shape : {make_head(2, 1200), make_fist(1, 1500), wedge()}) {
    const Matrix m = frame_of(shape).value();
    const Vec3d x{m[0], m[3], m[6]}, y{m[1], m[4], m[7]}, z{m[2], m[5], m[8]};
    EXPECT_NEAR(length(x), 1, 1e-14);
    EXPECT_NEAR(length(y), 1, 1e-14);
    EXPECT_LT(length(cross(x, y) - z), 1e-14);
  }
}

TEST(PrincipalFrame, DoesNotSeePlaceScaleOrderOrTessellation) {
  const Surface shape = make_head(2, 1200);
  const Matrix plain = frame_of(shape).value();
  const auto points = shape.points.host();
  const auto& triangles = shape.topology->triangles;
  for (const double scale : {1e-4, 1e4}) {
    std::vector<Vec3f> other;
    for (const Vec3f& p : points) other.push_back(to_float(scale * (to_double(p) + Vec3d{4, -2, 1})));
    EXPECT_LT(furthest(plain, principal_frame(other, triangles).value()), 1e-6) << scale;
  }
  std::vector<uint32_t> backwards;
  for (size_t t = triangles.size(); t > 0; t -= 3) backwards.insert(backwards.end(), {triangles[t - 2], triangles[t - 1], triangles[t - 3]});
  EXPECT_LT(furthest(plain, principal_frame(points, backwards).value()), 1e-12);

  std::vector<Vec3f> more(points.begin(), points.end());
  std::vector<uint32_t> finer;  // every second triangle cut in three, and loose vertices
  for (size_t t = 0; t < triangles.size(); t += 3) {
    const uint32_t a = triangles[t], b = triangles[t + 1], c = triangles[t + 2], middle = static_cast<uint32_t>(more.size());
    if (t % 2 == 0) {
      finer.insert(finer.end(), {a, b, c});
      continue;
    }
    more.push_back((points[a] + points[b] + points[c]) * (1.0f / 3));
    finer.insert(finer.end(), {a, b, middle, b, c, middle, c, a, middle});
  }
  more.insert(more.end(), {{9, 9, 9}, {NAN, 0, 0}});
  EXPECT_LT(furthest(plain, principal_frame(more, finer).value()), 1e-6);
}

TEST(PrincipalFrame, IsNotThereForShapesWithoutClearAxes) {
  const Surface shapes[] = {make_sphere(1, 3),           make_box({1, 1, 1}, 4),   make_box({3, 2, 1}, 4),
                            make_box({1, 0.004, 1}, 12), make_capsule(0.3, 2, 12), make_torus(1, 0.3, 24)};
  for (const Surface& shape : shapes) {
    EXPECT_FALSE(frame_of(shape));
    EXPECT_FALSE(frame_of(turned(shape, rotation_about({1, 2, 3}, 40).matrix())));
  }
  const float nan = NAN;
  EXPECT_FALSE(principal_frame(std::vector<Vec3f>{}, std::vector<uint32_t>{}));
  EXPECT_FALSE(principal_frame(std::vector<Vec3f>{{nan, 0, 0}, {1, 0, 0}, {0, 1, 0}}, std::vector<uint32_t>{0, 1, 2}));
  EXPECT_FALSE(principal_frame(std::vector<Vec3f>{{1, 1, 1}, {1, 1, 1}, {2, 1, 1}}, std::vector<uint32_t>{0, 1, 2}));
  EXPECT_FALSE(principal_frame(std::vector<Vec3f>{{1, 1, 1}}, std::vector<uint32_t>{0, 1, 2}));
}

// A kite along x, symmetric in y, and a smaller one across it along z, both about the origin: clear axes that are the coordinates' but for rounding.
TEST(PrincipalFrame, AlongTheCoordinateAxesIsExact) {
  const float a = -1 - 2.0f / 3, b = 3 - 2.0f / 3, c = -2.0f / 3;
  const std::vector<Vec3f> points{{a, 0, 0}, {b, 0, 0}, {c, 1, 0}, {c, -1, 0}, {0, 0, a / 2}, {0, 0, b / 2}, {0, 0.5f, c / 2}, {0, -0.5f, c / 2}};
  const std::vector<uint32_t> triangles{0, 3, 2, 1, 2, 3, 4, 7, 6, 5, 6, 7};
  EXPECT_EQ(principal_frame(points, triangles), Similarity{}.rotation);
  std::vector<Vec3f> permuted;
  for (const Vec3f& p : points) permuted.push_back({-p.z, p.x, -p.y});
  EXPECT_EQ(principal_frame(permuted, triangles), (Matrix{0, 0, -1, 1, 0, 0, 0, -1, 0}));
}

// --- what is built along it ---

BuiltTets built(const Surface& surface) {
  const auto executor = make_cpu_executor(2);
  std::vector<std::string> warnings;
  return build_tets(surface, {.max_depth = 5}, *executor, warnings);
}

TEST(PrincipalFrame, HIsTheSameForATurnedHead) {
  const Surface head = make_head(2, 2400);
  const BuiltTets plain = built(head);
  for (const auto& [axis, degrees] : std::vector<std::pair<Vec3d, double>>{{{1, 0, 0}, 90}, {{0, 1, 0}, 90}, {{0, 0, 1}, 90}, {{1, -2, 0.5}, 33}}) {
    const BuiltTets other = built(turned(head, rotation_about(axis, degrees).matrix()));
    EXPECT_TRUE(std::ranges::equal(plain.tets.tets.host(), other.tets.tets.host())) << degrees;
    EXPECT_EQ(plain.tets.vertices(), other.tets.vertices());
    EXPECT_NEAR(plain.tets.to_local.scale, other.tets.to_local.scale, 1e-6 * plain.tets.to_local.scale);
  }
}

TEST(PrincipalFrame, BallsAndBlocksKeepTheirAxes) {
  std::vector<Surface> shapes{make_sphere(1, 3), make_box({1, 1, 1}, 4), make_box({2, 1, 1}, 4)};
  const std::filesystem::path block = std::filesystem::path(shared_data()) / "press/block20.obj";
  std::vector<std::string> warnings;
  if (std::filesystem::exists(block)) shapes.push_back(read_surface(block.string(), warnings));
  for (const Surface& shape : shapes) EXPECT_EQ(built(shape).tets.to_local.rotation, Similarity{}.rotation);
}

}  // namespace principal_frame_test
}  // namespace knead
