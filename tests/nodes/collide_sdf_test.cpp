#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>

#include "graph/error.h"
#include "graph/plan.h"
#include "io/graph_file.h"
#include "kernels/port_types.h"
#include "kernels/shapes/primitives.h"
#include "kernels/surface/mesh_distance.h"
#include "tests/nodes/sdf_node_context.h"

namespace {

using knead::Contacts;
using knead::Points;
using knead::Report;
using knead::Sdf;
using knead::Surface;
using knead::Vec3d;
using knead::Vec3f;
using sdf_node_test::OneNode;

Sdf collider_of(const Surface& surface, double voxel) {
  OneNode node("mesh_to_sdf");
  node.set("voxel_size", voxel).connect("mesh", surface).run();
  return node.out<Sdf>("sdf");
}

Surface collider_at(Surface surface, const Vec3d& at) {
  surface.placement.translation = at;
  return surface;
}

TEST(CollideSdf, GivesTheVerySameSurfaceBackWithoutContact) {
  const Surface body = knead::make_sphere(1, 3);
  const Sdf far = collider_of(collider_at(knead::make_sphere(0.5, 3), {3, 0, 0}), 0.05);
  for (const char* mode : {"push", "project"}) {
    OneNode node("collide_sdf");
    node.set("mode", mode).connect("surface", body).connect("sdf", far).run();
    EXPECT_EQ(node.out<Surface>("surface").points.id(), body.points.id()) << mode;
    for (const Vec3f& d : node.out<Points>("displacement").values.host()) ASSERT_TRUE(d.x == 0 && d.y == 0 && d.z == 0);
    for (float lambda : node.out<Contacts>("memory").memory.host()) ASSERT_EQ(lambda, 0);
    EXPECT_EQ(node.out<Contacts>("memory").progress.host()[0].unrest, 0);
    EXPECT_EQ(node.out<Report>("report").number("vertices_in_collision"), 0);
  }
}

TEST(CollideSdf, SaysWhichNodeTookAParameterOver) {
  try {
    knead::compile(
        knead::read_graph_text("knead: 1\nnodes:\n  b: {type: primitive}\n  p: {type: collide_sdf, surface: b, way_in: true}\n", "old.yaml"));
    FAIL() << "way_in was taken";
  } catch (const knead::Error& error) {
    EXPECT_THAT(error.what(),
                testing::AllOf(testing::HasSubstr("old.yaml:4"), testing::HasSubstr("'way_in'"), testing::HasSubstr("'approach' took it over")));
  }
}

TEST(CollideSdf, TakesNoColliderAtAll) {
  const Surface body = knead::make_sphere(1, 2);
  OneNode node("collide_sdf");
  node.connect("surface", body).run();
  EXPECT_EQ(node.out<Surface>("surface").points.id(), body.points.id());
}

TEST(CollideSdf, ReportsPenetrationInWorldUnitsAndOfTheDiagonal) {
  Surface body = knead::make_sphere(1, 4);
  body.placement.scale = 10;
  const Sdf ball = collider_of(collider_at(knead::make_sphere(5, 4), {12, 0, 0}), 0.25);
  OneNode node("collide_sdf");
  node.connect("surface", body).connect("sdf", ball).run();
  const Report& report = node.out<Report>("report");
  EXPECT_NEAR(report.number("penetration_max"), 3, 0.1);
  EXPECT_NEAR(report.number("penetration_max_relative"), 3 / (10 * body.diagonal()), 0.003);
  EXPECT_NEAR(node.out<Contacts>("memory").progress.host()[0].unrest, report.number("penetration_max_relative"), 1e-12);
  const auto before = body.points.host(), after = node.out<Surface>("surface").points.host();
  const auto moved = node.out<Points>("displacement").values.host();
  double worst = 0;
  for (size_t i = 0; i < before.size(); ++i) {
    ASSERT_EQ(after[i].x, before[i].x + moved[i].x);
    worst = std::max(worst, 5 - length(body.placement.apply(to_double(after[i])) - Vec3d{12, 0, 0}));
  }
  EXPECT_LT(worst, 0.05);
}

TEST(CollideSdf, CarriesItsMemoryRoundTheLoop) {
  const Surface body = knead::make_sphere(1, 3);
  const Sdf ball = collider_of(collider_at(knead::make_sphere(0.5, 3), {1.3, 0, 0}), 0.05);
  OneNode node("collide_sdf");
  node.set("memory_limit", 10.0).connect("surface", body).connect("sdf", ball).run();
  const std::vector<float> first(node.out<Contacts>("memory").memory.host().begin(), node.out<Contacts>("memory").memory.host().end());
  node.connect("memory", node.out<Contacts>("memory")).run();
  const auto second = node.out<Contacts>("memory").memory.host();
  bool grew = false;
  for (size_t i = 0; i < first.size(); ++i) {
    ASSERT_FLOAT_EQ(second[i], 2 * first[i]);
    grew = grew || first[i] > 0;
  }
  EXPECT_TRUE(grew);
  node.connect("memory", Contacts{knead::Buffer<float>(3), knead::Buffer<knead::ContactProgress>(1), {}, {}, {}, {}});
  EXPECT_THROW(node.run(), knead::Error);
}

TEST(CollideSdf, ProjectsOutOfTheTrianglesThemselves) {
  const Surface body = knead::make_head(2, 1500);
  const Surface fist = collider_at(knead::make_fist(0.9, 1200), {0.1, 0.2, 0.8});
  const Sdf solid = collider_of(fist, 0.05);  // coarse: the field cuts the knuckles
  OneNode node("collide_sdf", 2);
  node.set("mode", "project").connect("surface", body).connect("sdf", solid).run();
  const Report& report = node.out<Report>("report");
  EXPECT_GT(report.number("vertices_in_collision"), 10);
  EXPECT_EQ(report.number("vertices_left_inside"), 0);
  const knead::MeshDistance exact(fist.points.host(), std::span<const uint32_t>(fist.topology->triangles));
  const auto before = body.points.host(), after = node.out<Surface>("surface").points.host();
  size_t kept = 0;
  for (size_t i = 0; i < after.size(); ++i) {
    ASSERT_GT(exact.signed_distance(to_double(after[i]) - fist.placement.translation).distance, -1e-6 * body.diagonal());
    if (exact.signed_distance(to_double(before[i]) - fist.placement.translation).distance > 0) {
      ASSERT_EQ(std::memcmp(&before[i], &after[i], sizeof(Vec3f)), 0);
      ++kept;
    }
  }
  EXPECT_GT(kept, 500u);
}

TEST(CollideSdf, KeepsTheMarginWhenProjecting) {
  const Surface body = knead::make_sphere(1, 3), ball = collider_at(knead::make_sphere(0.5, 4), {1.3, 0, 0});
  OneNode node("collide_sdf");
  node.set("mode", "project").set("margin", 0.05).connect("surface", body).connect("sdf", collider_of(ball, 0.05)).run();
  const knead::MeshDistance exact(ball.points.host(), std::span<const uint32_t>(ball.topology->triangles));
  for (const Vec3f& p : node.out<Surface>("surface").points.host())
    ASSERT_GT(exact.signed_distance(to_double(p) - ball.placement.translation).distance, 0.05 - 1e-6);
  EXPECT_EQ(node.out<Report>("report").number("vertices_left_inside"), 0);
  node.set("margin", 0.5);
  EXPECT_THROW(node.run(), knead::Error);
}

TEST(CollideSdf, TakesAnyNumberOfColliders) {
  const Surface body = knead::make_sphere(1, 3);
  const Sdf ball = collider_of(knead::make_sphere(1.1, 3), 0.1);
  for (const std::string mode : {"push", "project"}) {
    OneNode one("collide_sdf"), many("collide_sdf");
    one.set("mode", mode).connect("surface", body).connect("sdf", ball).run();
    many.set("mode", mode).connect("surface", body);
    for (int k = 0; k < 40; ++k) {
      Sdf other = ball;
      if (k != 30) other.placement.translation = {3.0 + k, 0, 0};
      many.connect("sdf", other);
    }
    many.run();
    const auto a = one.out<Surface>("surface").points.host(), b = many.out<Surface>("surface").points.host();
    EXPECT_EQ(std::memcmp(a.data(), b.data(), a.size_bytes()), 0) << mode;
  }
}

}  // namespace
