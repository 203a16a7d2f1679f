#include <gtest/gtest.h>

#include "direct_run.h"
#include "kernels/shapes/primitives.h"

namespace knead {
void register_weights(Registry&);
}

namespace knead::weights_test {
namespace {

using List = Literal::List;

// Points at x = 0, 1, 2, 3 (and one at y = 1 that closes the triangles), moved by (10, 0, 0) in the world.
Surface ruler() {
  Surface s = make_surface({{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {3, 0, 0}, {0, 1, 0}}, {0, 3, 6, 9}, {0, 1, 4, 1, 2, 4, 2, 3, 4});
  s.placement.translation = {10, 0, 0};
  return s;
}

std::vector<float> painted(const Literal::Map& arguments, const Surface& surface = ruler()) {
  direct::DirectRun run(register_weights, "weights", arguments);
  const auto values = run.give("surface", surface).at(1).result<Weights>().values.host();
  return {values.begin(), values.end()};
}

TEST(WeightsNode, PaintsEveryVertexByDefault) {
  EXPECT_EQ(painted({{"inside", 0.5}}), (std::vector<float>{0.5, 0.5, 0.5, 0.5, 0.5}));
}

TEST(WeightsNode, PaintsBehindAPlaneInWorldOrLocalSpace) {
  const Literal::Map local{{"region", "plane"}, {"space", "local"}, {"point", List{1, 0, 0}}, {"normal", List{5, 0, 0}}};
  EXPECT_EQ(painted(local), (std::vector<float>{1, 1, 0, 0, 1}));
  const Literal::Map world{{"region", "plane"}, {"point", List{12, 0, 0}}, {"normal", List{1, 0, 0}}};
  EXPECT_EQ(painted(world), (std::vector<float>{1, 1, 1, 0, 1}));
}

TEST(WeightsNode, FallsOffSmoothlyOutsideTheRegion) {
  const std::vector<float> w =
      painted({{"region", "sphere"}, {"centre", List{10, 0, 0}}, {"radius", 0.5}, {"falloff", 2}, {"inside", 3}, {"outside", 1}});
  EXPECT_FLOAT_EQ(w[0], 3);
  const double t = 0.75;
  EXPECT_NEAR(w[1], 1 + 2 * t * t * (3 - 2 * t), 1e-4);
  EXPECT_GT(w[2], 1);
  EXPECT_LT(w[2], w[1]);
  EXPECT_FLOAT_EQ(w[3], 1);
}

TEST(WeightsNode, ABoxHoldsItsBorder) {
  EXPECT_EQ(painted({{"region", "box"}, {"lower", List{11, 0, 0}}, {"upper", List{12, 1, 1}}}), (std::vector<float>{0, 1, 1, 0, 0}));
}

TEST(WeightsNode, ReadsColoursAndGroups) {
  Surface s = ruler();
  MeshAttributes attributes;
  attributes.vertex_colours = {{0, 0.5f, 0, 1}, {0, 0.25f, 0, 1}, {0, 0, 0, 1}, {0, 1, 0, 1}, {0, 0, 0, 1}};
  attributes.groups = {"arm", "leg"};
  attributes.face_group = {0, -1, 1};
  s.attributes = std::make_shared<MeshAttributes>(attributes);
  EXPECT_EQ(painted({{"region", "colour"}, {"channel", "green"}, {"inside", 2}}, s), (std::vector<float>{1, 0.5, 0, 2, 0}));
  EXPECT_EQ(painted({{"region", "group"}, {"group", "leg"}}, s), (std::vector<float>{0, 0, 1, 1, 1}));
  try {
    painted({{"region", "group"}, {"group", "lag"}}, s);
    FAIL();
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("did you mean 'leg'"), std::string::npos);
  }
}

TEST(WeightsNode, CombinesWithOtherWeights) {
  for (const auto& [how, wanted] : std::vector<std::pair<std::string, float>>{{"multiply", 1.0f}, {"add", 2.5f}, {"max", 2.0f}, {"min", 0.5f}}) {
    direct::DirectRun run(register_weights, "weights", {{"inside", 0.5}, {"combine", how}});
    run.give("surface", ruler()).give("onto", Weights{Buffer<float>(std::vector<float>(5, 2.0f))}).at(1);
    EXPECT_EQ(run.result<Weights>().values.host()[2], wanted) << how;
  }
}

TEST(WeightsNode, RefusesWhatItCannotPaint) {
  EXPECT_THROW(painted({{"region", "colour"}}), Error);
  EXPECT_THROW(painted({{"region", "group"}}), Error);
  EXPECT_THROW(painted({{"region", "plane"}, {"normal", List{0, 0, 0}}}), Error);
  EXPECT_THROW(painted({{"region", "box"}, {"lower", List{1, 0, 0}}, {"upper", List{0, 1, 1}}}), Error);
  direct::DirectRun run(register_weights, "weights", {});
  run.give("surface", ruler()).give("onto", Weights{Buffer<float>(std::vector<float>(3, 1.0f))});
  EXPECT_THROW(run.at(1), Error);
}

}  // namespace
}  // namespace knead::weights_test
