// Colliders that are in too deep to tell the side stand back along their way in; rings around tubes, swallowed bodies and plain presses do not.
#include "kernels/loop/approach.h"

#include <gtest/gtest.h>

#include <cmath>

#include "io/vdb/vdb.h"
#include "kernels/shapes/primitives.h"
#include "kernels/surface/mesh_distance.h"

namespace {

using knead::MeshDistance;
using knead::Sdf;
using knead::Surface;
using knead::Vec3d;
using knead::Vec3f;

const auto approach_executor = knead::make_cpu_executor(2);

template <class Distance>
Sdf approach_field(const Vec3d& half, double voxel, const Distance& distance) {
  knead::SdfPlan plan;
  plan.voxel_size = voxel;
  plan.lower = -half;
  plan.upper = half;
  return knead::build_sdf(*approach_executor, plan, [&](const Vec3d& p, uint32_t&) { return distance(p); });
}

Sdf approach_ball(double radius, const Vec3d& at) {
  Sdf ball = approach_field({radius, radius, radius}, radius / 20, [=](const Vec3d& p) { return length(p) - radius; });
  ball.placement.translation = at;
  return ball;
}

// A slab across the y axis between `low` and `high`, wide enough for anything here.
Sdf approach_plate(double low, double high) {
  const double middle = 0.5 * (low + high), half = 0.5 * (high - low);
  Sdf plate = approach_field({2, half, 2}, 0.03, [=](const Vec3d& p) {
    const Vec3d q{std::abs(p.x) - 2, std::abs(p.y) - half, std::abs(p.z) - 2};
    const Vec3d out{std::max(q.x, 0.0), std::max(q.y, 0.0), std::max(q.z, 0.0)};
    return length(out) + std::min(std::max({q.x, q.y, q.z}), 0.0);
  });
  plate.placement.translation = {0, middle, 0};
  return plate;
}

Sdf approach_torus(double radius, double tube, double y) {
  Sdf torus = approach_field({radius + tube, tube, radius + tube}, 0.03,
                             [=](const Vec3d& p) { return std::hypot(std::hypot(p.x, p.z) - radius, p.y) - tube; });
  torus.placement.translation = {0, y, 0};
  return torus;
}

std::vector<Vec3d> approach_shifts(const Surface& body, const std::vector<const Sdf*>& colliders, int* asked = nullptr) {
  knead::CollideInput input;
  input.points = body.points.host();
  input.colliders = colliders;
  std::unique_ptr<MeshDistance> mesh;
  return stand_back(*approach_executor, input, body.topology->triangles, [&]() -> const MeshDistance& {
    if (asked) ++*asked;
    mesh = std::make_unique<MeshDistance>(body.points.host(), body.topology->triangles);
    return *mesh;
  });
}

Surface approach_inside_out(Surface body) {
  auto turned = std::make_shared<knead::MeshTopology>(*body.topology);
  for (size_t t = 0; t + 2 < turned->triangles.size(); t += 3) std::swap(turned->triangles[t], turned->triangles[t + 1]);
  body.topology = turned;
  return body;
}

TEST(Approach, APlateThatCutsACapOffComesInOverIt) {
  const Sdf plate = approach_plate(0.6, 0.75);
  for (const Surface& body : {knead::make_sphere(1, 4), approach_inside_out(knead::make_sphere(1, 4))}) {
    const std::vector<Vec3d> shifts = approach_shifts(body, {&plate});
    ASSERT_EQ(shifts.size(), 1u);
    EXPECT_NEAR(shifts[0].y, 0.4, 0.03);  // from the pole at 1 down to the plate's lower side at 0.6
    EXPECT_NEAR(std::hypot(shifts[0].x, shifts[0].z), 0, 0.01);
  }
}

TEST(Approach, ABallThatIsInDeeperThanItsMiddleComesInFromOutside) {
  const Sdf ball = approach_ball(0.4, {0, 0.9, 0});
  const std::vector<Vec3d> shifts = approach_shifts(knead::make_sphere(1, 5), {&ball});
  ASSERT_EQ(shifts.size(), 1u);
  EXPECT_NEAR(shifts[0].y, 0.5, 0.03);  // its lowest point is at 0.5, the body's highest at 1
}

TEST(Approach, ARingOnAFlankComesInWithoutWhatStandsInItsHole) {
  const Sdf ring = approach_torus(0.5, 0.12, 0.88);
  const std::vector<Vec3d> shifts = approach_shifts(knead::make_sphere(1, 5), {&ring});
  ASSERT_EQ(shifts.size(), 1u);
  EXPECT_GT(shifts[0].y, 0.05);
  EXPECT_LT(shifts[0].y, 0.25);
}

TEST(Approach, EachColliderHasItsOwnWay) {
  const Sdf above = approach_ball(0.4, {0, 0.9, 0}), below = approach_ball(0.4, {0, -0.9, 0}), shallow = approach_ball(0.4, {1.3, 0, 0});
  const std::vector<Vec3d> shifts = approach_shifts(knead::make_sphere(1, 5), {&above, &shallow, &below});
  ASSERT_EQ(shifts.size(), 3u);
  EXPECT_GT(shifts[0].y, 0.4);
  EXPECT_EQ(length(shifts[1]), 0);
  EXPECT_LT(shifts[2].y, -0.4);
}

TEST(Approach, ARingAroundAFingerASwallowedBodyAndAPlainPressStayInPlace) {
  const Surface finger = knead::make_capsule(0.3, 3, 24), body = knead::make_sphere(1, 4);
  for (const double hole : {0.25, 0.29}) {
    const Sdf ring = approach_torus(hole + 0.2, 0.2, 0);
    EXPECT_TRUE(approach_shifts(finger, {&ring}).empty());
  }
  const Sdf large = approach_ball(2, {0, 0, 0}), beside = approach_ball(0.5, {0, 1.35, 0});
  EXPECT_TRUE(approach_shifts(body, {&large}).empty());
  EXPECT_TRUE(approach_shifts(body, {&beside}).empty());
}

TEST(Approach, AsksForNoRaysWhereNothingTouches) {
  const Sdf plate = approach_plate(1.5, 1.7);
  int asked = 0;
  EXPECT_TRUE(approach_shifts(knead::make_sphere(1, 3), {&plate}, &asked).empty());
  EXPECT_TRUE(approach_shifts(knead::make_sphere(1, 3), {}, &asked).empty());
  EXPECT_EQ(asked, 0);
}

TEST(Approach, ShiftedCollidersPushAsIfTheyStoodThere) {
  const Sdf here = approach_ball(0.4, {0, 0.9, 0}), there = approach_ball(0.4, {0.1, 1.2, 0});
  const Surface body = knead::make_sphere(1, 3);
  const size_t n = body.vertices();
  std::vector<Vec3f> shifted(n), moved(n);
  std::vector<float> memory(n);
  // A third of its way in is left.
  const std::vector<Vec3f> shift{{0.3f, 0.9f, 0}};
  knead::ContactProgress before, after;
  before.step = 1;
  before.steps = 3;
  const std::vector<const Sdf*> one{&here}, other{&there};
  knead::CollideInput input;
  input.points = body.points.host();
  input.most = 1;
  input.colliders = one;
  input.stand_back = shift;
  input.before = &before;
  input.diagonal = 1;
  knead::collide_push(*approach_executor, input, shifted.data(), memory.data(), &after);
  EXPECT_GT(after.inside, 0u);
  EXPECT_EQ(after.step, 2);
  EXPECT_FLOAT_EQ(static_cast<float>(after.unrest), length(Vec3f{0.1f, 0.3f, 0})) << "a loop must not end on the way";
  input.colliders = other;
  input.stand_back = {};
  input.before = nullptr;
  knead::collide_push(*approach_executor, input, moved.data(), memory.data(), &after);
  EXPECT_LT(after.unrest, 0.3);
  for (size_t i = 0; i < n; ++i) EXPECT_LT(length(shifted[i] - moved[i]), 1e-5f) << i;
}

}  // namespace
