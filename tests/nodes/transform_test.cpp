#include <gtest/gtest.h>

#include <cmath>

#include "direct_run.h"
#include "kernels/shapes/primitives.h"

namespace knead {
void register_transform(Registry&);
}

namespace knead::transform_test {
namespace {

using Map = Literal::Map;
using List = Literal::List;

direct::DirectRun moving(const Map& arguments) {
  direct::DirectRun run(register_transform, "transform", arguments);
  run.give("mesh", make_sphere(1, 1));
  return run;
}
Vec3d origin_at(direct::DirectRun& run, int frame) {
  return run.at(frame).result<Surface>().placement.apply({0, 0, 0});
}
std::string error_of(const Map& arguments) {
  try {
    moving(arguments);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

TEST(Transform, MovesTurnsAndScalesOnce) {
  auto run = moving({{"translate", List{1, 2, 3}}, {"rotate", List{0, 0, 90}}, {"scale", 2}});
  EXPECT_FALSE(run.node().depends_on_frame());
  const Vec3d x = run.at(5).result<Surface>().placement.apply({1, 0, 0});
  EXPECT_NEAR(length(x - Vec3d{1, 4, 3}), 0, 1e-12);
}

TEST(Transform, FollowsItsKeysAndHoldsTheEnds) {
  auto run = moving({{"keys", Map{{11, Map{{"translate", List{0, 0, 1}}}}, {1, Map{{"translate", List{0, 0, 2}}}}}}});
  EXPECT_TRUE(run.node().depends_on_frame());
  EXPECT_EQ(origin_at(run, -3).z, 2);
  EXPECT_EQ(origin_at(run, 1).z, 2);
  EXPECT_DOUBLE_EQ(origin_at(run, 6).z, 1.5);
  EXPECT_EQ(origin_at(run, 99).z, 1);
}

TEST(Transform, SharesThePointsAtEveryFrame) {
  auto run = moving({{"keys", Map{{1, Map{{"rotate", List{0, 0, 0}}}}, {9, Map{{"rotate", Map{{"axis", List{0, 2, 0}}, {"degrees", 90}}}}}}}});
  const uint64_t id = run.input(0, 0).as<Surface>().points.id();
  for (int frame : {1, 4, 9}) EXPECT_EQ(run.at(frame).result<Surface>().points.id(), id);
  const Vec3d x = run.at(5).result<Surface>().placement.apply({1, 0, 0});
  EXPECT_NEAR(x.x, std::sqrt(0.5), 1e-12);
  EXPECT_NEAR(x.z, -std::sqrt(0.5), 1e-12);
}

TEST(Transform, AKeyTakesWhatItLeavesOutFromTheParameters) {
  auto run = moving({{"translate", List{7, 0, 0}}, {"scale", 3}, {"keys", Map{{1, Map{}}, {2, Map{{"translate", List{0, 1, 0}}}}}}});
  EXPECT_EQ(origin_at(run, 1).x, 7);
  EXPECT_EQ(origin_at(run, 2).x, 0);
  EXPECT_EQ(run.at(2).result<Surface>().placement.scale, 3);
}

TEST(Transform, OneKeyIsNoMotion) {
  EXPECT_FALSE(moving({{"keys", Map{{5, Map{{"scale", 2}}}}}}).node().depends_on_frame());
}

TEST(Transform, TakesFramesAsJsonWritesThem) {
  auto run = moving({{"keys", Map{{"1", Map{}}, {"3", Map{{"translate", List{4, 0, 0}}}}}}});
  EXPECT_DOUBLE_EQ(origin_at(run, 2).x, 2);
}

TEST(Transform, SmoothStaysBetweenItsKeys) {
  auto run = moving(
      {{"interpolation", "smooth"}, {"keys", Map{{1, Map{}}, {5, Map{{"translate", List{1, 0, 0}}}}, {6, Map{{"translate", List{1, 0, 0}}}}}}});
  EXPECT_DOUBLE_EQ(origin_at(run, 3).x, 0.5);
  EXPECT_LT(origin_at(run, 2).x, 0.25);
  for (int frame = 1; frame < 7; ++frame) EXPECT_LE(origin_at(run, frame).x, 1);
}

TEST(Transform, ErrorsNameTheKeyAndTheNearestField) {
  const std::string slip = error_of({{"keys", Map{{12, Map{{"translat", List{0, 0, 0}}}}}}});
  EXPECT_NE(slip.find("key 12"), std::string::npos) << slip;
  EXPECT_NE(slip.find("did you mean 'translate'"), std::string::npos) << slip;
  EXPECT_NE(error_of({{"keys", Map{{3, Map{{"scale", -1}}}}}}).find("key 3: scale must be positive"), std::string::npos);
  EXPECT_NE(error_of({{"keys", Map{{3, Map{{"translate", List{0, 1}}}}}}}).find("key 3: translate"), std::string::npos);
  EXPECT_NE(error_of({{"keys", Map{{3, Map{{"rotate", Map{{"axis", List{0, 0, 0}}, {"degrees", 3}}}}}}}}).find("no length"), std::string::npos);
  EXPECT_NE(error_of({{"keys", Map{{"soon", Map{}}}}}).find("is not a frame"), std::string::npos);
  EXPECT_NE(error_of({{"keys", Map{{1, Map{}}, {"1", Map{}}}}}).find("a key already"), std::string::npos);
  EXPECT_NE(error_of({{"keys", List{1, 2}}}).find("expected a map"), std::string::npos);
  EXPECT_NE(error_of({{"scale", List{1, 0, 1}}}).find("scale must be positive"), std::string::npos);
  EXPECT_NE(error_of({{"rotate", List{1, "x", 1}}}).find("rotate"), std::string::npos);
  EXPECT_EQ(error_of({{"keys", Map{{1, Map{}}}}}), "");
}

}  // namespace
}  // namespace knead::transform_test
