#include "kernels/measure.h"

#include <gtest/gtest.h>
#include <nanovdb/NanoVDB.h>
#include <nanovdb/util/Primitives.h>

#include <numbers>

#include "kernels/surface/mesh_distance.h"
#include "tests/kernels/loop/loop_fixture.h"

namespace {

namespace fixture = knead::loop_fixture;
using knead::Buffer;
using knead::ColliderDistance;
using knead::Penetration;
using knead::Sdf;
using knead::Surface;
using knead::Vec3d;
using knead::Vec3f;

// A ball of radius 1 in its own space, set in the world.
Sdf measure_ball(const Surface& mesh, double scale, const Vec3d& centre) {
  Sdf sdf;
  sdf.placement.scale = scale;
  sdf.placement.rotation = {0, -1, 0, 1, 0, 0, 0, 0, 1};
  sdf.placement.translation = centre;
  sdf.lower = mesh.lower;
  sdf.upper = mesh.upper;
  return sdf;
}

TEST(Measure, FindsTheDepthInAPlacedColliderExactly) {
  const auto executor = knead::make_cpu_executor(2);
  const Surface ball = knead::make_sphere(1, 4);
  const Sdf sdf = measure_ball(ball, 0.5, {0, 1.2, 0});
  ColliderDistance colliders;
  colliders.add(sdf, std::make_shared<knead::MeshDistance>(ball.points.host(), ball.topology->triangles));
  // A body whose top vertex is 0.3 deep: its placement is not the identity either.
  Surface body = knead::make_box({2, 2, 2}, 2);
  body.placement.scale = 0.5;
  body.placement.translation = {0, 0.5, 0};
  const Penetration depth = measure_penetration(*executor, body, colliders, 0);
  EXPECT_NEAR(depth.vertices_max, 0.3, 2e-3);  // the ball is a polyhedron
  EXPECT_EQ(depth.vertices_inside, 1u);
  EXPECT_NEAR(depth.vertices_rms, depth.vertices_max / std::sqrt(static_cast<double>(body.vertices())), 1e-9);
  EXPECT_EQ(depth.faces_max, 0);
}

TEST(Measure, LooksAtFacesBetweenVertices) {
  const auto executor = knead::make_cpu_executor(2);
  const Surface ball = knead::make_sphere(1, 4);
  const Sdf sdf = measure_ball(ball, 0.1, {1.0 / 3, 1.0 / 3, 0.06});
  ColliderDistance colliders;
  colliders.add(sdf, std::make_shared<knead::MeshDistance>(ball.points.host(), ball.topology->triangles));
  const Surface triangle = knead::make_triangle_surface({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {0, 1, 2});
  EXPECT_EQ(measure_penetration(*executor, triangle, colliders, 0).faces_max, 0);
  const Penetration centroid = measure_penetration(*executor, triangle, colliders, 1);
  EXPECT_EQ(centroid.vertices_max, 0);
  EXPECT_NEAR(centroid.faces_max, 0.04, 1e-3);
  const double grid = measure_penetration(*executor, triangle, colliders, 45).faces_max;  // no grid point at the centroid, but near it
  EXPECT_GT(grid, 0.01);
  EXPECT_LE(grid, centroid.faces_max);
}

TEST(Measure, SamplesTheGridOfAColliderWithoutTriangles) {
  const auto executor = knead::make_cpu_executor(1);
  const double voxel = 0.05;
  const auto handle = nanovdb::createLevelSetSphere<float>(1.0f, nanovdb::Vec3f(0), voxel, 30.0);
  Sdf sdf = measure_ball(knead::make_sphere(1, 2), 1, {0, 0, 0});
  sdf.grid = Buffer<std::byte>(std::span<const std::byte>(reinterpret_cast<const std::byte*>(handle.data()), handle.size()));
  sdf.voxel_size = static_cast<float>(voxel);
  ColliderDistance colliders;
  colliders.add(sdf);
  for (const double depth : {0.1, 0.37, 0.8}) EXPECT_NEAR(colliders({0, 1 - depth, 0}), -depth, 2e-3);
  EXPECT_GT(colliders({0, 1.5, 0}), 0);
  EXPECT_EQ(colliders({0, 3, 0}), 2);
}

TEST(Measure, TakesTheUnionOfSeveralColliders) {
  const Surface ball = knead::make_sphere(1, 3);
  const auto exact = std::make_shared<knead::MeshDistance>(ball.points.host(), ball.topology->triangles);
  const Sdf left = measure_ball(ball, 1, {-0.5, 0, 0}), right = measure_ball(ball, 1, {0.5, 0, 0});
  ColliderDistance none, both;
  both.add(left, exact);
  both.add(right, exact);
  EXPECT_TRUE(none.empty());
  EXPECT_TRUE(std::isinf(none({0, 0, 0})));
  EXPECT_NEAR(both({0.5, 0, 0}), -1, 1e-2);
  EXPECT_NEAR(both({-0.5, 0, 0}), -1, 1e-2);
}

TEST(Measure, VolumeOfABallAndOfAnInsideOutOneFarFromTheOrigin) {
  const auto executor = knead::make_cpu_executor(2);
  const Surface ball = knead::make_sphere(1, 5);
  const double exact = 4 * std::numbers::pi / 3;
  EXPECT_NEAR(signed_volume(*executor, ball.points.host(), ball.topology->triangles), exact, 0.004 * exact);
  std::vector<Vec3f> far = fixture::vector_of(ball.points);
  for (Vec3f& p : far) p += Vec3f{1000, -1000, 500};
  std::vector<uint32_t> turned = ball.topology->triangles;
  for (size_t t = 0; t < turned.size(); t += 3) std::swap(turned[t], turned[t + 1]);
  EXPECT_NEAR(signed_volume(*executor, far, turned), -exact, 0.005 * exact);
  EXPECT_EQ(signed_volume(*executor, far, {}), 0);
}

TEST(Measure, TetFiguresOfAStretchedAndOfAnInvertedBody) {
  const auto executor = knead::make_cpu_executor(2);
  const fixture::Scene scene = fixture::ball(0.3, 1, *executor);
  std::vector<Vec3f> x = fixture::vector_of(scene.tets.rest);
  for (Vec3f& p : x) p = p * 1.1f;
  knead::TetFigures figures = measure_tets(*executor, Buffer<Vec3f>(x), scene.tets);
  EXPECT_NEAR(figures.volume / figures.rest_volume, 1.331, 1e-5);
  EXPECT_NEAR(figures.stretch_mean, 0.1, 1e-5);
  EXPECT_NEAR(figures.stretch_max, 0.1, 1e-4);
  EXPECT_EQ(figures.inverted, 0u);
  for (Vec3f& p : x) p.z = -p.z;
  EXPECT_EQ(measure_tets(*executor, Buffer<Vec3f>(x), scene.tets).inverted, scene.tets.tets.size());
}

TEST(Measure, VolumeChangeIsTheLocalRatioAtMsVertices) {
  const auto executor = knead::make_cpu_executor(2);
  const fixture::Scene scene = fixture::ball(0.3, 2, *executor);
  std::vector<Vec3f> x = fixture::vector_of(scene.tets.rest);
  for (Vec3f& p : x) p.y *= p.y > 0 ? 0.8f : 1.0f;
  const Buffer<float> change = volume_change(*executor, Buffer<Vec3f>(x), scene.tets, scene.lattice);
  ASSERT_EQ(change.size(), scene.surface.vertices());
  for (size_t i = 0; i < change.size(); ++i) {
    const float y = scene.surface.points.host()[i].y;
    if (std::abs(y) > 0.65f) {
      EXPECT_NEAR(change.host()[i], y > 0 ? -0.2f : 0.0f, 1e-4f) << i;
    }
  }
}

TEST(Measure, LargestDisplacementIsInTheWorld) {
  const auto executor = knead::make_cpu_executor(2);
  Surface before = knead::make_box({1, 1, 1}, 2), after = before;
  before.placement.scale = after.placement.scale = 3;
  std::vector<Vec3f> moved = fixture::vector_of(before.points);
  moved[4] += Vec3f{0.3f, 0, 0.4f};
  after.points = Buffer<Vec3f>(moved);
  EXPECT_NEAR(largest_displacement(*executor, before, after), 1.5, 1e-6);
  after.placement.translation = {0, 10, 0};
  EXPECT_NEAR(largest_displacement(*executor, before, after), std::sqrt(100 + 2.25), 1e-5);
}

}  // namespace
