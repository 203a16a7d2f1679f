#include <gtest/gtest.h>

#include <cmath>

#include "graph/error.h"
#include "kernels/shapes/primitives.h"
#include "kernels/surface/exact_distance.h"
#include "tests/nodes/sdf_node_context.h"

namespace knead {
namespace plane_test {

using sdf_node_test::OneNode;
using sdf_node_test::value_at;

double exact_at(const Sdf& sdf, const Vec3d& world) {
  return sdf.distance->signed_distance(sdf.placement.inverse().apply(world)).distance * sdf.placement.scale;
}

Literal three(double x, double y, double z) {
  return Literal(Literal::List{Literal(x), Literal(y), Literal(z)});
}

TEST(Plane, IsTheHeightAboveItEverywhere) {
  OneNode node("plane");
  node.set("point", three(1, 2, 3)).set("normal", three(0, 3, 4)).run();
  const Sdf& sdf = node.out<Sdf>("sdf");
  for (const Vec3d& p : {Vec3d{1, 2, 3}, Vec3d{-2, 2.5, 3}, Vec3d{1e5, -1e4, 7}, Vec3d{0, 0, 0}}) {
    const double height = (p.y - 2) * 0.6 + (p.z - 3) * 0.8;
    EXPECT_NEAR(exact_at(sdf, p), height, 1e-9 * (1 + length(p)));
    if (std::abs(height) < 1) EXPECT_NEAR(value_at(sdf, p), height, p.x < 1e3 ? 1e-5 : 1e9) << "in the part that files show";
  }
  const Surface& shown = node.out<Surface>("surface");
  for (const Vec3f& p : shown.points.host()) EXPECT_NEAR(exact_at(sdf, shown.placement.apply(to_double(p))), 0, 1e-6);
}

TEST(Plane, FollowsASurface) {
  Surface leader = make_sphere(1, 1);
  leader.placement.translation = {0, 5, 0};
  leader.placement.rotation = {0, -1, 0, 1, 0, 0, 0, 0, 1};  // up becomes -x
  OneNode node("plane");
  node.set("point", three(0, 1, 0)).connect("follows", leader).run();
  EXPECT_NEAR(exact_at(node.out<Sdf>("sdf"), {-3, 70, -9}), 2, 1e-9);
}

TEST(Plane, ProjectsABodyThatIsFarFromItsPoint) {
  Surface body = make_sphere(1, 3);
  body.placement.translation = {500, 0.5, -300};
  OneNode plane("plane"), exact("collide_sdf");
  plane.run();
  exact.set("mode", "project").connect("surface", body).connect("sdf", plane.out<Sdf>("sdf")).run();
  const Surface& out = exact.out<Surface>("surface");
  double lowest = 1e300;
  for (const Vec3f& p : out.points.host()) lowest = std::min(lowest, out.placement.apply(to_double(p)).y);
  EXPECT_NEAR(lowest, 0, 1e-5);
  EXPECT_GE(lowest, 0);
}

TEST(Plane, RefusesWhatIsNone) {
  OneNode flat("plane"), empty("plane");
  EXPECT_THROW(flat.set("normal", three(0, 0, 0)).run(), Error);
  EXPECT_THROW(empty.set("size", 0.0).run(), Error);
}

TEST(Plane, IsNoPartOfAUnion) {
  OneNode plane("plane"), ball("mesh_to_sdf"), both("union_sdf");
  plane.run();
  ball.set("resolution", 16).connect("mesh", make_sphere(1, 2)).run();
  both.connect("sdf", ball.out<Sdf>("sdf")).connect("sdf", plane.out<Sdf>("sdf"));
  EXPECT_THROW(both.run(), Error);
}

}  // namespace plane_test
}  // namespace knead
