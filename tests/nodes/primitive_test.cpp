#include <gtest/gtest.h>

#include "direct_run.h"

namespace knead {
void register_primitive(Registry&);
}

namespace knead::primitive_test {
namespace {

Surface made(const Literal::Map& arguments) {
  return direct::DirectRun(register_primitive, "primitive", arguments).at(1).result<Surface>();
}

TEST(Primitive, MakesEveryShapeItLists) {
  direct::DirectRun run(register_primitive, "primitive", {});
  for (const std::string& shape : run.node().params()[0]->spec().choices) {
    const Surface s = made({{"shape", shape}, {"resolution", shape == "sphere" ? 2 : shape == "torus" ? 24 : 8}});
    EXPECT_GT(s.vertices(), 50u) << shape;
    EXPECT_GT(s.topology->triangle_count(), 90u) << shape;
    EXPECT_TRUE(s.placement.is_identity());
  }
}

TEST(Primitive, MakesAHeadOf2400VerticesByDefault) {
  const Surface head = made({{"shape", "head"}});
  EXPECT_EQ(head.vertices(), 2400u);
  EXPECT_NEAR(head.upper.y - head.lower.y, 2, 0.01);
}

TEST(Primitive, TakesSizesInWorldUnitsAndACentre) {
  const Surface ball = made({{"shape", "sphere"}, {"radius", 3}, {"centre", Literal::List{10, 0, -2}}});
  EXPECT_NEAR(length(to_double(ball.points.host()[0])), 3, 1e-6);
  EXPECT_EQ(ball.placement.translation.x, 10);
  const Surface plate = made({{"shape", "plate"}, {"size", Literal::List{4, 9, 2}}, {"thickness", 0.125}});
  EXPECT_FLOAT_EQ(plate.upper.y - plate.lower.y, 0.125f);
  EXPECT_FLOAT_EQ(plate.upper.z - plate.lower.z, 2);
}

TEST(Primitive, DoesNotDependOnTheFrame) {
  EXPECT_FALSE(direct::DirectRun(register_primitive, "primitive", {}).node().depends_on_frame());
}

TEST(Primitive, SaysWhatMakesNoSolid) {
  EXPECT_THROW(made({{"shape", "sphere"}, {"radius", 0}}), Error);
  EXPECT_THROW(made({{"shape", "torus"}, {"radius", 1}, {"tube", 2}}), Error);
  EXPECT_THROW(made({{"shape", "cone"}}), Error);
}

}  // namespace
}  // namespace knead::primitive_test
