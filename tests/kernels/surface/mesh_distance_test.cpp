#include "kernels/surface/mesh_distance.h"

#include <gtest/gtest.h>

#include <random>

#include "graph/error.h"
#include "kernels/surface/winding_number.h"
#include "tests/kernels/triangle_soup.h"

namespace {

using knead::MeshDistance;
using knead::SignedDistance;
using knead::Vec3d;
using knead::Vec3f;

struct DistanceSoup : knead::TriangleSoup {
  MeshDistance distance() const { return MeshDistance(std::span<const Vec3f>(points), triangles); }
};

Vec3d distance_random_point(std::mt19937& random, double half) {
  std::uniform_real_distribution<double> value(-half, half);
  const double x = value(random), y = value(random), z = value(random);
  return {x, y, z};
}

double exact_box_distance(const Vec3d& p, double half) {
  const Vec3d q{std::abs(p.x) - half, std::abs(p.y) - half, std::abs(p.z) - half};
  const Vec3d out{std::max(q.x, 0.0), std::max(q.y, 0.0), std::max(q.z, 0.0)};
  return length(out) + std::min(std::max({q.x, q.y, q.z}), 0.0);
}

TEST(MeshDistance, IsExactAroundABoxWithItsEdgesAndCorners) {
  DistanceSoup soup;
  soup.add(knead::make_box({2, 2, 2}, 1));
  const MeshDistance mesh = soup.distance();
  EXPECT_TRUE(mesh.closed());
  EXPECT_FALSE(mesh.overlapping());
  std::mt19937 random(1);
  for (int i = 0; i < 5000; ++i) {
    const Vec3d p = distance_random_point(random, i % 2 ? 2.5 : 1.0);
    const SignedDistance d = mesh.signed_distance(p);
    ASSERT_NEAR(d.distance, exact_box_distance(p, 1), 1e-12);
    ASSERT_NEAR(length(d.normal), 1, 1e-12);
    ASSERT_NEAR(length(p - d.normal * d.distance - d.point), 0, 1e-12);
  }
}

// Few large triangles say as much about a thin wall as many small ones.
TEST(MeshDistance, KnowsThinWallsOfLargeTriangles) {
  for (const double thickness : {1e-1, 1e-2, 1e-3, 1e-4})
    for (const int segments : {1, 8}) {
      DistanceSoup soup;
      soup.add(knead::make_box({2, static_cast<float>(thickness), 2}, segments));
      const MeshDistance mesh = soup.distance();
      EXPECT_FALSE(mesh.overlapping()) << thickness << ", " << segments;
      const double half = 0.5 * static_cast<double>(static_cast<float>(thickness));
      std::mt19937 random(3);
      for (int i = 0; i < 500; ++i) {
        Vec3d p = distance_random_point(random, 0.9);
        if (i % 2) p.y *= 2 * thickness;
        ASSERT_NEAR(mesh.signed_distance(p).distance, std::abs(p.y) - half, 1e-9) << thickness << ", " << segments << " at " << p.y;
      }
    }
}

TEST(MeshDistance, PointsAwayFromTheSolidOnItsSurface) {
  DistanceSoup soup;
  soup.add(knead::make_box({2, 2, 2}, 2));
  const MeshDistance mesh = soup.distance();
  for (const Vec3d& p : {Vec3d{1, 1, 1}, Vec3d{1, 1, 0.3}, Vec3d{1, 0.1, 0.3}, Vec3d{-1, -1, 1}}) {
    const SignedDistance d = mesh.signed_distance(p);
    EXPECT_NEAR(d.distance, 0, 1e-15);
    EXPECT_GT(dot(d.normal, p), 0.99);
  }
}

TEST(MeshDistance, AgreesWithBruteForceAtAnyScaleAndOffset) {
  for (const double scale : {1e-4, 1.0, 1e6}) {
    const knead::Surface torus = knead::make_torus(1, 0.3, 24);
    std::vector<Vec3d> points;
    for (const Vec3f& p : torus.points.host()) points.push_back(to_double(p) * scale + Vec3d{3 * scale, 0, 0});
    const auto& t = torus.topology->triangles;
    const MeshDistance mesh(std::span<const Vec3d>(points), t);
    std::mt19937 random(2);
    for (int i = 0; i < 300; ++i) {
      const Vec3d p = distance_random_point(random, 1.6) * scale + Vec3d{3 * scale, 0, 0};
      double best = 1e300;
      const double winding = knead::winding_number_exact(points, t, p);
      for (size_t k = 0; k < t.size(); k += 3)
        best = std::min(best, length(p - knead::closest_point_on_triangle(p, points[t[k]], points[t[k + 1]], points[t[k + 2]]).point));
      ASSERT_NEAR(mesh.winding_number(p), winding, 0.05);
      ASSERT_NEAR(mesh.signed_distance(p).distance, winding > 0.5 ? -best : best, 1e-12 * scale);
    }
  }
}

TEST(MeshDistance, FindsNothingBeyondTheRadius) {
  DistanceSoup soup;
  soup.add(knead::make_sphere(1, 3));
  const MeshDistance mesh = soup.distance();
  EXPECT_FALSE(mesh.signed_distance({3, 0, 0}, 1.5).found());
  EXPECT_TRUE(mesh.signed_distance({3, 0, 0}, 2.1).found());
  EXPECT_NEAR(mesh.signed_distance({3, 0, 0}, 2.1).distance, mesh.signed_distance({3, 0, 0}).distance, 0);
}

TEST(MeshDistance, IgnoresSurfaceInsideOverlappingSolids) {
  DistanceSoup soup;
  soup.add(knead::make_sphere(1, 4));
  soup.add(knead::make_sphere(1, 4), {1, 0, 0});
  const MeshDistance mesh = soup.distance();
  EXPECT_TRUE(mesh.overlapping());
  // The middle of the overlap is 0.5 from both inner caps and sqrt(3)/2 from the ring where the spheres meet, which is the surface there.
  EXPECT_NEAR(mesh.signed_distance({0.5, 0, 0}).distance, -std::sqrt(0.75), 0.02);
  EXPECT_NEAR(mesh.signed_distance({2.5, 0, 0}).distance, 0.5, 0.01);
  EXPECT_NEAR(mesh.signed_distance({-0.5, 0, 0}).distance, -0.5, 0.01);
}

TEST(MeshDistance, KeepsACavityOpen) {
  DistanceSoup soup;
  soup.add(knead::make_sphere(1, 4));
  soup.add(knead::make_sphere(0.5, 4), {0, 0, 0}, true);
  const MeshDistance mesh = soup.distance();
  EXPECT_FALSE(mesh.overlapping());
  EXPECT_NEAR(mesh.signed_distance({0, 0, 0}).distance, 0.5, 0.01);
  EXPECT_NEAR(mesh.signed_distance({0.75, 0, 0}).distance, -0.25, 0.01);
}

TEST(MeshDistance, IgnoresWallsInsideTheSolid) {
  DistanceSoup soup;  // two boxes that share a whole face, both with their own copy of it
  soup.add(knead::make_box({1, 1, 1}, 2), {-0.5f, 0, 0});
  soup.add(knead::make_box({1, 1, 1}, 2), {0.5f, 0, 0});
  const MeshDistance mesh = soup.distance();
  EXPECT_NEAR(mesh.signed_distance({0, 0, 0}).distance, -0.5, 1e-9);
  EXPECT_NEAR(mesh.signed_distance({0.1, 0.3, 0}).distance, -0.2, 1e-9);
  EXPECT_NEAR(mesh.signed_distance({0.01, 0.7, 0}).distance, 0.2, 1e-9);
}

TEST(MeshDistance, SeesThroughDuplicateVertices) {
  const knead::Surface sphere = knead::make_sphere(1, 3);
  DistanceSoup soup;
  for (uint32_t v : sphere.topology->triangles) {
    soup.triangles.push_back(static_cast<uint32_t>(soup.points.size()));
    soup.points.push_back(sphere.points.host()[v]);
  }
  const MeshDistance mesh = soup.distance();
  EXPECT_TRUE(mesh.closed());
  EXPECT_FALSE(mesh.overlapping());
  EXPECT_NEAR(mesh.signed_distance({0, 0, 0}).distance, -1, 0.02);
}

TEST(MeshDistance, SurvivesFlatAndBrokenTriangles) {
  DistanceSoup soup;
  soup.add(knead::make_box({2, 2, 2}, 1));
  const uint32_t n = static_cast<uint32_t>(soup.points.size());
  soup.points.push_back({NAN, 0, 0});
  for (uint32_t v : {0u, 0u, 1u, 0u, 1u, n}) soup.triangles.push_back(v);
  EXPECT_NEAR(soup.distance().signed_distance({0, 0, 3}).distance, 2, 1e-12);
  DistanceSoup nothing;
  nothing.points = {{0, 0, 0}};
  nothing.triangles = {0, 0, 0};
  EXPECT_THROW(nothing.distance(), knead::Error);
  nothing.triangles = {0, 1, 2};
  EXPECT_THROW(nothing.distance(), knead::Error);
}

TEST(MeshDistance, ShootsThroughTheSolid) {
  DistanceSoup soup;
  soup.add(knead::make_box({2, 2, 2}, 3));
  const MeshDistance mesh = soup.distance();
  EXPECT_NEAR(mesh.first_hit({0, 0, 0.9}, {0, 0, -1}), 1.9, 1e-6);
  EXPECT_TRUE(std::isinf(mesh.first_hit({0, 0, 1.1}, {0, 0, 1})));
}

}  // namespace
