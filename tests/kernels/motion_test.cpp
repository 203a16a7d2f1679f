#include "kernels/motion.h"

#include <gtest/gtest.h>

#include <cmath>

#include "kernels/shapes/primitives.h"

namespace knead::motion_test {
namespace {

Vec3d turned(const Quaternion& q, const Vec3d& v) {
  Similarity s;
  s.rotation = q.matrix();
  return s.rotate(v);
}
void expect_near(const Vec3d& a, const Vec3d& b, double within = 1e-12) {
  EXPECT_NEAR(length(a - b), 0, within) << a.x << " " << a.y << " " << a.z;
}

PoseKey key(double frame, const Vec3d& translate, const Quaternion& rotate = {}) {
  PoseKey k{frame, {}};
  k.pose.translate = translate;
  k.pose.rotate = rotate;
  return k;
}

TEST(Motion, RotatesAboutXFirstThenYThenZ) {
  expect_near(turned(rotation_xyz({90, 0, 0}), {0, 1, 0}), {0, 0, 1});
  expect_near(turned(rotation_xyz({90, 90, 0}), {0, 1, 0}), {1, 0, 0});
  expect_near(turned(rotation_xyz({90, 90, 90}), {0, 1, 0}), {0, 1, 0});
  expect_near(turned(rotation_about({0, 0, 5}, 90), {1, 0, 0}), {0, 1, 0});
}

TEST(Motion, HoldsTheEndsAndReturnsKeysBitForBit) {
  const std::vector<PoseKey> keys{key(3, {0.1, 0, 0}), key(7, {0.7, 0, 0}), key(9, {0.3, 0, 0})};
  for (const Interpolation how : {Interpolation::kLinear, Interpolation::kSmooth}) {
    EXPECT_EQ(pose_at(keys, -5, how).translate.x, 0.1);
    EXPECT_EQ(pose_at(keys, 7, how).translate.x, 0.7);
    EXPECT_EQ(pose_at(keys, 100, how).translate.x, 0.3);
  }
  EXPECT_DOUBLE_EQ(pose_at(keys, 4, Interpolation::kLinear).translate.x, 0.25);
}

TEST(Motion, SmoothStartsGentlyAndNeverGoesBeyondTheKeys) {
  const std::vector<PoseKey> keys{key(0, {0, 0, 0}), key(10, {1, 0, 0}), key(11, {1.01, 0, 0}), key(30, {0.5, 0, 0})};
  EXPECT_LT(pose_at(keys, 0.1, Interpolation::kSmooth).translate.x, 0.001);
  double before = 0;
  for (int i = 0; i <= 110; ++i) {
    const double x = pose_at(keys, i * 0.1, Interpolation::kSmooth).translate.x;
    EXPECT_GE(x, before - 1e-15);
    EXPECT_LE(x, 1.01);
    before = x;
  }
  for (int i = 110; i <= 300; ++i) {
    const double x = pose_at(keys, i * 0.1, Interpolation::kSmooth).translate.x;
    EXPECT_LE(x, before + 1e-15);
    before = x;
  }
}

TEST(Motion, SmoothHasAContinuousSpeedOverAKey) {
  const std::vector<PoseKey> keys{key(0, {0, 0, 0}, {}), key(10, {1, 0, 0}, rotation_about({0, 0, 1}, 60)),
                                  key(16, {3, 0, 0}, rotation_about({0, 0, 1}, 150))};
  const auto at = [&](double f) { return pose_at(keys, f, Interpolation::kSmooth).translate.x; };
  const auto angle = [&](double f) { return std::acos(pose_at(keys, f, Interpolation::kSmooth).rotate.w); };
  const double h = 1e-4;
  EXPECT_NEAR((at(10) - at(10 - h)) / h, (at(10 + h) - at(10)) / h, 1e-4);
  EXPECT_GT((at(10) - at(10 - h)) / h, 0.05);
  EXPECT_NEAR((angle(10) - angle(10 - h)) / h, (angle(10 + h) - angle(10)) / h, 1e-4);
}

TEST(Motion, SlerpTurnsAtAConstantSpeedTheShorterWay) {
  const Quaternion a = rotation_about({0, 1, 0}, 170), b = rotation_about({0, 1, 0}, -170);
  expect_near(turned(slerp(a, b, 0.5), {1, 0, 0}), {-1, 0, 0});
  const Quaternion q = slerp({}, rotation_about({1, 2, 3}, 90), 1.0 / 3), third = rotation_about({1, 2, 3}, 30);
  EXPECT_NEAR(q.w, third.w, 1e-12);
  EXPECT_NEAR(q.y, third.y, 1e-12);
  expect_near(turned(slerp({}, {}, 0.5), {1, 2, 3}), {1, 2, 3});
}

TEST(Motion, PosedSharesThePointsUnderUniformScale) {
  const Surface ball = make_sphere(1, 2);
  Pose pose;
  pose.translate = {1, 2, 3};
  pose.rotate = rotation_xyz({10, 20, 30});
  pose.scale = {2, 2, 2};
  pose.pivot = {0, 1, 0};
  const Surface moved = posed(posed(ball, pose), pose);
  EXPECT_EQ(moved.points.id(), ball.points.id());
  const auto by_hand = [&](const Vec3d& x) { return pose.translate + pose.pivot + turned(pose.rotate, 2.0 * (x - pose.pivot)); };
  for (const Vec3f& p : ball.points.host()) expect_near(moved.placement.apply(to_double(p)), by_hand(by_hand(to_double(p))), 1e-10);
}

TEST(Motion, PosedBakesScaleThatDiffersByAxisUnderAnyPlacement) {
  Surface ball = make_sphere(1, 2);
  ball.placement.rotation = rotation_xyz({40, 50, 60}).matrix();
  ball.placement.translation = {5, 0, 0};
  ball.placement.scale = 3;
  Pose pose;
  pose.scale = {1, 2, 0.5};
  pose.rotate = rotation_xyz({15, -25, 35});
  pose.pivot = {1, 1, 1};
  pose.translate = {0, -4, 2};
  const Surface moved = posed(ball, pose);
  EXPECT_NE(moved.points.id(), ball.points.id());
  for (size_t i = 0; i < ball.vertices(); ++i) {
    const Vec3d x = ball.placement.apply(to_double(ball.points.host()[i])) - pose.pivot;
    const Vec3d wanted = pose.translate + pose.pivot + turned(pose.rotate, {x.x, 2 * x.y, 0.5 * x.z});
    expect_near(moved.placement.apply(to_double(moved.points.host()[i])), wanted, 1e-5);
    for (int k = 0; k < 3; ++k) {
      EXPECT_GE(moved.points.host()[i][k], moved.lower[k]);
      EXPECT_LE(moved.points.host()[i][k], moved.upper[k]);
    }
  }
}

TEST(Motion, TheIdentityChangesNoBit) {
  Surface ball = make_sphere(1, 1);
  ball.placement.translation = {0.1, 0.2, 0.3};
  ball.placement.rotation = rotation_xyz({1, 2, 3}).matrix();
  EXPECT_TRUE(posed(ball, {}).placement == ball.placement);
}

}  // namespace
}  // namespace knead::motion_test
