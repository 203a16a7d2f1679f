// The nodes of the paper's loop on H, and measure: what they add to their kernels (tests/kernels has the mathematics).
#include <gtest/gtest.h>

#include <cstring>

#include "graph/error.h"
#include "kernels/loop/enforce_stiffness.h"
#include "kernels/loop/hold.h"
#include "kernels/loop/restore_volume.h"
#include "tests/kernels/loop/loop_fixture.h"
#include "tests/nodes/direct_run.h"

namespace knead {
void register_enforce_stiffness(Registry&);
void register_hold(Registry&);
void register_map_to_surface(Registry&);
void register_map_to_tets(Registry&);
void register_measure(Registry&);
void register_restore_volume(Registry&);
}  // namespace knead

namespace {

namespace fixture = knead::loop_fixture;
using knead::Buffer;
using knead::Lattice;
using knead::Literal;
using knead::Points;
using knead::Report;
using knead::Surface;
using knead::TetMesh;
using knead::Vec3f;
using knead::Weights;
using knead::direct::DirectRun;

const fixture::Scene& loop_scene() {
  static const fixture::Scene scene = [] {
    const auto executor = knead::make_serial_executor();
    return fixture::ball(0.3, 2, *executor);
  }();
  return scene;
}

template <class T>
bool same_bits(const Buffer<T>& a, const Buffer<T>& b) {
  return a.size() == b.size() && std::memcmp(a.host().data(), b.host().data(), a.bytes()) == 0;
}

Points shaken_h() {
  return {fixture::shaken(loop_scene().tets.rest, 0.1f, 31)};
}

TEST(RestoreVolumeNode, PassesItsParametersOn) {
  const auto executor = knead::make_cpu_executor(2);
  DirectRun run(knead::register_restore_volume, "restore_volume",
                Literal::Map{{"relaxation", 0.3}, {"regularisation", 0.01}, {"max_step", 0.25}, {"sweeps", 3}, {"errors", "plain"}});
  run.give("points", shaken_h()).give("tets", loop_scene().tets).at(1);
  knead::RestoreVolumeSettings settings;
  settings.relaxation = 0.3;
  settings.regularisation = 0.01;
  settings.max_step = 0.25;
  settings.sweeps = 3;
  settings.relative = false;
  EXPECT_TRUE(same_bits(run.result<Points>().values, restore_volume(*executor, shaken_h().values, loop_scene().tets, settings)));
}

TEST(EnforceStiffnessNode, PassesItsParametersAndPaintOn) {
  const auto executor = knead::make_cpu_executor(2);
  std::vector<float> paint(loop_scene().tets.vertices(), 0.5f);
  const Weights weights{Buffer<float>(paint)};
  DirectRun run(knead::register_enforce_stiffness, "enforce_stiffness",
                Literal::Map{{"stiffness", 0.9}, {"mode", "stretched_only"}, {"max_step", 0.1}});
  run.give("points", shaken_h()).give("tets", loop_scene().tets).give("weights", weights).at(1);
  knead::EnforceStiffnessSettings settings;
  settings.stiffness = 0.9;
  settings.stretched_only = true;
  settings.max_step = 0.1;
  settings.weights = &weights.values;
  EXPECT_TRUE(same_bits(run.result<Points>().values, enforce_stiffness(*executor, shaken_h().values, loop_scene().tets, settings)));
}

TEST(LoopNodes, AnIterationWithoutContactGivesBackEveryBit) {
  const fixture::Scene& scene = loop_scene();
  const Points still{Buffer<Vec3f>(std::vector<Vec3f>(scene.surface.vertices(), Vec3f{0, 0, 0}))};
  DirectRun lift(knead::register_map_to_tets, "map_to_tets", {});
  lift.give("displacement", still).give("points", Points{scene.tets.rest}).give("lattice", scene.lattice).give("tets", scene.tets).at(1);
  DirectRun volume(knead::register_restore_volume, "restore_volume", {});
  volume.give("points", lift.result<Points>()).give("tets", scene.tets).at(1);
  DirectRun stiff(knead::register_enforce_stiffness, "enforce_stiffness", {});
  stiff.give("points", volume.result<Points>()).give("tets", scene.tets).at(1);
  DirectRun held(knead::register_hold, "hold", Literal::Map{{"strength", 0.1}});
  held.give("points", stiff.result<Points>()).give("tets", scene.tets).at(1);
  DirectRun map(knead::register_map_to_surface, "map_to_surface", {});
  map.give("points", held.result<Points>()).give("lattice", scene.lattice).at(1);
  const Surface& out = map.result<Surface>();
  EXPECT_TRUE(same_bits(out.points, scene.surface.points));
  EXPECT_EQ(out.topology, scene.surface.topology);
  EXPECT_EQ(out.diagonal(), scene.surface.diagonal());
}

TEST(MapToTetsNode, ClampsByTheMeanEdgeWhenItKnowsIt) {
  const fixture::Scene& scene = loop_scene();
  const Points far{Buffer<Vec3f>(std::vector<Vec3f>(scene.surface.vertices(), Vec3f{0, 9, 0}))};
  const auto longest = [&](bool with_tets) {
    DirectRun lift(knead::register_map_to_tets, "map_to_tets", Literal::Map{{"max_step", 0.5}});
    lift.give("displacement", far).give("points", Points{scene.tets.rest}).give("lattice", scene.lattice);
    if (with_tets) lift.give("tets", scene.tets);
    lift.at(1);
    float most = 0;
    for (size_t j = 0; j < scene.tets.vertices(); ++j)
      most = std::max(most, length(lift.result<Points>().values.host()[j] - scene.tets.rest.host()[j]));
    return most;
  };
  EXPECT_NEAR(longest(true), 0.5f * scene.tets.mean_edge, 1e-5f);
  EXPECT_NEAR(longest(false), 0.5f, 1e-5f);
}

TEST(HoldNode, HoldsPinsAndAsksForTheLatticeThatTheyNeed) {
  const fixture::Scene& scene = loop_scene();
  const Weights pins{Buffer<float>(std::vector<float>(scene.surface.vertices(), 1.0f))};
  DirectRun without(knead::register_hold, "hold", {});
  without.give("points", shaken_h()).give("tets", scene.tets).give("pins", pins);
  EXPECT_THROW(without.at(1), knead::Error);
  DirectRun held(knead::register_hold, "hold", {});
  held.give("points", shaken_h()).give("tets", scene.tets).give("pins", pins).give("lattice", scene.lattice).at(1);
  DirectRun map(knead::register_map_to_surface, "map_to_surface", {});
  map.give("points", held.result<Points>()).give("lattice", scene.lattice).at(1);
  EXPECT_TRUE(same_bits(map.result<Surface>().points, scene.surface.points));
}

Surface loop_body(double grown) {
  Surface body = loop_scene().surface;
  std::vector<Vec3f> points = fixture::vector_of(body.points);
  for (Vec3f& p : points) p = p * static_cast<float>(grown);
  body.points = Buffer<Vec3f>(points);
  body.placement.scale = 2;
  return body;
}

TEST(MeasureNode, ReportsWorldUnitsAndFractions) {
  const fixture::Scene& scene = loop_scene();
  knead::Sdf sdf;  // the unit ball without a grid: its triangles are what counts
  sdf.mesh = std::make_shared<Surface>(knead::make_sphere(1, 3));
  sdf.lower = sdf.mesh->lower;
  sdf.upper = sdf.mesh->upper;
  sdf.placement.translation = {0, 2.5, 0};
  Points grown{scene.tets.rest};
  std::vector<Vec3f> x = fixture::vector_of(scene.tets.rest);
  for (Vec3f& p : x) p = p * 1.1f;
  Report loop, build;
  loop.set("iterations", 12);
  loop.set("ended", std::string("at rest"));
  build.set("iterations", 13);
  DirectRun measure(knead::register_measure, "measure", Literal::Map{{"face_samples", 45}});
  measure.give("surface", loop_body(1.1))
      .give("rest", loop_body(1))
      .give("sdf", sdf)
      .give("tets", scene.tets)
      .give("points", Points{Buffer<Vec3f>(x)});
  measure.give("lattice", scene.lattice).give("report", loop).give("report", build).at(1);
  const Report& report = measure.result<Report>();
  const double diagonal = loop_body(1).diagonal() * 2;
  EXPECT_NEAR(report.number("penetration_max"), 0.7, 0.01);
  EXPECT_NEAR(report.number("penetration_max_relative"), report.number("penetration_max") / diagonal, 1e-12);
  EXPECT_GE(report.number("penetration_faces_max"), report.number("penetration_max") - 1e-9);
  EXPECT_GT(report.number("vertices_inside"), 0);
  EXPECT_LT(report.number("penetration_rms"), report.number("penetration_max"));
  EXPECT_NEAR(report.number("volume_error"), 0.331, 1e-4);
  EXPECT_NEAR(report.number("volume") / report.number("volume_rest"), 1.331, 1e-4);
  EXPECT_NEAR(report.number("volume_tets_error"), 0.331, 1e-4);
  EXPECT_NEAR(report.number("stretch_mean"), 0.1, 1e-4);
  EXPECT_EQ(report.number("inverted_tets"), 0);
  EXPECT_NEAR(report.number("displacement_max"), 0.2, 1e-4);
  EXPECT_EQ(report.number("iterations"), 13);
  EXPECT_EQ(report.word("ended"), "at rest");
  for (const float change : measure.result<Weights>(1).values.host()) ASSERT_NEAR(change, 0.331f, 1e-4f);
}

TEST(MeasureNode, TakesInsideOutAndFlatSurfacesAndNothingButSurfaces) {
  Surface turned = loop_body(1), flat = turned;
  auto topology = std::make_shared<knead::MeshTopology>(*turned.topology);
  for (size_t t = 0; t < topology->triangles.size(); t += 3) std::swap(topology->triangles[t], topology->triangles[t + 1]);
  turned.topology = topology;
  DirectRun inside_out(knead::register_measure, "measure", {});
  inside_out.give("surface", turned).give("rest", turned).at(1);
  EXPECT_GT(inside_out.result<Report>().number("volume_rest"), 0);
  EXPECT_EQ(inside_out.result<Report>().number("volume_error"), 0);
  EXPECT_TRUE(std::isnan(inside_out.result<Report>().number("penetration_max")));
  EXPECT_EQ(inside_out.result<Weights>(1).values.size(), turned.vertices());

  std::vector<Vec3f> points = fixture::vector_of(flat.points);
  for (Vec3f& p : points) p.z = 0;
  flat.points = Buffer<Vec3f>(points);
  DirectRun sheet(knead::register_measure, "measure", {});
  sheet.give("surface", flat).give("rest", flat).at(1);
  EXPECT_TRUE(std::isnan(sheet.result<Report>().number("volume_error")));
}

TEST(MeasureNode, RefusesHalfOfH) {
  DirectRun measure(knead::register_measure, "measure", {});
  measure.give("surface", loop_body(1)).give("rest", loop_body(1)).give("tets", loop_scene().tets);
  EXPECT_THROW(measure.at(1), knead::Error);
}

}  // namespace
