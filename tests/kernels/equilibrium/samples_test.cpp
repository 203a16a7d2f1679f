// Points inside M's triangles that are kept outside the colliders, and where they are asked for.
#include "kernels/equilibrium/samples.h"

#include <gtest/gtest.h>

#include <numeric>

#include "kernels/equilibrium/sample_density.h"
#include "kernels/loop/collide.h"
#include "tests/kernels/equilibrium/pressed_bodies.h"

namespace knead {
namespace samples_test {

using namespace pressed_bodies;

// A table as H would be M itself: a vertex of H for each of M.
SampleTable table_of(const Surface& surface) {
  SampleTable table;
  table.vertices = static_cast<uint32_t>(surface.vertices());
  table.offsets.resize(table.vertices + 1);
  std::iota(table.offsets.begin(), table.offsets.end(), 0u);
  table.indices.assign(table.offsets.begin(), table.offsets.end() - 1);
  table.weights.assign(table.vertices, 1);
  const auto points = surface.points.host();
  table.rest.assign(points.begin(), points.end());
  return table;
}

SampleTable cut(const Surface& surface, const std::vector<uint8_t>& steps) {
  return refined_samples(table_of(surface), surface.topology->triangles, steps, surface.vertices(), true);
}

double area_of(const SampleTable& table, const std::vector<uint32_t>& triangles) {
  double sum = 0;
  for (size_t t = 0; t < triangles.size(); t += 3) {
    const Vec3d a = to_double(table.rest[triangles[t]]);
    sum += 0.5 * length(cross(to_double(table.rest[triangles[t + 1]]) - a, to_double(table.rest[triangles[t + 2]]) - a));
  }
  return sum;
}

TEST(Samples, AreSharedOnEdgesAndShareTheArea) {
  const Surface ball = make_sphere(1, 1);
  const size_t triangles = ball.topology->triangles.size() / 3, edges = 3 * triangles / 2;
  for (const uint8_t steps : {1, 2, 3, 8}) {
    const SampleTable table = cut(ball, std::vector<uint8_t>(triangles, steps));
    const size_t inside = static_cast<size_t>((steps - 1) * (steps - 2) / 2);
    EXPECT_EQ(table.size(), ball.vertices() + edges * (steps - 1u) + triangles * inside) << int{steps};
    EXPECT_EQ(table.triangles.size(), 3 * triangles * steps * steps);
    const double area = area_of(table, ball.topology->triangles);
    EXPECT_NEAR(area_of(table, table.triangles), area, 1e-5 * area);
    EXPECT_NEAR(std::accumulate(table.area.begin(), table.area.end(), 0.0), area, 1e-4 * area) << "no sample of a ball is too small";
    Vec3d closed{0, 0, 0};
    for (const Vec3f& outward : table.outward) closed += to_double(outward);
    EXPECT_LT(length(closed), 1e-5);
  }
}

TEST(Samples, OfNeighboursThatAreCutDifferentlyMeetOnTheirEdge) {
  const Surface ball = make_sphere(1, 1);
  std::vector<uint8_t> steps(ball.topology->triangles.size() / 3, 2);
  steps[0] = 4;
  const SampleTable table = cut(ball, steps), coarse = cut(ball, std::vector<uint8_t>(steps.size(), 2));
  EXPECT_EQ(table.size(), coarse.size() + 3 * 2 + 3) << "two more on each of three edges, three inside";
  for (size_t s = table.vertices; s < table.size(); ++s) {
    float sum = 0;
    for (uint32_t e = table.offsets[s]; e < table.offsets[s + 1]; ++e) sum += table.weights[e];
    EXPECT_NEAR(sum, 1, 1e-6);
  }
}

TEST(SampleDensity, AsksForSamplesWhereAThinColliderIsNear) {
  const Surface ball_of_flesh = make_sphere(1, 3);
  const SampleTable table = cut(ball_of_flesh, std::vector<uint8_t>(ball_of_flesh.topology->triangles.size() / 3, 1));
  const std::vector<uint32_t>& triangles = ball_of_flesh.topology->triangles;
  const auto executor = make_serial_executor();
  const auto density = [&](double radius, const Vec3d& at, const Vec3f& entry = {0, 0, 0}) {
    const Sdf field = ball(radius, at);
    const ColliderSize size{view_collider(field, Device{}, Similarity{}), radius};
    return sample_density(*executor, table, triangles, std::span(&size, 1), entry, 4, 1);
  };
  EXPECT_TRUE(density(0.5, {0, 1.3, 0}).empty()) << "as coarse as it is, M meets a thick collider";
  EXPECT_TRUE(density(0.03, {0, 3, 0}).empty()) << "far away";
  const std::vector<uint8_t> steps = density(0.03, {0, 0.97, 0});
  ASSERT_EQ(steps.size(), triangles.size() / 3);
  for (size_t t = 0; t < steps.size(); ++t) {
    const Vec3f middle = (1.0f / 3) * (table.rest[triangles[3 * t]] + table.rest[triangles[3 * t + 1]] + table.rest[triangles[3 * t + 2]]);
    if (middle.y > 0.99f) EXPECT_GE(steps[t], 4);
    if (middle.y < 0.5f) EXPECT_EQ(steps[t], 1);
  }
  EXPECT_FALSE(density(0.03, {0, 0.5, 0}, {0, -1, 0}).empty()) << "it came in from above";
}

// A pin that is thinner than M's edges makes a dent as deep as the pin is in, and no face is left in the pin.
TEST(ThinColliders, AreNotPiercedByFacesNorSlipThroughThem) {
  Pressed pressed(make_sphere(1, 3), {}, 5);
  const double radius = 0.05;
  const auto executor = make_serial_executor();
  SdfPlan plan;
  plan.voxel_size = radius / 6;
  plan.lower = {-radius, 0, -radius};
  plan.upper = {radius, 1, radius};
  Sdf pin = build_sdf(*executor, plan, [&](const Vec3d& p, uint32_t&) {
    const Vec3d tip{0, radius, 0}, top{0, 1 - radius, 0};
    const double along = std::clamp((p.y - tip.y) / (top.y - tip.y), 0.0, 1.0);
    return length(p - (tip + along * (top - tip))) - radius;
  });
  pin.placement.translation = {0.03, 0.8, 0.02};
  pressed.by({&pin}, "a pin");
  EXPECT_EQ(pressed.figures.ended, Ended::kAtRest);
  EXPECT_GT(pressed.figures.least_volume, 0);
  EXPECT_LE(pressed.figures.iterations, pressed.settings.max_iterations);
  double lowest = 1;
  for (const Vec3f& local : pressed.points.host()) {
    const Vec3d at = pressed.built.lattice.rest.placement.apply(to_double(local));
    if (std::hypot(at.x - 0.03, at.z - 0.02) < 0.2 && at.y > 0) lowest = std::min(lowest, at.y);
  }
  EXPECT_LT(lowest, 0.85) << "the skin is carried along, not moved aside";
}

}  // namespace samples_test
}  // namespace knead
