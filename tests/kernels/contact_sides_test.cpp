// Which side of a collider vertices belong to: caps cut off by a plate go back, tubes in rings and swallowed bodies go the nearest way.
#include "kernels/contact_sides.h"

#include <gtest/gtest.h>

#include <cmath>

#include "io/vdb.h"
#include "kernels/mesh_distance.h"
#include "kernels/primitives.h"

namespace {

using knead::Buffer;
using knead::ContactSides;
using knead::MeshDistance;
using knead::Sdf;
using knead::Surface;
using knead::Vec3d;
using knead::Vec3f;

const auto sides_executor = knead::make_cpu_executor(2);

template <class Distance>
Sdf sides_field(const Vec3d& half, double voxel, const Distance& distance) {
  knead::SdfPlan plan;
  plan.voxel_size = voxel;
  plan.lower = -half;
  plan.upper = half;
  return knead::build_sdf(*sides_executor, plan, [&](const Vec3d& p, uint32_t&) { return distance(p); });
}

// A slab across the y axis between `low` and `high`, wide enough for anything here.
Sdf sides_plate(double low, double high) {
  const double middle = 0.5 * (low + high), half = 0.5 * (high - low);
  Sdf plate = sides_field({2, half, 2}, 0.03, [=](const Vec3d& p) {
    const Vec3d q{std::abs(p.x) - 2, std::abs(p.y) - half, std::abs(p.z) - 2};
    const Vec3d out{std::max(q.x, 0.0), std::max(q.y, 0.0), std::max(q.z, 0.0)};
    return length(out) + std::min(std::max({q.x, q.y, q.z}), 0.0);
  });
  plate.placement.translation = {0, middle, 0};
  return plate;
}

Sdf sides_torus(double radius, double tube) {
  return sides_field({radius + tube, tube, radius + tube}, 0.03, [=](const Vec3d& p) { return std::hypot(std::hypot(p.x, p.z) - radius, p.y) - tube; });
}

ContactSides sides_of(const Surface& body, const std::vector<const Sdf*>& colliders, int* asked = nullptr) {
  knead::CollideInput input;
  input.points = body.points.host();
  input.colliders = colliders;
  std::unique_ptr<MeshDistance> mesh;
  return contact_sides(*sides_executor, input, body.topology->triangles, [&]() -> const MeshDistance& {
    if (asked) ++*asked;
    mesh = std::make_unique<MeshDistance>(body.points.host(), body.topology->triangles);
    return *mesh;
  });
}

Surface sides_inside_out(Surface body) {
  auto turned = std::make_shared<knead::MeshTopology>(*body.topology);
  for (size_t t = 0; t + 2 < turned->triangles.size(); t += 3) std::swap(turned->triangles[t], turned->triangles[t + 1]);
  body.topology = turned;
  return body;
}

TEST(ContactSides, SendsACapBackThatAPlateCutsOff) {
  const Sdf plate = sides_plate(0.6, 0.75);
  for (const Surface& body : {knead::make_sphere(1, 4), sides_inside_out(knead::make_sphere(1, 4))}) {
    const ContactSides sides = sides_of(body, {&plate});
    ASSERT_EQ(sides.ways.size(), body.vertices());
    for (size_t i = 0; i < body.vertices(); ++i) {
      const double y = body.points.host()[i].y;
      const Vec3f& way = sides.ways.host()[i];
      EXPECT_EQ(sides.trapped.host()[i] != 0, y > 0.755) << y;
      if (y > 0.61) {
        EXPECT_LT(way.y, -0.99f * length(way)) << y;
        EXPECT_NEAR(length(way), 4.0 / 3 * (1 - 0.216) / 0.64, 0.04);  // the mean chord below a cap of radius 0.8
      }
      if (y < 0.59) EXPECT_EQ(length(way), 0) << y;
    }
  }
}

TEST(ContactSides, ThePushTakesTheCapThroughThePlateAndThenLeavesItAlone) {
  const Sdf plate = sides_plate(0.6, 0.75);
  const Surface body = knead::make_sphere(1, 3);
  const ContactSides sides = sides_of(body, {&plate});
  const std::vector<const Sdf*> colliders{&plate};
  std::vector<Vec3f> points(body.points.host().begin(), body.points.host().end()), push(points.size());
  std::vector<float> memory(points.size());
  knead::CollideInput input;
  input.colliders = colliders;
  input.most = 1;
  input.ways = sides.ways.host();
  input.trapped = sides.trapped.host();
  size_t astray = 1;
  for (int round = 0; round < 20 && astray > 0; ++round) {
    input.points = points;
    astray = knead::collide_push(*sides_executor, input, push.data(), memory.data()).astray;
    for (size_t i = 0; i < points.size(); ++i) points[i] += 0.5f * push[i];  // as reluctantly as the other steps of the loop
  }
  EXPECT_EQ(astray, 0u);
  for (const Vec3f& p : points) EXPECT_LT(p.y, 0.68f);
}

TEST(ContactSides, LeavesAFingerInARingToTheNearestWay) {
  const Surface finger = knead::make_capsule(0.3, 3, 24);
  for (const double hole : {0.25, 0.29}) {
    const Sdf ring = sides_torus(hole + 0.2, 0.2);
    const ContactSides sides = sides_of(finger, {&ring});
    EXPECT_FALSE(sides.ways);
  }
}

TEST(ContactSides, LeavesASwallowedBodyToTheNearestWay) {
  const Sdf ball = sides_field({1, 1, 1}, 0.04, [](const Vec3d& p) { return length(p) - 1; });
  EXPECT_FALSE(sides_of(knead::make_sphere(0.5, 3), {&ball}).ways);
}

TEST(ContactSides, ChangesNothingInAPlainPress) {
  Sdf ball = sides_field({0.5, 0.5, 0.5}, 0.03, [](const Vec3d& p) { return length(p) - 0.5; });
  ball.placement.translation = {0, 1.35, 0};
  const Surface body = knead::make_sphere(1, 4);
  const ContactSides sides = sides_of(body, {&ball});
  const std::vector<const Sdf*> colliders{&ball};
  const size_t n = body.vertices();
  std::vector<Vec3f> with(n), without(n);
  std::vector<float> memory(n);
  knead::CollideInput input;
  input.points = body.points.host();
  input.colliders = colliders;
  input.most = 1;
  EXPECT_GT(knead::collide_push(*sides_executor, input, without.data(), memory.data()).inside, 10u);
  input.ways = sides.ways.host();
  input.trapped = sides.trapped.host();
  EXPECT_EQ(knead::collide_push(*sides_executor, input, with.data(), memory.data()).astray, 0u);
  for (size_t i = 0; i < n; ++i) EXPECT_EQ(length(with[i] - without[i]), 0) << i;
}

TEST(ContactSides, AsksForNoRaysWhereNothingTouches) {
  const Sdf plate = sides_plate(1.5, 1.7);
  int asked = 0;
  EXPECT_FALSE(sides_of(knead::make_sphere(1, 3), {&plate}, &asked).ways);
  EXPECT_FALSE(sides_of(knead::make_sphere(1, 3), {}, &asked).ways);
  EXPECT_EQ(asked, 0);
}

}  // namespace
