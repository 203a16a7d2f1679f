#include <gtest/gtest.h>

#include <filesystem>

#include "direct_run.h"
#include "io/picture/picture.h"
#include "kernels/motion.h"
#include "kernels/shapes/primitives.h"

namespace knead {
void register_write_picture(Registry&);
}

namespace knead::write_picture_test {
namespace {

using List = Literal::List;

std::string scratch(const std::string& name) {
  return (std::filesystem::path(testing::TempDir()) / "knead_write_picture_test" / name).string();
}

direct::DirectRun drawing(Literal::Map arguments, const std::string& path) {
  arguments.push_back({"path", path});
  arguments.push_back({"width", 96});
  arguments.push_back({"height", 72});
  arguments.push_back({"samples", 4});
  return {register_write_picture, "write_picture", arguments};
}

Surface pressed(const Surface& ball) {  // the top of the ball pushed down
  std::vector<Vec3f> points(ball.points.host().begin(), ball.points.host().end());
  for (Vec3f& p : points) p.y = std::min(p.y, 0.6f);
  Surface flat = ball;
  flat.points = Buffer<Vec3f>(points);
  return flat;
}

std::string error_of(const Literal::Map& arguments) {
  try {
    drawing(arguments, "x.png");
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

TEST(WritePicture, WritesAPictureOfEachFrame) {
  auto run = drawing({{"caption", "frame ##"}}, scratch("ball.####.png"));
  EXPECT_TRUE(run.node().has_effect());
  EXPECT_TRUE(run.node().depends_on_frame());
  run.give("surface", make_sphere(1, 3)).at(7);
  const Image image = read_png(scratch("ball.0007.png"));
  EXPECT_EQ(image.width, 96);
  EXPECT_EQ(image.height, 72);
  EXPECT_FALSE(drawing({}, "one.png").node().depends_on_frame());
}

TEST(WritePicture, ColoursByDisplacementPenetrationAndValues) {
  const Surface ball = make_sphere(1, 3), above = posed(make_sphere(0.6, 3), {.translate = {0, 1, 0}});
  drawing({}, scratch("plain.png")).give("surface", pressed(ball)).give("rest", ball).at(1);
  const Image plain = read_png(scratch("plain.png"));
  for (const std::string colour : {"displacement", "penetration", "volume_change", "weights"}) {
    auto run = drawing({{"colour", colour}, {"look", "hidden"}}, scratch(colour + ".png"));
    run.give("surface", pressed(ball)).give("rest", ball).give("colliders", above);
    run.give("values", Weights{Buffer<float>(std::vector<float>(ball.vertices(), 0.5f))}).at(1);
    EXPECT_NE(read_png(scratch(colour + ".png")).rgb, plain.rgb) << colour;
  }
}

TEST(WritePicture, BuildsACollidersDistanceOnceOverItsMotion) {
  const Surface ball = make_sphere(1, 2), fist = make_sphere(0.5, 2);
  auto run = drawing({{"colour", "penetration"}}, scratch("motion.####.png"));
  run.give("surface", ball).give("colliders", fist).give("colliders", posed(fist, {.translate = {0, 1, 0}}));
  run.at(1);
  EXPECT_EQ(run.made_once(), 1);  // the two share their points
  run.at(2);
  EXPECT_EQ(run.made_once(), 1);
}

TEST(WritePicture, SaysWhatAColourNeeds) {
  for (const std::string colour : {"displacement", "volume_change", "weights"}) {
    auto run = drawing({{"colour", colour}}, scratch("never.png"));
    run.give("surface", make_sphere(1, 1));
    EXPECT_THROW(run.at(1), Error) << colour;
  }
  auto run = drawing({{"colour", "weights"}}, scratch("never.png"));
  run.give("surface", make_sphere(1, 1)).give("values", Weights{Buffer<float>(3)});
  EXPECT_THROW(run.at(1), Error);
  EXPECT_FALSE(std::filesystem::exists(scratch("never.png")));
}

TEST(WritePicture, LeavesNothingBehindWhenCancelled) {
  auto run = drawing({}, scratch("cancelled.png"));
  run.give("surface", make_sphere(1, 1));
  run.cancel = true;
  EXPECT_THROW(run.at(1), Error);
  EXPECT_FALSE(std::filesystem::exists(scratch("cancelled.png")));
}

TEST(WritePicture, ChecksItsCameraBeforeAnyFrame) {
  EXPECT_NE(error_of({{"view", "frnt"}}).find("did you mean 'front'"), std::string::npos);
  EXPECT_NE(error_of({{"view", List{0, 2, 0}}}).find("looks along"), std::string::npos);
  EXPECT_NE(error_of({{"view", List{0, 0, 0}}}).find("no length"), std::string::npos);
  EXPECT_NE(error_of({{"up", "w"}}).find("no axis"), std::string::npos);
  EXPECT_NE(error_of({{"range", List{2, 1}}}).find("empty"), std::string::npos);
  EXPECT_NE(error_of({{"frame_box", List{0, 0, 0}}}).find("expected 6 numbers"), std::string::npos);
  EXPECT_NE(error_of({{"focus", "nose"}}).find("expected 3 numbers"), std::string::npos);
  EXPECT_EQ(error_of({{"view", List{1, 1, 1}}, {"up", "z"}, {"focus", List{0, 0, 0}}, {"range", List{0, 1}}}), "");
}

}  // namespace
}  // namespace knead::write_picture_test
