// What deform_equilibrium must show on the examples' bodies, and on the press of the shared data.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <string>
#include <vector>

#include "graph/evaluator.h"
#include "io/graph_file.h"
#include "kernels/port_types.h"
#include "tests/paths.h"

namespace knead {
namespace equilibrium_figures_test {

GraphSpec example(const std::string& file) {
  return read_graph_file(source_dir() + "/examples/" + file);
}

Evaluator evaluator_of(const GraphSpec& graph) {
  return Evaluator(compile(graph, graph_file_options()));
}

void expect_good(Evaluator& evaluator, const std::string& node, int frame, int iterations, double volume) {
  const Report report = evaluator.get<Report>(node + ".report", frame);
  EXPECT_EQ(report.word("ended"), "at rest") << frame;
  EXPECT_LE(report.number("iterations"), iterations) << frame;
  EXPECT_LE(report.number("gradient"), 3e-4) << frame;
  EXPECT_LT(std::fabs(report.number("volume_error")), volume) << frame;
  EXPECT_EQ(report.number("inverted_tets"), 0) << frame;
  EXPECT_LE(report.number("penetration_max_relative"), 1e-4) << frame;
  EXPECT_LE(report.number("penetration_faces_max_relative"), 1e-4) << frame;
}

TEST(EquilibriumFigures, TheHeadComesToRestWithItsVolume) {
  GraphSpec graph = example("head/head.yaml");
  graph.add("rest", "deform_equilibrium", {{"surface", "head"}, {"sdf", "solid"}});
  Evaluator evaluator = evaluator_of(graph);
  for (const int frame : {24, 32, 48}) expect_good(evaluator, "rest", frame, 60, 3e-4);  // 1e-5 before faces are kept out of the fist too
}

TEST(EquilibriumFigures, TheCrushComesToRestWithItsVolume) {
  GraphSpec graph = example("crush/crush.yaml");
  graph.add("rest", "deform_equilibrium", {{"surface", "ball"}, {"sdf", Literal::List{"upper_sdf", "lower_sdf"}}, {"max_depth", 4}});
  Evaluator evaluator = evaluator_of(graph);
  for (const int frame : {6, 12}) expect_good(evaluator, "rest", frame, 75, 1e-3);
}

// H's cells are split down to single vertices of M: else there would be nothing to make it finer for.
std::string fine_tets(int depth) {
  const std::string d = std::to_string(depth);
  return "  tets" + d + ": {type: build_tets, surface: ball, max_depth: " + d + ", max_vertices: 1}\n";
}

std::string fine_press(const std::string& name, int depth, const std::string& more) {
  const std::string d = std::to_string(depth);
  return "  " + name + ": {type: equilibrium, surface: ball, sdf: [above, below], tets: tets" + d + ", lattice: tets" + d + ".lattice, " + more +
         "}\n";
}

TEST(EquilibriumFigures, ItsShapeAndItsCountFromACoarserOneHardlyDependOnTheDepth) {
  const std::string gradient_alone = "threshold: 1.0e-3, displacement: 1, penetration: 1";
  std::string text = R"(knead: 1
nodes:
  ball: {type: primitive, shape: sphere, radius: 1, resolution: 5}
  block: {type: primitive, shape: box, size: [6, 4, 6], resolution: 6}
  upper: {type: transform, mesh: block, translate: [0, 2.27, 0]}
  lower: {type: transform, mesh: block, translate: [0, -2.27, 0]}
  above: {type: mesh_to_sdf, mesh: upper}
  below: {type: mesh_to_sdf, mesh: lower}
)";
  for (const int depth : {2, 3, 4, 5}) text += fine_tets(depth);
  for (const int depth : {4, 5}) {
    const std::string d = std::to_string(depth);
    text += fine_press("coarse" + d, depth - 2, "threshold: 1.0e-2, displacement: 1.0e-2, penetration: 2.0e-2");
    text += fine_press("rest" + d, depth, "max_iterations: 150");
    text += fine_press("started" + d, depth, "start: coarse" + d + ".state");
    text += fine_press("count" + d, depth, gradient_alone + ", start: coarse" + d + ".state");
  }
  Evaluator evaluator = evaluator_of(read_graph_text(text, "fine_crush.yaml"));
  const Surface ball = evaluator.get<Surface>("ball", 1), coarse = evaluator.get<Surface>("rest4.surface", 1);
  const auto rms = [&](const Surface& a, const Surface& b) {
    double squares = 0;
    for (size_t i = 0; i < a.points.size(); ++i) squares += std::pow(static_cast<double>(length(a.points.host()[i] - b.points.host()[i])), 2);
    return std::sqrt(squares / static_cast<double>(a.points.size()));
  };
  double dent = 0;
  for (size_t i = 0; i < ball.points.size(); ++i) dent = std::max(dent, static_cast<double>(length(coarse.points.host()[i] - ball.points.host()[i])));
  EXPECT_LT(rms(coarse, evaluator.get<Surface>("rest5.surface", 1)), 0.02 * dent);
  EXPECT_LE(evaluator.get<Report>("rest5.report", 1).number("iterations"), 40) << "from rest too: its first steps crumple nothing";
  for (const std::string d : {"4", "5"}) {
    EXPECT_EQ(evaluator.get<Report>("rest" + d + ".report", 1).word("ended"), "at rest") << d;
    EXPECT_LT(rms(evaluator.get<Surface>("rest" + d + ".surface", 1), evaluator.get<Surface>("started" + d + ".surface", 1)), 1e-3 * dent) << d;
    const Report count = evaluator.get<Report>("count" + d + ".report", 1);
    EXPECT_EQ(count.word("started"), "state") << d;
    EXPECT_LE(count.number("gradient"), 1e-3) << d;
    EXPECT_LE(count.number("iterations"), 30) << d;
  }
}

// A ball goes into a finer one by a thousandth of its diagonal a frame. Where fresh contacts crumple fine tets, neighbouring frames end half a step apart;
// where contacts are off by a tenth of `penetration` in the mean at rest, 7 % of one.
TEST(EquilibriumFigures, AFineBodyIsSmoothInTime) {
  const std::string text = R"(knead: 1
nodes:
  ball: {type: primitive, shape: sphere, radius: 1, resolution: 5}
  small: {type: primitive, shape: sphere, radius: 0.5, resolution: 5}
  motion: {type: transform, mesh: small, keys: {1: {translate: [0.03, 0.02, 1.18]}, 1001: {translate: [0.03, 0.02, -2.2841]}}}
  solid: {type: mesh_to_sdf, mesh: motion}
)" + fine_tets(6) + "  press: {type: equilibrium, surface: ball, sdf: solid, tets: tets6, lattice: tets6.lattice}\n";
  Evaluator evaluator = evaluator_of(read_graph_text(text, "fine_ball.yaml"));
  std::vector<Surface> frames;
  for (int frame = 1; frame <= 5; ++frame) frames.push_back(evaluator.get<Surface>("press.surface", frame));
  const auto at = [&](size_t frame, size_t i) { return frames[frame].points.host()[i]; };
  float most = 0;
  for (size_t f = 1; f + 1 < frames.size(); ++f)
    for (size_t i = 0; i < frames[f].points.size(); ++i) most = std::max(most, length(at(f - 1, i) - 2.0f * at(f, i) + at(f + 1, i)));
  EXPECT_LT(most, 0.05f * 3.4641e-3f);
}

// The press of shared/data/press: straight at the pose, and played.
TEST(EquilibriumFigures, ThePressKeepsFacesOutsideAndIsTheSamePlayed) {
  if (!std::filesystem::exists(shared_data())) GTEST_SKIP() << "no shared data";
  const GraphSpec graph = read_graph_text("knead: 1\nframes: 1-4\nnodes:\n  block: {type: read_mesh, path: " + shared_data() +
                                              "/press/block20.obj}\n"
                                              R"(
  ball: {type: primitive, shape: sphere, radius: 0.35, resolution: 5}
  motion: {type: transform, mesh: ball, keys: {1: {translate: [0.03, 0.02, 1.4]}, 4: {translate: [0.03, 0.02, 1.0]}}}
  solid: {type: mesh_to_sdf, mesh: motion}
  floor: {type: weights, surface: block, region: plane, normal: [0, 0, 1], point: [0, 0, 0.001]}
  press: {type: deform_equilibrium, surface: block, sdf: solid, max_depth: 4, pins: floor, hold: 0, contact_samples: 2, face_samples: 45}
)",
                                          "press.yaml");
  Evaluator straight = evaluator_of(graph), played = evaluator_of(graph);
  expect_good(straight, "press", 4, 75, 5e-3);
  EXPECT_LT(straight.get<Report>("press.report", 4).number("penetration_faces_max"), 1e-3) << "block edges, over 45 samples of every triangle";
  EXPECT_GT(straight.get<Report>("press.report", 4).number("displacement_max"), 0.34);
  Surface last;
  for (int frame = 1; frame <= 4; ++frame) last = played.get<Surface>("press.surface", frame);
  const Surface first = straight.get<Surface>("press.surface", 4);
  EXPECT_EQ(std::memcmp(first.points.host().data(), last.points.host().data(), first.points.bytes()), 0);
}

}  // namespace equilibrium_figures_test
}  // namespace knead
