#include <gtest/gtest.h>

#include <cmath>

#include "graph/error.h"
#include "kernels/port_types.h"
#include "kernels/shapes/primitives.h"
#include "tests/nodes/sdf_node_context.h"

namespace {

using knead::Sdf;
using knead::Surface;
using knead::Vec3d;
using sdf_node_test::OneNode;
using sdf_node_test::value_at;

Sdf union_part(const Surface& surface, double voxel, const Vec3d& at, double scale = 1) {
  Surface placed = surface;
  placed.placement.scale = scale;
  placed.placement.translation = at;
  OneNode node("mesh_to_sdf");
  node.set("voxel_size", voxel).connect("mesh", placed).run();
  return node.out<Sdf>("sdf");
}

TEST(UnionSdf, IsTheLeastOfTheDistances) {
  const Surface ball = knead::make_sphere(1, 4);
  OneNode node("union_sdf", 2);
  node.connect("sdf", union_part(ball, 0.06, {5, 0, 0}, 0.5)).connect("sdf", union_part(ball, 0.05, {6, 0, 0})).run();
  const Sdf& sdf = node.out<Sdf>("sdf");
  EXPECT_NEAR(sdf.voxel_size * sdf.placement.scale, 0.05, 1e-6);  // the finer of the two
  for (double x = 4.4; x < 7.1; x += 0.06) {
    const double expected = std::min(std::abs(x - 5) - 0.5, std::abs(x - 6) - 1.0);
    EXPECT_NEAR(value_at(sdf, {x, 0, 0}), std::min(expected, 4 * 0.05), 0.02) << x;
  }
  EXPECT_GT(value_at(sdf, {5, 3, 0}), 0);
  ASSERT_TRUE(sdf.mesh);
  EXPECT_EQ(sdf.mesh->topology->triangle_count(), 2 * ball.topology->triangle_count());
}

TEST(UnionSdf, IsBuiltOnceWhileThePartsKeepTheirPlaces) {
  const Surface ball = knead::make_sphere(1, 3);
  Sdf a = union_part(ball, 0.1, {0, 0, 0}), b = union_part(ball, 0.1, {1, 0, 0});
  OneNode node("union_sdf");
  node.connect("sdf", a).connect("sdf", b).run();
  EXPECT_EQ(node.builds, 1);
  EXPECT_NEAR(value_at(node.out<Sdf>("sdf"), {1.9, 0, 0}), -0.1, 0.02);
}

// 200 balls all over a box that would take eight thousand million voxels.
TEST(UnionSdf, CostsWhatItsPartsHoldAndNotWhatTheySpan) {
  const Sdf ball = union_part(knead::make_sphere(1, 2), 0.25, {0, 0, 0});
  OneNode node("union_sdf", 2);
  std::vector<Vec3d> places;
  for (int k = 0; k < 200; ++k) {
    Sdf one = ball;
    const double turn = 2.4 * k;
    places.push_back({250 * std::cos(turn), -250 + 2.5 * k, 250 * std::sin(turn)});
    one.placement.translation = places.back();
    node.connect("sdf", one);
  }
  node.run();
  const Sdf& sdf = node.out<Sdf>("sdf");
  for (const Vec3d& at : places) {
    EXPECT_NEAR(value_at(sdf, at), value_at(ball, {0, 0, 0}), 0.25) << "a voxel, at the tip";
    EXPECT_NEAR(value_at(sdf, at + Vec3d{0.9, 0, 0}), value_at(ball, {0.9, 0, 0}), 0.03);
  }
  EXPECT_GT(value_at(sdf, {0, 0, 0}), 0);
  EXPECT_LT(sdf.grid.size(), 220 * ball.grid.size());
}

TEST(UnionSdf, EndsWhenItIsCancelled) {
  struct Cancelled : OneNode {
    using OneNode::OneNode;
    bool cancelled() const override { return ++asked > 5; }
    mutable int asked = 0;
  };
  const Sdf ball = union_part(knead::make_sphere(1, 2), 0.1, {0, 0, 0}), other = union_part(knead::make_sphere(1, 2), 0.1, {1, 0, 0});
  Cancelled node("union_sdf");
  node.connect("sdf", ball).connect("sdf", other);
  try {
    node.run();
    FAIL();
  } catch (const knead::Error& e) {
    EXPECT_EQ(e.code(), knead::ErrorCode::kCancelled);
  }
  EXPECT_LT(node.asked, 10) << "leaves after it was told";
}

TEST(UnionSdf, PassesOneOnAndRefusesNone) {
  const Sdf part = union_part(knead::make_sphere(1, 2), 0.2, {0, 0, 0});
  OneNode one("union_sdf");
  one.connect("sdf", part).run();
  EXPECT_EQ(one.out<Sdf>("sdf").grid.id(), part.grid.id());
  OneNode none("union_sdf");
  EXPECT_THROW(none.run(), knead::Error);
}

}  // namespace
