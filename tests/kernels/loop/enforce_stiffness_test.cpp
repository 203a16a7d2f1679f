#include "kernels/loop/enforce_stiffness.h"

#include <gtest/gtest.h>

#include <cstring>

#include "graph/error.h"
#include "kernels/simd_level.h"
#include "tests/kernels/loop/loop_fixture.h"

namespace {

namespace fixture = knead::loop_fixture;
using knead::Buffer;
using knead::EnforceStiffnessSettings;
using knead::SimdLevel;
using knead::Vec3d;
using knead::Vec3f;

// Eq. 4 as method.md 3 mends it, over the plain list of edges, in double.
std::vector<Vec3d> stiffness_oracle(const knead::TetMesh& mesh, const std::vector<Vec3f>& x, double s, bool stretched_only) {
  std::vector<Vec3d> sum(x.size(), Vec3d{0, 0, 0});
  std::vector<double> count(x.size(), 0);
  for (size_t e = 0; e < mesh.edges.size(); ++e)
    for (const bool flip : {false, true}) {
      const uint32_t p0 = mesh.edges.host()[e][flip], pi = mesh.edges.host()[e][!flip];
      const Vec3d towards = to_double(x[p0]) - to_double(x[pi]);
      const double rest = mesh.rest_lengths.host()[e], now = length(towards);
      const bool counts = now > 0 && (!stretched_only || now > rest);
      sum[p0] += counts ? to_double(x[pi]) + (rest / now) * towards : to_double(x[p0]);
      count[p0] += 1;
    }
  std::vector<Vec3d> result;
  for (size_t j = 0; j < x.size(); ++j) result.push_back((1 - s) * to_double(x[j]) + (s / count[j]) * sum[j]);
  return result;
}

TEST(EnforceStiffness, AgreesWithTheFormulaOverThePlainEdges) {
  const auto executor = knead::make_cpu_executor(2);
  const fixture::Scene scene = fixture::ball(0.3, 1, *executor);
  const Buffer<Vec3f> shaken = fixture::shaken(scene.tets.rest, 0.15f, 11);
  const std::vector<Vec3f> x = fixture::vector_of(shaken);
  for (const double s : {0.0, 0.3, 1.0})
    for (const bool stretched_only : {false, true}) {
      EnforceStiffnessSettings settings;
      settings.stiffness = s;
      settings.stretched_only = stretched_only;
      const Buffer<Vec3f> got = enforce_stiffness(*executor, shaken, scene.tets, settings);
      const std::vector<Vec3d> expected = stiffness_oracle(scene.tets, x, s, stretched_only);
      for (size_t j = 0; j < x.size(); ++j) ASSERT_LT(length(to_double(got.host()[j]) - expected[j]), 2e-6) << "vertex " << j << ", s " << s;
    }
}

TEST(EnforceStiffness, RestStaysAtRestToTheBit) {
  const auto executor = knead::make_cpu_executor(2);
  const fixture::Scene scene = fixture::ball(0.3, 1, *executor);
  const Buffer<Vec3f> same = enforce_stiffness(*executor, scene.tets.rest, scene.tets, {});
  EXPECT_EQ(std::memcmp(same.host().data(), scene.tets.rest.host().data(), same.bytes()), 0);
}

TEST(EnforceStiffness, LeavesCompressedEdgesAloneWhenAsked) {
  const auto executor = knead::make_serial_executor();
  const fixture::Scene scene = fixture::ball(0.4, 1, *executor);
  std::vector<Vec3f> shrunk = fixture::vector_of(scene.tets.rest);
  for (Vec3f& p : shrunk) p = p * 0.8f;
  const Buffer<Vec3f> x(shrunk);
  EnforceStiffnessSettings settings;
  settings.stretched_only = true;
  const Buffer<Vec3f> same = enforce_stiffness(*executor, x, scene.tets, settings);
  EXPECT_EQ(std::memcmp(same.host().data(), x.host().data(), same.bytes()), 0);
  settings.stretched_only = false;
  const Buffer<Vec3f> grown = enforce_stiffness(*executor, x, scene.tets, settings);
  EXPECT_NE(std::memcmp(grown.host().data(), x.host().data(), same.bytes()), 0);
}

TEST(EnforceStiffness, EdgesOfNoLengthAskForNothing) {
  const auto executor = knead::make_cpu_executor(1);
  const fixture::Scene scene = fixture::ball(0.4, 1, *executor);
  const Buffer<Vec3f> point(std::vector<Vec3f>(scene.tets.vertices(), Vec3f{1, 2, 3}));
  const Buffer<Vec3f> same = enforce_stiffness(*executor, point, scene.tets, {});
  EXPECT_EQ(std::memcmp(same.host().data(), point.host().data(), same.bytes()), 0);
}

TEST(EnforceStiffness, PaintedVerticesOfWeightZeroStay) {
  const auto executor = knead::make_cpu_executor(2);
  const fixture::Scene scene = fixture::ball(0.3, 1, *executor);
  const Buffer<Vec3f> x = fixture::shaken(scene.tets.rest, 0.15f, 13);
  std::vector<float> paint(x.size());
  for (size_t j = 0; j < paint.size(); ++j) paint[j] = j % 3 == 0 ? 0.0f : j % 3 == 1 ? 0.5f : 1.0f;
  const Buffer<float> weights(paint);
  EnforceStiffnessSettings settings;
  settings.stiffness = 0.8;
  const Buffer<Vec3f> full = enforce_stiffness(*executor, x, scene.tets, settings);
  settings.weights = &weights;
  const Buffer<Vec3f> painted = enforce_stiffness(*executor, x, scene.tets, settings);
  for (size_t j = 0; j < x.size(); ++j) {
    const Vec3f step = full.host()[j] - x.host()[j], got = painted.host()[j] - x.host()[j];
    ASSERT_LT(length(got - paint[j] * step), 2e-6f) << j;
  }
}

TEST(EnforceStiffness, MovesNoFurtherThanMaxStep) {
  const auto executor = knead::make_serial_executor();
  const fixture::Scene scene = fixture::ball(0.4, 1, *executor);
  std::vector<Vec3f> grown = fixture::vector_of(scene.tets.rest);
  for (Vec3f& p : grown) p = p * 5.0f;
  EnforceStiffnessSettings settings;
  settings.stiffness = 1;
  settings.max_step = 0.1;
  const Buffer<Vec3f> x = enforce_stiffness(*executor, Buffer<Vec3f>(grown), scene.tets, settings);
  for (size_t j = 0; j < x.size(); ++j) ASSERT_LE(length(x.host()[j] - grown[j]), 0.1f * scene.tets.mean_edge + 1e-5f);
}

// The bound allows for fused multiply-adds and another grouping of sums: some units in the last place at coordinates of about 5 cells.
TEST(EnforceStiffness, EveryLevelAgreesWithTheSerialExecutorAndThreadsDoNotMatter) {
  const auto serial = knead::make_serial_executor(), one = knead::make_cpu_executor(1), two = knead::make_cpu_executor(2);
  const fixture::Scene scene = fixture::ball(0.15, 1, *serial);
  const Buffer<Vec3f> x = fixture::shaken(scene.tets.rest, 0.1f, 15);
  const Buffer<Vec3f> expected = enforce_stiffness(*serial, x, scene.tets, {});
  const SimdLevel best = knead::simd_levels().back();
  for (const SimdLevel level : knead::simd_levels()) {
    knead::use_simd_level(level);
    const Buffer<Vec3f> a = enforce_stiffness(*one, x, scene.tets, {}), b = enforce_stiffness(*two, x, scene.tets, {});
    EXPECT_EQ(std::memcmp(a.host().data(), b.host().data(), a.bytes()), 0) << knead::name_of(level);
    for (size_t j = 0; j < x.size(); ++j) ASSERT_LT(length(a.host()[j] - expected.host()[j]), 4e-6f) << knead::name_of(level) << " vertex " << j;
  }
  knead::use_simd_level(best);
}

TEST(EnforceStiffness, TakesNothingAndRefusesWhatDoesNotFit) {
  const auto executor = knead::make_cpu_executor(2);
  const knead::TetMesh none = fixture::make_tet_mesh({}, {}, *executor);
  EXPECT_EQ(enforce_stiffness(*executor, Buffer<Vec3f>(size_t{0}), none, {}).size(), 0u);
  const fixture::Scene scene = fixture::ball(0.4, 1, *executor);
  EXPECT_THROW(enforce_stiffness(*executor, Buffer<Vec3f>(std::vector<Vec3f>(3)), scene.tets, {}), knead::Error);
  const Buffer<float> short_paint(std::vector<float>(3));
  EnforceStiffnessSettings settings;
  settings.weights = &short_paint;
  EXPECT_THROW(enforce_stiffness(*executor, scene.tets.rest, scene.tets, settings), knead::Error);
}

}  // namespace
