#include "kernels/loop/lattice_map.h"

#include <gtest/gtest.h>

#include <cstring>

#include "graph/error.h"
#include "kernels/motion.h"
#include "kernels/simd_level.h"
#include "tests/kernels/loop/loop_fixture.h"

namespace {

namespace fixture = knead::loop_fixture;
using knead::Buffer;
using knead::MapToTetsSettings;
using knead::SimdLevel;
using knead::Vec3d;
using knead::Vec3f;

std::vector<Vec3f> displacements_for_map(const fixture::Scene& scene) {
  std::vector<Vec3f> d(scene.surface.vertices(), Vec3f{0, 0, 0});
  for (size_t i = 0; i < d.size(); ++i)
    if (scene.surface.points.host()[i].y > 0.3f) d[i] = {0.01f * static_cast<float>(i % 5), -0.05f, 0.02f};
  return d;
}

TEST(MapToTets, IsTheWeightedMeanOverTheVerticesInfluenced) {
  const auto executor = knead::make_cpu_executor(2);
  const fixture::Scene scene = fixture::ball(0.3, 2, *executor);
  const std::vector<Vec3f> d = displacements_for_map(scene);
  const Buffer<Vec3f> x = fixture::shaken(scene.tets.rest, 0.1f, 17);
  MapToTetsSettings settings;
  settings.gain = 1.5;
  settings.max_step = 100;
  const Buffer<Vec3f> got = map_to_tets(*executor, Buffer<Vec3f>(d), x, scene.lattice, settings);
  // From the rows of the forward map, the other way round.
  std::vector<Vec3d> sum(x.size(), Vec3d{0, 0, 0});
  std::vector<double> weight(x.size(), 0);
  const auto rows = neighbours_by_vertex(scene.lattice.map, static_cast<uint32_t>(d.size()));
  for (size_t i = 0; i < d.size(); ++i)
    for (const auto& [indices, w] : rows[i]) {
      if (w <= 1e-6f) continue;
      sum[indices[0]] += static_cast<double>(w) * to_double(d[i]);
      weight[indices[0]] += w;
    }
  size_t uninfluenced = 0;
  for (size_t j = 0; j < x.size(); ++j) {
    if (weight[j] == 0) {
      ++uninfluenced;
      EXPECT_EQ(std::memcmp(&got.host()[j], &x.host()[j], sizeof(Vec3f)), 0);
      continue;
    }
    const Vec3d expected = to_double(x.host()[j]) + (1.5 / (scene.tets.to_local.scale * weight[j])) * sum[j];
    ASSERT_LT(length(to_double(got.host()[j]) - expected), 3e-6) << j;
  }
  EXPECT_GT(uninfluenced, 0u);
}

TEST(MapToTets, NoPushKeepsEveryBit) {
  const auto executor = knead::make_cpu_executor(2);
  const fixture::Scene scene = fixture::ball(0.3, 2, *executor);
  std::vector<Vec3f> zeros = fixture::vector_of(scene.tets.rest);
  zeros[0].x = -0.0f;
  const Buffer<Vec3f> x(zeros);
  const Buffer<Vec3f> same =
      map_to_tets(*executor, Buffer<Vec3f>(std::vector<Vec3f>(scene.surface.vertices(), Vec3f{0, 0, 0})), x, scene.lattice, {});
  EXPECT_EQ(std::memcmp(same.host().data(), x.host().data(), x.bytes()), 0);
}

TEST(MapToTets, MovesNoFurtherThanMaxStep) {
  const auto executor = knead::make_cpu_executor(1);
  const fixture::Scene scene = fixture::ball(0.3, 2, *executor);
  const Buffer<Vec3f> far(std::vector<Vec3f>(scene.surface.vertices(), Vec3f{0, 7, 0}));
  const Buffer<Vec3f> x = map_to_tets(*executor, far, scene.tets.rest, scene.lattice, {.gain = 1, .max_step = 0.5, .mean_edge = 0.9});
  float longest = 0;
  for (size_t j = 0; j < x.size(); ++j) longest = std::max(longest, length(x.host()[j] - scene.tets.rest.host()[j]));
  EXPECT_NEAR(longest, 0.45f, 1e-5f);
}

TEST(MapToSurface, RestGivesTheBitsOfTheSurface) {
  const auto executor = knead::make_cpu_executor(2);
  fixture::Scene scene = fixture::ball(0.3, 2, *executor);
  std::vector<Vec3f> zeros = fixture::vector_of(scene.lattice.rest.points);
  for (Vec3f& p : zeros)
    if (p.x == 0) p.x = -0.0f;
  scene.lattice.rest.points = Buffer<Vec3f>(zeros);
  const Buffer<Vec3f> same = map_to_surface(*executor, scene.tets.rest, scene.lattice);
  EXPECT_EQ(std::memcmp(same.host().data(), zeros.data(), same.bytes()), 0);
}

TEST(MapToSurface, FollowsAnyAffineMotionOfH) {
  const auto executor = knead::make_cpu_executor(2);
  const fixture::Scene scene = fixture::ball(0.3, 3, *executor);
  const double scale = scene.tets.to_local.scale;
  const auto affine = [](const Vec3d& p) { return Vec3d{1.1 * p.x + 0.2 * p.y, p.y - 0.3 * p.z + 0.5, 0.9 * p.z + 0.1 * p.x}; };
  std::vector<Vec3f> moved;
  for (const Vec3f& p : scene.tets.rest.host()) moved.push_back(to_float(affine(to_double(p))));
  const Buffer<Vec3f> y = map_to_surface(*executor, Buffer<Vec3f>(moved), scene.lattice);
  for (size_t i = 0; i < y.size(); ++i) {
    const Vec3d expected = scale * affine((1 / scale) * to_double(scene.surface.points.host()[i]));  // tet space is about the origin here
    ASSERT_LT(length(to_double(y.host()[i]) - expected), 2e-6) << i;
  }
}

TEST(LatticeMap, TurnsBetweenTetSpaceAndLocalSpace) {
  const auto serial = knead::make_serial_executor(), two = knead::make_cpu_executor(2);
  const fixture::Scene scene = fixture::ball(0.3, 2, *serial);
  fixture::Scene turned = scene;
  turned.lattice.to_local.rotation = knead::rotation_about({1, -2, 0.5}, 70).matrix();
  knead::Similarity turn, back;
  turn.rotation = turned.lattice.to_local.rotation;
  back = turn.inverse();
  const std::vector<Vec3f> d = displacements_for_map(scene);
  const Buffer<Vec3f> rest = scene.tets.rest, x = fixture::shaken(rest, 0.1f, 23);
  for (const auto* executor : {&serial, &two}) {
    const Buffer<Vec3f> plain = map_to_tets(**executor, Buffer<Vec3f>(d), rest, scene.lattice, {}),
                        other = map_to_tets(**executor, Buffer<Vec3f>(d), rest, turned.lattice, {});
    for (size_t j = 0; j < plain.size(); ++j) {
      const Vec3d expected = to_double(rest.host()[j]) + back.rotate(to_double(plain.host()[j] - rest.host()[j]));
      ASSERT_LT(length(to_double(other.host()[j]) - expected), 3e-6) << j;
    }
    const Buffer<Vec3f> y = map_to_surface(**executor, x, scene.lattice), z = map_to_surface(**executor, x, turned.lattice);
    for (size_t i = 0; i < y.size(); ++i) {
      const Vec3d home = to_double(scene.surface.points.host()[i]);
      ASSERT_LT(length(to_double(z.host()[i]) - home - turn.rotate(to_double(y.host()[i]) - home)), 1e-6) << i;
    }
    const Buffer<Vec3f> same = map_to_surface(**executor, rest, turned.lattice);
    EXPECT_EQ(std::memcmp(same.host().data(), scene.surface.points.host().data(), same.bytes()), 0);
    const Buffer<Vec3f> still = map_to_tets(**executor, Buffer<Vec3f>(std::vector<Vec3f>(d.size(), Vec3f{0, 0, 0})), x, turned.lattice, {});
    EXPECT_EQ(std::memcmp(still.host().data(), x.host().data(), still.bytes()), 0);
  }
}

TEST(LatticeMap, EveryLevelAgreesWithTheSerialExecutorAndThreadsDoNotMatter) {
  const auto serial = knead::make_serial_executor(), one = knead::make_cpu_executor(1), two = knead::make_cpu_executor(2);
  const fixture::Scene scene = fixture::ball(0.2, 3, *serial);
  const Buffer<Vec3f> d(displacements_for_map(scene)), x = fixture::shaken(scene.tets.rest, 0.1f, 19);
  const Buffer<Vec3f> to_tets = map_to_tets(*serial, d, x, scene.lattice, {}), to_surface = map_to_surface(*serial, x, scene.lattice);
  const SimdLevel best = knead::simd_levels().back();
  for (const SimdLevel level : knead::simd_levels()) {
    knead::use_simd_level(level);
    const Buffer<Vec3f> a = map_to_tets(*one, d, x, scene.lattice, {}), b = map_to_tets(*two, d, x, scene.lattice, {});
    const Buffer<Vec3f> p = map_to_surface(*one, x, scene.lattice), q = map_to_surface(*two, x, scene.lattice);
    EXPECT_EQ(std::memcmp(a.host().data(), b.host().data(), a.bytes()), 0);
    EXPECT_EQ(std::memcmp(p.host().data(), q.host().data(), p.bytes()), 0);
    for (size_t j = 0; j < x.size(); ++j) ASSERT_LT(length(a.host()[j] - to_tets.host()[j]), 2e-6f) << knead::name_of(level);
    for (size_t i = 0; i < p.size(); ++i) ASSERT_LT(length(p.host()[i] - to_surface.host()[i]), 5e-7f) << knead::name_of(level);
  }
  knead::use_simd_level(best);
}

TEST(LatticeMap, TakesOneVertexAndRefusesWhatDoesNotFit) {
  const auto executor = knead::make_cpu_executor(2);
  fixture::Scene scene = fixture::ball(0.4, 1, *executor);
  EXPECT_THROW(map_to_surface(*executor, Buffer<Vec3f>(std::vector<Vec3f>(2)), scene.lattice), knead::Error);
  EXPECT_THROW(map_to_tets(*executor, Buffer<Vec3f>(std::vector<Vec3f>(2)), scene.tets.rest, scene.lattice, {}), knead::Error);

  const std::vector<Vec3f> point{{0.25f, 0.25f, 0.25f}};
  scene.tets = fixture::make_tet_mesh({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, {{0, 1, 2, 3}}, *executor);
  scene.lattice.tet_rest = scene.tets.rest;
  scene.lattice.to_local = {};
  scene.lattice.rest.points = Buffer<Vec3f>(point);
  std::vector<std::pair<std::array<uint32_t, 1>, float>> row;
  std::vector<std::vector<std::pair<std::array<uint32_t, 1>, float>>> columns;
  for (uint32_t j = 0; j < 4; ++j) {
    row.push_back({{j}, 0.25f});
    columns.push_back({{{0}, 1.0f}});
  }
  scene.lattice.map = fixture::table_of<1>({row}, knead::PadIndex::kZero, knead::Lanes::kAll, *executor);
  scene.lattice.gather = fixture::table_of<1>(columns, knead::PadIndex::kZero, knead::Lanes::kWithNeighbours, *executor);
  const Buffer<Vec3f> push(std::vector<Vec3f>{{0, 0, 0.125f}});
  const Buffer<Vec3f> x = map_to_tets(*executor, push, scene.tets.rest, scene.lattice, {});
  const Buffer<Vec3f> y = map_to_surface(*executor, x, scene.lattice);
  EXPECT_EQ(y.host()[0].z, 0.375f);
  EXPECT_EQ(y.host()[0].x, 0.25f);
}

}  // namespace
