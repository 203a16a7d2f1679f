#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <random>
#include <tuple>

#include "kernels/port_types.h"
#include "kernels/shapes/primitives.h"
#include "kernels/surface/mesh_distance.h"
#include "kernels/surface/winding_number.h"
#include "tests/nodes/sdf_node_context.h"

namespace {

using knead::Sdf;
using knead::Surface;
using knead::Vec3d;
using knead::Vec3f;
using sdf_node_test::OneNode;
using sdf_node_test::value_at;

Surface solid_scaled(const Surface& surface, double scale, const Vec3d& offset) {
  std::vector<Vec3f> points;
  for (const Vec3f& p : surface.points.host()) points.push_back(knead::to_float(to_double(p) * scale + offset));
  return knead::make_triangle_surface(points, surface.topology->triangles);
}

Surface solid_joined(const Surface& a, const Surface& b, const Vec3f& offset, bool reversed) {
  std::vector<Vec3f> points(a.points.host().begin(), a.points.host().end());
  std::vector<uint32_t> triangles = a.topology->triangles;
  for (const Vec3f& p : b.points.host()) points.push_back(p + offset);
  for (size_t k = 0; k < b.topology->triangles.size(); k += 3)
    for (size_t c : {size_t{0}, reversed ? size_t{2} : size_t{1}, reversed ? size_t{1} : size_t{2}})
      triangles.push_back(static_cast<uint32_t>(a.vertices()) + b.topology->triangles[k + c]);
  return knead::make_triangle_surface(points, triangles);
}

Sdf solid_of(const Surface& surface, int resolution = 32, std::string* warnings = nullptr) {
  OneNode node("mesh_to_sdf", 2);
  node.set("resolution", resolution).connect("mesh", surface).run();
  if (warnings) *warnings = node.all_warnings();
  return node.out<Sdf>("sdf");
}

TEST(MeshToSdf, KnowsItsInsideToTheMedialAxis) {
  std::string warnings;
  const Sdf sdf = solid_of(knead::make_box({2, 2, 2}, 4), 64, &warnings);
  EXPECT_EQ(warnings, "");
  const double h = 2.0 / 64;
  for (double x = -0.99; x < 1; x += 0.07) EXPECT_NEAR(value_at(sdf, {x, 0.1, -0.05}), -std::min(1 - std::abs(x), 0.9), 0.35 * h) << x;
  EXPECT_NEAR(sdf.inside_depth, 1, h);
  ASSERT_TRUE(sdf.mesh);
  EXPECT_EQ(sdf.mesh->topology->triangle_count(), 192u);
  ASSERT_TRUE(sdf.distance);
  const knead::MeshDistance own(sdf.mesh->points.host(), sdf.mesh->topology->triangles);
  EXPECT_EQ(sdf.distance->signed_distance({0.3, 0.7, -0.2}).distance, own.signed_distance({0.3, 0.7, -0.2}).distance);
}

TEST(MeshToSdf, AgreesWithExactWindingNumbersInSign) {
  std::string warnings;
  const std::vector<Surface> shapes{knead::make_torus(1, 0.3, 32),
                                    solid_joined(knead::make_sphere(1, 3), knead::make_sphere(0.5, 3), {0, 0, 0}, true),   // a cavity
                                    solid_joined(knead::make_sphere(1, 3), knead::make_sphere(0.9, 3), {1, 0, 0}, false),  // an overlap
                                    knead::make_fist(1, 800)};
  for (const Surface& shape : shapes) {
    const Sdf sdf = solid_of(shape, 40, &warnings);
    std::vector<Vec3d> points;
    for (const Vec3f& p : shape.points.host()) points.push_back(to_double(p));
    std::mt19937 random(5);
    std::uniform_real_distribution<double> u(-0.1, 1.1);
    for (int i = 0; i < 400; ++i) {
      const Vec3d size = to_double(shape.upper) - to_double(shape.lower);
      const Vec3d p = to_double(shape.lower) + Vec3d{u(random) * size.x, u(random) * size.y, u(random) * size.z};
      const double value = value_at(sdf, p);
      if (std::abs(value) < 0.5 * sdf.voxel_size) continue;
      ASSERT_EQ(value<0, knead::winding_number_exact(points, shape.topology->triangles, p)> 0.5) << p.x << ' ' << p.y << ' ' << p.z;
    }
  }
}

TEST(MeshToSdf, SaysWhatItAssumed) {
  std::string warnings;
  Surface sphere = knead::make_sphere(1, 3);
  std::vector<uint32_t> turned = sphere.topology->triangles;
  for (size_t k = 0; k < turned.size(); k += 3) std::swap(turned[k], turned[k + 1]);
  const Sdf inside_out = solid_of(knead::make_triangle_surface({sphere.points.host().begin(), sphere.points.host().end()}, turned), 32, &warnings);
  EXPECT_LT(value_at(inside_out, {0, 0, 0}), -0.9);
  EXPECT_NE(warnings.find("inside out"), std::string::npos) << warnings;

  const std::vector<uint32_t> open(sphere.topology->triangles.begin(), sphere.topology->triangles.end() - 60);
  const Sdf opened = solid_of(knead::make_triangle_surface({sphere.points.host().begin(), sphere.points.host().end()}, open), 32, &warnings);
  EXPECT_LT(value_at(opened, {0, 0, 0}), -0.8);
  EXPECT_NE(warnings.find("opening"), std::string::npos) << warnings;

  solid_of(solid_joined(sphere, sphere, {1, 0, 0}, false), 32, &warnings);
  EXPECT_NE(warnings.find("union"), std::string::npos) << warnings;
}

TEST(MeshToSdf, NamesAVoxelSizeForThinColliders) {
  const Surface plate = knead::make_box({1, 0.01, 1}, 20);
  std::string warnings;
  solid_of(plate, 32, &warnings);
  ASSERT_NE(warnings.find("would do"), std::string::npos) << warnings;
  const double size = std::stod(warnings.substr(warnings.find("voxel size of ") + 14));
  EXPECT_NEAR(size, 0.005, 0.0005);
  OneNode node("mesh_to_sdf");
  node.set("voxel_size", size * 0.99).connect("mesh", plate).run();
  EXPECT_TRUE(node.warnings.empty()) << node.all_warnings();
  EXPECT_LT(value_at(node.out<Sdf>("sdf"), {0.3, 0, 0.2}), -0.003);
}

TEST(MeshToSdf, RefusesAVoxelSizeThatWouldNotFit) {
  OneNode node("mesh_to_sdf");
  node.set("voxel_size", 1e-5).set("memory_limit", 100).connect("mesh", knead::make_sphere(1, 3));
  try {
    node.run();
    FAIL();
  } catch (const knead::Error& e) {
    EXPECT_EQ(e.code(), knead::ErrorCode::kMemory);
    EXPECT_NE(std::string(e.what()).find("voxel size"), std::string::npos);
  }
}

TEST(MeshToSdf, BuildsOnceForARigidMotionAndMovesWithIt) {
  Surface ball = knead::make_sphere(1, 3);
  OneNode node("mesh_to_sdf");
  node.set("voxel_size", 0.1).connect("mesh", ball).run();
  const uint64_t grid = node.out<Sdf>("sdf").grid.id();
  for (int frame = 0; frame < 3; ++frame) {
    ball.placement.translation = {10.0 * frame, 0, 1};
    node.connect("mesh", ball).run();
    EXPECT_EQ(node.out<Sdf>("sdf").grid.id(), grid);
    EXPECT_NEAR(value_at(node.out<Sdf>("sdf"), {10.0 * frame + 0.9, 0, 1}), -0.1, 0.01);
  }
  EXPECT_EQ(node.builds, 1);
  ball.placement.scale = 2;  // the voxel size is in world units: another grid
  node.connect("mesh", ball).run();
  EXPECT_EQ(node.builds, 2);
}

TEST(MeshToSdf, IsTheSameAtAnyScaleAndOffset) {
  const Surface torus = knead::make_torus(1, 0.3, 32);
  const Sdf here = solid_of(torus, 48);
  for (const double scale : {1e-4, 1e6}) {
    const Sdf there = solid_of(solid_scaled(torus, scale, {0.5 * scale, 0, -0.25 * scale}), 48);
    for (const Vec3d& p : {Vec3d{1, 0, 0}, Vec3d{0.8, 0.1, 0.2}, Vec3d{1.32, 0, 0}, Vec3d{0, 0, 0}})
      EXPECT_NEAR(value_at(there, p * scale + Vec3d{0.5 * scale, 0, -0.25 * scale}) / scale, value_at(here, p), 2e-5);
  }
}

TEST(MeshToSdf, TakesBadMeshesWithoutHarm) {
  EXPECT_THROW(solid_of(Surface{}), knead::Error);
  Surface sphere = knead::make_sphere(1, 2);
  std::vector<Vec3f> points(sphere.points.host().begin(), sphere.points.host().end());
  points[3].x = NAN;
  points[5].y = INFINITY;
  std::string warnings;
  Surface broken = sphere;
  broken.points = knead::Buffer<Vec3f>(points);
  const Sdf sdf = solid_of(broken, 32, &warnings);
  EXPECT_LT(value_at(sdf, {0, 0, 0}), -0.7);
  EXPECT_NE(warnings.find("non-finite"), std::string::npos) << warnings;
  const Sdf flat = solid_of(knead::make_triangle_surface({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}, {0, 1, 2, 0, 2, 3}), 32, &warnings);
  EXPECT_NE(warnings.find("sheet"), std::string::npos) << warnings;
  EXPECT_NEAR(value_at(flat, {0.5, 0.5, 0}), -1.0 / 32, 1e-4) << "a shell as thick as two voxels";
}

// An icosphere without its triangles above `height`.
Surface cut_off(double height) {
  const Surface sphere = knead::make_sphere(1, 4);
  std::vector<uint32_t> kept;
  const auto& all = sphere.topology->triangles;
  for (size_t t = 0; t < all.size(); t += 3)
    if (std::max({sphere.points.host()[all[t]].y, sphere.points.host()[all[t + 1]].y, sphere.points.host()[all[t + 2]].y}) < height)
      kept.insert(kept.end(), {all[t], all[t + 1], all[t + 2]});
  return knead::make_triangle_surface({sphere.points.host().begin(), sphere.points.host().end()}, kept);
}

TEST(MeshToSdf, TakesWhatIsMostlyOpenForAShell) {
  for (const auto& [solid, height, shell] :
       {std::tuple{"auto", 0.9, false}, {"auto", 0.0, true}, {"solid", 0.0, false}, {"shell", 0.9, true}, {"shell", 2.0, true}}) {
    OneNode node("mesh_to_sdf");
    node.set("resolution", 32).set("solid", solid).set("thickness", 0.3).connect("mesh", cut_off(height)).run();
    const std::string what = std::string(solid) + " at " + std::to_string(height);
    EXPECT_EQ(node.out<knead::Report>("report").word("taken_as"), shell ? "shell" : "solid") << what;
    const Sdf& sdf = node.out<Sdf>("sdf");
    EXPECT_EQ(value_at(sdf, {0, -0.5, 0}) < 0, !shell) << what;
    EXPECT_NEAR(value_at(sdf, {0, -1, 0}), shell ? -0.15 : 0, 0.5 * sdf.voxel_size) << what;
    EXPECT_NEAR(sdf.distance->signed_distance({0, -1.3, 0}).distance, shell ? 0.15 : 0.3, 0.01) << what;
    if (shell) EXPECT_NE(node.all_warnings().find("solid: solid"), std::string::npos) << what;
  }
}

TEST(MeshToSdf, IsTheSameFieldNearABodyAndNothingElsewhere) {
  const Surface fist = knead::make_fist(2, 3000);
  Surface body = knead::make_sphere(0.3, 3);
  body.placement.translation = {0, 1.1, 0};
  OneNode whole("mesh_to_sdf", 2), part("mesh_to_sdf", 2);
  whole.set("voxel_size", 0.02).connect("mesh", fist).run();
  part.set("voxel_size", 0.02).connect("mesh", fist).connect("near", body).run();
  const Sdf &all = whole.out<Sdf>("sdf"), &near = part.out<Sdf>("sdf");
  EXPECT_LT(near.grid.size(), all.grid.size() / 2);
  std::mt19937 random(5);
  std::uniform_real_distribution<double> u(-0.3, 0.3);
  for (int n = 0; n < 300; ++n) {
    const Vec3d p = body.placement.translation + Vec3d{u(random), u(random), u(random)};
    ASSERT_NEAR(value_at(near, p), value_at(all, p), 0.006) << "voxels elsewhere";
  }
  EXPECT_EQ(near.distance->signed_distance({0.1, 0, 0}).distance, all.distance->signed_distance({0.1, 0, 0}).distance) << "exact everywhere";
  OneNode by_default("mesh_to_sdf", 2);
  by_default.connect("mesh", fist).connect("near", body).run();
  EXPECT_LT(by_default.out<Sdf>("sdf").voxel_size, 0.03) << "about the body's edges";
  body.placement.translation.y = 1.2;
  part.connect("near", body).run();
  EXPECT_EQ(part.builds, 2) << "for another place of the body";
}

}  // namespace
