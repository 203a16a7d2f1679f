#include "io/vdb/vdb.h"

#include <gtest/gtest.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/LevelSetSphere.h>

#include <cstring>
#include <filesystem>
#include <fstream>

#include "graph/error.h"
#include "io/files.h"
#include "kernels/sdf_sample.h"
#include "kernels/shapes/primitives.h"
#include "kernels/surface/mesh_distance.h"
#include "tests/paths.h"

namespace {

using knead::ReadSdf;
using knead::Sdf;
using knead::Vec3d;

std::string vdb_test_file(const std::string& name) {
  const std::filesystem::path folder = std::filesystem::temp_directory_path() / "knead_vdb_test";
  std::filesystem::create_directories(folder);
  return (folder / name).string();
}

// In world units, whatever the placement.
double vdb_sample_world(const Sdf& sdf, const Vec3d& world) {
  const Vec3d local = sdf.placement.inverse().apply(world);
  const float far = 1e9f;
  const auto* grid = reinterpret_cast<const nanovdb::NanoGrid<float>*>(sdf.grid.host().data());
  knead::SdfSampler sampler(knead::SdfView{grid, {-far, -far, -far}, {far, far, far}});
  return sampler.value(knead::to_float((local - to_double(sdf.index_origin)) * (1.0 / sdf.voxel_size))) * sdf.placement.scale;
}

Sdf vdb_test_ball(double radius, double voxel, knead::Executor& executor) {
  knead::SdfPlan plan;
  plan.voxel_size = voxel;
  plan.lower = {-radius, -radius, -radius};
  plan.upper = {radius, radius, radius};
  return knead::build_sdf(executor, plan, [&](const Vec3d& p, uint32_t&) { return length(p) - radius; });
}

void write_vdb_grid(const std::string& path, const openvdb::GridBase::Ptr& grid) {
  openvdb::io::File(path).write({grid});
}

std::string vdb_refusal(const std::string& path, const std::string& name = "") {
  const auto executor = knead::make_serial_executor();
  try {
    knead::read_sdf(path, name, *executor);
  } catch (const knead::Error& e) {
    EXPECT_EQ(e.where().file, path);
    return e.what();
  }
  return "";
}

TEST(Vdb, BuildsTheDistanceAtEveryDepth) {
  const auto executor = knead::make_cpu_executor(2);
  const double h = 0.02;
  const Sdf sdf = vdb_test_ball(1, h, *executor);
  for (double r = 0; r < 1.04; r += 0.013) {
    const Vec3d p{0.48 * r, -0.6 * r, 0.64 * r};
    EXPECT_NEAR(vdb_sample_world(sdf, p), r - 1, r < 0.1 ? 0.8 * h : r < 0.8 ? 0.3 * h : 0.03 * h) << r;
  }
  EXPECT_FLOAT_EQ(static_cast<float>(vdb_sample_world(sdf, {1.5, 0, 0})), static_cast<float>(4 * h));
  EXPECT_NEAR(sdf.inside_depth, 1, 2 * h);
  EXPECT_NEAR(sdf.outside_band, 2.25 * h, 1e-6);
}

TEST(Vdb, BuildsTheSameBitsForAnyNumberOfThreads) {
  const auto one = knead::make_serial_executor(), two = knead::make_cpu_executor(2);
  const Sdf a = vdb_test_ball(1, 0.05, *one), b = vdb_test_ball(1, 0.05, *two);
  ASSERT_EQ(a.grid.size(), b.grid.size());
  EXPECT_EQ(std::memcmp(a.grid.host().data(), b.grid.host().data(), a.grid.size()), 0);
}

TEST(Vdb, RefusesWhatWouldNotFitBeforeTakingMemory) {
  const auto executor = knead::make_serial_executor();
  for (const double voxel : {0.004, 1e-5, 1e-12}) {
    knead::SdfPlan plan;
    plan.voxel_size = voxel;
    plan.lower = {-1, -1, -1};
    plan.upper = {1, 1, 1};
    plan.memory_limit = 32 << 20;
    auto ball = [](const Vec3d& p, uint32_t&) { return length(p) - 1; };
    try {
      knead::build_sdf(*executor, plan, ball);
      FAIL() << voxel;
    } catch (const knead::Error& e) {
      EXPECT_EQ(e.code(), knead::ErrorCode::kMemory);
      EXPECT_NE(e.hint().find("voxel size"), std::string::npos) << e.what();
      if (voxel == 0.004) {  // the size that it names does fit
        plan.voxel_size = std::stod(e.hint().substr(e.hint().find("voxel size of") + 14));
        EXPECT_NO_THROW(knead::build_sdf(*executor, plan, ball)) << e.what();
      }
    }
  }
}

TEST(Vdb, ReadsItsOwnFilesInBothFormatsWithTheirPlace) {
  const auto executor = knead::make_serial_executor();
  Sdf sdf = vdb_test_ball(1, 0.05, *executor);
  sdf.placement.scale = 3;
  sdf.placement.rotation = {0, -1, 0, 1, 0, 0, 0, 0, 1};
  sdf.placement.translation = {1e3, -20, 4};
  for (const char* name : {"own.vdb", "own.nvdb"}) {
    const std::string path = vdb_test_file(name);
    knead::write_sdf(path, sdf, "collider");
    const ReadSdf read = knead::read_sdf(path, "collider", *executor);
    EXPECT_TRUE(read.warnings.empty()) << read.warnings[0];
    for (const Vec3d& p : {Vec3d{1, -0.4, 0.2}, Vec3d{0, 0, 0.1}, Vec3d{0.5, 2.9, 0}, Vec3d{-3.1, 0, 0.3}, Vec3d{30, 0, 0}}) {
      const Vec3d world = p + sdf.placement.translation;
      EXPECT_NEAR(vdb_sample_world(read.sdf, world), vdb_sample_world(sdf, world), 1e-4) << name;
    }
    EXPECT_NEAR(read.sdf.inside_depth * read.sdf.placement.scale, 3, 0.2);
  }
}

TEST(Vdb, WritesWhatOtherProgramsOpen) {
  const auto executor = knead::make_serial_executor();
  Sdf sdf = vdb_test_ball(1, 0.1, *executor);
  sdf.placement.translation = {5, 0, 0};
  const std::string path = vdb_test_file("open.vdb");
  knead::write_sdf(path, sdf, "collider");
  openvdb::io::File file(path);
  file.open();
  const auto grid = openvdb::gridPtrCast<openvdb::FloatGrid>(file.readGrid("collider"));
  ASSERT_TRUE(grid);
  EXPECT_EQ(grid->getGridClass(), openvdb::GRID_LEVEL_SET);
  EXPECT_NEAR(grid->tree().getValue(grid->transform().worldToIndexCellCentered({5.5, 0, 0})), -0.5, 0.06);
}

TEST(Vdb, CompletesANarrowBandToTheMedialAxis) {
  const std::string folder = shared_data() + "/colliders/";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "shared data is absent";
  const auto executor = knead::make_cpu_executor(2);
  const Sdf sphere = knead::read_sdf(folder + "sphere_levelset.vdb", "", *executor).sdf;
  for (double r = 0; r < 1.1; r += 0.03) EXPECT_NEAR(vdb_sample_world(sphere, {0.6 * r, 0, -0.8 * r}), r - 1, r < 0.1 ? 0.04 : 0.015) << r;
  const Sdf torus = knead::read_sdf(folder + "torus_levelset.vdb", "surface", *executor).sdf;
  for (double r = 0; r < 0.39; r += 0.02) EXPECT_NEAR(vdb_sample_world(torus, {1 + 0.6 * r, 0.8 * r, 0}), r - 0.3, r < 0.06 ? 0.03 : 0.015) << r;
  EXPECT_FLOAT_EQ(static_cast<float>(vdb_sample_world(torus, {0, 0, 0})), 0.12f);
}

TEST(Vdb, TakesDistancesFromAGridFarAwayAndTurned) {
  openvdb::initialize();
  auto grid = openvdb::tools::createLevelSetSphere<openvdb::FloatGrid>(1.0f, openvdb::Vec3f(0), 0.05f, 3.0f);
  auto transform = grid->transform().copy();
  transform->postRotate(0.5, openvdb::math::X_AXIS);
  transform->postTranslate({1e6, -1e6, 1e6});
  grid->setTransform(transform);
  grid->setName("far");
  const std::string path = vdb_test_file("far.vdb");
  write_vdb_grid(path, grid);
  const auto executor = knead::make_serial_executor();
  const Sdf sdf = knead::read_sdf(path, "far", *executor).sdf;
  for (double r = 0.1; r < 1.1; r += 0.1) EXPECT_NEAR(vdb_sample_world(sdf, Vec3d{1e6, -1e6, 1e6} + Vec3d{0, 0.6 * r, 0.8 * r}), r - 1, 0.01);
}

TEST(Vdb, SaysWhatIsWrongWithAFile) {
  openvdb::initialize();
  auto sphere = openvdb::tools::createLevelSetSphere<openvdb::FloatGrid>(1.0f, openvdb::Vec3f(0), 0.1f, 3.0f);
  sphere->setName("ball");
  const std::string good = vdb_test_file("good.vdb");
  write_vdb_grid(good, sphere);
  EXPECT_EQ(vdb_refusal(good), "");
  EXPECT_NE(vdb_refusal(good, "bal").find("did you mean 'ball'"), std::string::npos);

  auto stretched = sphere->deepCopy();
  stretched->setTransform(
      openvdb::math::Transform::createLinearTransform(openvdb::math::Mat4d(0.1, 0., 0., 0., 0., 0.2, 0., 0., 0., 0., 0.1, 0., 0., 0., 0., 1.)));
  write_vdb_grid(vdb_test_file("stretched.vdb"), stretched);
  EXPECT_NE(vdb_refusal(vdb_test_file("stretched.vdb")).find("0.1 x 0.2 x 0.1"), std::string::npos);

  auto fog = sphere->deepCopy();
  fog->setGridClass(openvdb::GRID_FOG_VOLUME);
  write_vdb_grid(vdb_test_file("fog.vdb"), fog);
  EXPECT_NE(vdb_refusal(vdb_test_file("fog.vdb")).find("fog volume"), std::string::npos);

  auto bad = sphere->deepCopy();
  bad->tree().setValue(openvdb::Coord(9, 0, 0), NAN);
  write_vdb_grid(vdb_test_file("nan.vdb"), bad);
  EXPECT_NE(vdb_refusal(vdb_test_file("nan.vdb")).find("not finite"), std::string::npos);

  auto vectors = openvdb::Vec3SGrid::create();
  vectors->tree().setValue(openvdb::Coord(0, 0, 0), openvdb::Vec3f(1));
  vectors->setName("v");
  write_vdb_grid(vdb_test_file("vectors.vdb"), vectors);
  EXPECT_NE(vdb_refusal(vdb_test_file("vectors.vdb")).find("no scalar grid"), std::string::npos);
  EXPECT_NE(vdb_refusal(vdb_test_file("vectors.vdb"), "v").find("not float"), std::string::npos);

  auto empty = openvdb::FloatGrid::create(1.0f);
  write_vdb_grid(vdb_test_file("empty.vdb"), empty);
  EXPECT_NE(vdb_refusal(vdb_test_file("empty.vdb")).find("empty"), std::string::npos);

  EXPECT_NE(vdb_refusal(vdb_test_file("not_there.vdb")), "");
  EXPECT_NE(vdb_refusal(vdb_test_file("ball.obj")).find(".vdb or .nvdb"), std::string::npos);
}

TEST(Vdb, RefusesGarbageAndCutFiles) {
  const auto executor = knead::make_serial_executor();
  for (const char* extension : {".vdb", ".nvdb"}) {
    const std::string whole = vdb_test_file(std::string("whole") + extension), broken = vdb_test_file(std::string("broken") + extension);
    knead::write_sdf(whole, vdb_test_ball(1, 0.1, *executor), "surface");
    const std::string bytes = knead::read_whole_file(whole);
    for (const size_t size : {size_t{0}, size_t{3}, size_t{40}, bytes.size() / 3, bytes.size() - 100}) {
      std::ofstream(broken, std::ios::binary) << bytes.substr(0, size);
      EXPECT_NE(vdb_refusal(broken), "") << extension << ' ' << size;
    }
    std::ofstream(broken, std::ios::binary) << std::string(5000, 'x');
    EXPECT_NE(vdb_refusal(broken), "");
  }
}

TEST(Vdb, WarnsOfOtherUnitsAndOfAMissingClass) {
  openvdb::initialize();
  auto sphere = openvdb::tools::createLevelSetSphere<openvdb::FloatGrid>(1.0f, openvdb::Vec3f(0), 0.1f, 3.0f);
  sphere->setTransform(openvdb::math::Transform::createLinearTransform(10.0));  // millimetres for the place, centimetres for the distance
  sphere->setGridClass(openvdb::GRID_UNKNOWN);
  const std::string path = vdb_test_file("units.vdb");
  write_vdb_grid(path, sphere);
  const auto executor = knead::make_serial_executor();
  const ReadSdf read = knead::read_sdf(path, "", *executor);
  ASSERT_EQ(read.warnings.size(), 2u);
  EXPECT_NE(read.warnings[0].find("not marked"), std::string::npos);
  EXPECT_NE(read.warnings[1].find("other units"), std::string::npos);
}

TEST(Vdb, WritesNothingWhereItCannot) {
  const auto executor = knead::make_serial_executor();
  const Sdf sdf = vdb_test_ball(1, 0.2, *executor);
  EXPECT_THROW(knead::write_sdf(vdb_test_file("ball.txt"), sdf, "surface"), knead::Error);
  EXPECT_FALSE(std::filesystem::exists(vdb_test_file("ball.txt")));
}

}  // namespace
