#include "kernels/loop/hold.h"

#include <gtest/gtest.h>

#include <cstring>
#include <numbers>

#include "graph/error.h"
#include "tests/kernels/loop/loop_fixture.h"

namespace {

namespace fixture = knead::loop_fixture;
using knead::Buffer;
using knead::HoldSettings;
using knead::RigidFit;
using knead::Vec3d;
using knead::Vec3f;

Vec3f hold_turned(const Vec3f& p, double degrees, const Vec3d& shift) {
  const double a = degrees * std::numbers::pi / 180, c = std::cos(a), s = std::sin(a);
  const Vec3d q = to_double(p);
  return to_float(Vec3d{c * q.x - s * q.z, q.y, s * q.x + c * q.z} + shift);
}

TEST(Hold, UndoesARigidMotionWhateverTheAngle) {
  const auto executor = knead::make_cpu_executor(2);
  const fixture::Scene scene = fixture::ball(0.3, 1, *executor);
  for (const double degrees : {0.01, 30.0, 120.0, 180.0}) {
    std::vector<Vec3f> moved;
    for (const Vec3f& p : scene.tets.rest.host()) moved.push_back(hold_turned(p, degrees, {3, -1, 0.5}));
    const Buffer<Vec3f> back = hold(*executor, Buffer<Vec3f>(moved), scene.tets, nullptr, {});
    for (size_t j = 0; j < back.size(); ++j) ASSERT_LT(length(back.host()[j] - scene.tets.rest.host()[j]), 2e-6f) << degrees;
  }
}

TEST(Hold, LeavesADeformationWithoutNetMotionAlone) {
  const auto executor = knead::make_cpu_executor(2);
  const fixture::Scene scene = fixture::ball(0.3, 1, *executor);
  std::vector<Vec3f> stretched = fixture::vector_of(scene.tets.rest);
  for (Vec3f& p : stretched) p = {1.2f * p.x, 0.9f * p.y, p.z};
  const Buffer<Vec3f> same = hold(*executor, Buffer<Vec3f>(stretched), scene.tets, nullptr, {});
  // The grid is not quite symmetric about the origin, so the stretch has a little net motion: a thousandth of the displacements of up to 0.7 cells.
  for (size_t j = 0; j < same.size(); ++j) ASSERT_LT(length(same.host()[j] - stretched[j]), 2e-3f);
}

TEST(Hold, RigidFitNeverReflectsAndTakesFlatAndCollapsedBodies) {
  const auto executor = knead::make_serial_executor();
  const fixture::Scene scene = fixture::ball(0.4, 1, *executor);
  for (const Vec3f& scale : {Vec3f{-1, 1, 1}, Vec3f{1, 0, 1}, Vec3f{0, 0, 1}, Vec3f{0, 0, 0}}) {
    std::vector<Vec3f> x = fixture::vector_of(scene.tets.rest);
    for (Vec3f& p : x) p = {scale.x * p.x, scale.y * p.y, scale.z * p.z};
    const RigidFit fit = rigid_fit(*executor, Buffer<Vec3f>(x), scene.tets);
    const double* r = fit.rotation;
    const Vec3d a{r[0], r[1], r[2]}, b{r[3], r[4], r[5]}, c{r[6], r[7], r[8]};
    EXPECT_NEAR(dot(a, cross(b, c)), 1, 1e-9);
    EXPECT_NEAR(dot(a, a) + dot(b, b) + dot(c, c), 3, 1e-9);
  }
}

TEST(Hold, RestStaysAtRestToTheBitAndThreadsDoNotMatter) {
  const auto one = knead::make_cpu_executor(1), two = knead::make_cpu_executor(2);
  const fixture::Scene scene = fixture::ball(0.15, 1, *one);
  HoldSettings settings;
  settings.strength = 0.1;
  const Buffer<Vec3f> same = hold(*two, scene.tets.rest, scene.tets, nullptr, settings);
  EXPECT_EQ(std::memcmp(same.host().data(), scene.tets.rest.host().data(), same.bytes()), 0);
  const Buffer<Vec3f> x = fixture::shaken(scene.tets.rest, 0.3f, 21);
  const Buffer<Vec3f> a = hold(*one, x, scene.tets, nullptr, settings), b = hold(*two, x, scene.tets, nullptr, settings);
  EXPECT_EQ(std::memcmp(a.host().data(), b.host().data(), a.bytes()), 0);
}

TEST(Hold, PullsPartOfTheWayToRest) {
  const auto executor = knead::make_cpu_executor(2);
  const fixture::Scene scene = fixture::ball(0.3, 1, *executor);
  const Buffer<Vec3f> x = fixture::shaken(scene.tets.rest, 0.3f, 23);
  HoldSettings settings;
  settings.remove_rigid = false;
  settings.strength = 0.25;
  const Buffer<Vec3f> got = hold(*executor, x, scene.tets, nullptr, settings);
  for (size_t j = 0; j < x.size(); ++j) ASSERT_LT(length(got.host()[j] - (0.75f * x.host()[j] + 0.25f * scene.tets.rest.host()[j])), 1e-6f);
}

TEST(Hold, PinnedVerticesOfMComeOutAtRestToTheBitAndTheRestMoves) {
  const auto executor = knead::make_cpu_executor(2);
  const fixture::Scene scene = fixture::ball(0.3, 2, *executor);
  std::vector<Vec3f> moved;
  for (const Vec3f& p : scene.tets.rest.host()) moved.push_back(hold_turned(p, 10, {1, 2, 3}));
  std::vector<float> paint(scene.surface.vertices(), 0.0f);
  for (size_t i = 0; i < paint.size(); ++i) paint[i] = scene.surface.points.host()[i].y < -0.5f ? 1.0f : 0.0f;
  const Buffer<float> pins(paint);
  HoldSettings settings;
  settings.pins = &pins;
  const Buffer<Vec3f> x = hold(*executor, Buffer<Vec3f>(moved), scene.tets, &scene.lattice, settings);
  const auto influences = neighbours_by_vertex(scene.lattice.gather, static_cast<uint32_t>(x.size()));
  size_t held = 0;
  for (size_t j = 0; j < x.size(); ++j) {
    bool pinned = false;
    for (const auto& [indices, w] : influences[j]) pinned = pinned || paint[indices[0]] == 1;
    const Vec3f expected = pinned ? scene.tets.rest.host()[j] : moved[j];
    ASSERT_EQ(std::memcmp(&x.host()[j], &expected, sizeof expected), 0) << j;
    held += pinned;
  }
  EXPECT_GT(held, 0u);
  EXPECT_LT(held, x.size());
}

TEST(Hold, PaintOnMScalesThePullByItsMeanWhereMDoesNotReach) {
  const auto executor = knead::make_cpu_executor(2);
  const fixture::Scene scene = fixture::ball(0.25, 2, *executor);
  std::vector<float> paint(scene.surface.vertices(), 0.0f);
  double mean = 0;
  for (size_t i = 0; i < paint.size(); ++i) {
    paint[i] = scene.surface.points.host()[i].x > 0 ? 1.0f : 0.0f;
    mean += paint[i] / static_cast<double>(paint.size());
  }
  const Buffer<float> weights(paint);
  const Buffer<Vec3f> x = fixture::shaken(scene.tets.rest, 0.3f, 25);
  HoldSettings settings;
  settings.remove_rigid = false;
  settings.strength = 0.5;
  settings.weights = &weights;
  const Buffer<Vec3f> got = hold(*executor, x, scene.tets, &scene.lattice, settings);
  const auto influences = neighbours_by_vertex(scene.lattice.gather, static_cast<uint32_t>(x.size()));
  size_t inside = 0;
  for (size_t j = 0; j < x.size(); ++j) {
    double share = influences[j].empty() ? mean : 0;
    inside += influences[j].empty();
    for (const auto& [indices, w] : influences[j]) share += static_cast<double>(w) * paint[indices[0]];
    const Vec3d expected = to_double(x.host()[j]) + 0.5 * share * (to_double(scene.tets.rest.host()[j]) - to_double(x.host()[j]));
    ASSERT_LT(length(to_double(got.host()[j]) - expected), 1e-6) << j;
  }
  EXPECT_GT(inside, 0u);
}

TEST(Hold, TakesNothingAndRefusesPaintThatDoesNotFit) {
  const auto executor = knead::make_cpu_executor(2);
  const knead::TetMesh none = fixture::make_tet_mesh({}, {}, *executor);
  EXPECT_EQ(hold(*executor, Buffer<Vec3f>(size_t{0}), none, nullptr, {}).size(), 0u);
  const fixture::Scene scene = fixture::ball(0.4, 1, *executor);
  const Buffer<float> paint(std::vector<float>(scene.surface.vertices(), 1.0f)), short_paint(std::vector<float>(3, 1.0f));
  HoldSettings settings;
  settings.pins = &paint;
  EXPECT_THROW(hold(*executor, scene.tets.rest, scene.tets, nullptr, settings), knead::Error);
  settings.pins = &short_paint;
  EXPECT_THROW(hold(*executor, scene.tets.rest, scene.tets, &scene.lattice, settings), knead::Error);
  EXPECT_THROW(hold(*executor, Buffer<Vec3f>(std::vector<Vec3f>(3)), scene.tets, nullptr, {}), knead::Error);
}

}  // namespace
