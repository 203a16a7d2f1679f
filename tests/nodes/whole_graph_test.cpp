// The main job as a whole, from meshes to the deformed surface: the same bytes whatever the order, the threads and the executor; nothing touched
// where nothing touches; nothing computed again that an edit does not reach.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <map>
#include <random>

#include "graph/evaluator.h"
#include "io/graph_file.h"
#include "kernels/port_types.h"
#include "tests/nodes/press_scene.h"

namespace knead {
namespace whole_graph_test {

using testing::Pair;
using testing::UnorderedElementsAre;

std::shared_ptr<const Plan> scene(const std::vector<std::pair<std::string, Literal>>& overrides = {}) {
  CompileOptions options = graph_file_options();
  options.overrides = overrides;
  return compile(read_graph_text(press_scene::kPress, "scene.yaml"), options);
}

const std::vector<std::string> kOutputs{"press.surface", "press.points", "press.volume_change", "press.report"};

// What a frame gives, each part as a digest of its bytes; the times in the report are no result.
using Digest = std::map<std::string, std::string>;

Digest digest_of(const FrameResult& result) {
  EXPECT_FALSE(result.error) << result.error->what();
  if (result.error) return {};
  Digest digest;
  const auto add = [&](const std::string& name, const auto& buffer) {
    digest[name] = Hasher().bytes(buffer.host().data(), buffer.bytes()).key().text();
  };
  add("surface", result.values.at("press.surface").as<Surface>().points);
  add("points", result.values.at("press.points").as<Points>().values);
  add("volume_change", result.values.at("press.volume_change").as<Weights>().values);
  const Report& report = result.values.at("press.report").as<Report>();
  for (const char* name : {"iterations", "volume_error", "penetration_rms", "stretch_mean", "unrest", "displacement_max"})
    digest[name] = Hasher().add(report.number(name)).key().text();
  digest["ended"] = report.word("ended");
  return digest;
}

std::map<int, Digest> results_of(Executor& executor, const std::vector<int>& frames, bool one_by_one) {
  EvaluatorOptions options;
  options.executor = &executor;
  Evaluator evaluator(scene(), options);
  std::map<int, Digest> results;
  const auto keep = [&](const FrameResult& result) { results[result.frame] = digest_of(result); };
  if (one_by_one) {
    for (const int frame : frames) keep(evaluator.evaluate(frame, kOutputs));
  } else {
    evaluator.evaluate_frames(frames, kOutputs, false, keep);
  }
  return results;
}

TEST(WholeGraph, GivesTheSameBytesInAnyOrderAndOnAnyThreads) {
  const auto one = make_cpu_executor(1), two = make_cpu_executor(2);
  const auto expected = results_of(*one, {1, 2, 3, 4, 5}, true);
  ASSERT_EQ(expected.size(), 5u);
  EXPECT_NE(expected.at(4).at("surface"), expected.at(5).at("surface")) << "frames must differ for this test to tell anything";
  std::vector<int> shuffled{1, 2, 3, 4, 5};
  std::shuffle(shuffled.begin(), shuffled.end(), std::mt19937(7));
  EXPECT_EQ(results_of(*one, {5, 4, 3, 2, 1}, false), expected) << "one thread, backwards";
  EXPECT_EQ(results_of(*two, shuffled, true), expected) << "two threads, shuffled, one by one";
  EXPECT_EQ(results_of(*two, shuffled, false), expected) << "two threads, shuffled, side by side";
  EXPECT_EQ(results_of(*two, {3}, true).at(3), expected.at(3)) << "a frame that is asked for first and alone";
  const auto serial = make_serial_executor();
  EXPECT_EQ(results_of(*serial, shuffled, false), results_of(*serial, {1, 2, 3, 4, 5}, true));
}

// The serial executor runs the bodies one vertex at a time and not in lanes, so sums are rounded in another order.
TEST(WholeGraph, GivesTheSameOnTheSerialExecutorUpToRounding) {
  constexpr double kRounding = 1e-5;  // of the diagonal; 6e-8 was measured
  const auto serial = make_serial_executor(), cpu = make_cpu_executor(2);
  const auto surface_of = [](Executor& executor, int frame) {
    EvaluatorOptions options;
    options.executor = &executor;
    return Evaluator(scene(), options).get<Surface>("press.surface", frame);
  };
  for (const int frame : {3, 5}) {
    const Surface a = surface_of(*serial, frame), b = surface_of(*cpu, frame);
    double most = 0;
    for (size_t i = 0; i < a.points.size(); ++i) most = std::max(most, static_cast<double>(length(a.points.host()[i] - b.points.host()[i])));
    EXPECT_LT(most / a.diagonal(), kRounding) << frame;
  }
}

TEST(WholeGraph, GivesBackTheRestShapeBitForBitWhereNothingTouches) {
  Evaluator evaluator(scene());
  const Surface rest = evaluator.get<Surface>("body", 1), first = evaluator.get<Surface>("press.surface", 1);
  ASSERT_EQ(rest.points.size(), first.points.size());
  EXPECT_EQ(std::memcmp(rest.points.host().data(), first.points.host().data(), rest.points.bytes()), 0);
  EXPECT_TRUE(first.placement == rest.placement);
  const Surface last = evaluator.get<Surface>("press.surface", 5);
  EXPECT_NE(std::memcmp(rest.points.host().data(), last.points.host().data(), rest.points.bytes()), 0);
  EXPECT_EQ(evaluator.get<Report>("press.report", 5).number("vertices_inside"), 0);
}

TEST(WholeGraph, BuildsNothingAgainThatALateParameterDoesNotReach) {
  EvaluatorOptions options;
  options.cache = std::make_shared<Cache>();
  Evaluator first(scene(), options);
  first.evaluate(3, kOutputs);
  const auto made = first.figures().evaluations;
  EXPECT_EQ(made.at("build_tets"), 1u);
  EXPECT_EQ(made.at("mesh_to_sdf"), 2u);

  Evaluator again(scene(), options);
  again.evaluate(3, kOutputs);
  EXPECT_TRUE(again.figures().evaluations.empty()) << "nothing changed";

  Evaluator softer(scene({{"press.stiffness", 0.1}}), options);
  const uint64_t hits = options.cache->figures().hits;
  softer.evaluate(3, kOutputs);
  EXPECT_THAT(softer.figures().evaluations, UnorderedElementsAre(Pair("iterate", 1), Pair("collide_sdf", 1), Pair("measure", 1)))
      << "the loop, the exact end and the figures; neither tets nor a field";
  EXPECT_GT(options.cache->figures().hits, hits);

  Evaluator finer(scene({{"press.tets.max_vertices", 2}}), options);
  finer.evaluate(3, kOutputs);
  EXPECT_EQ(finer.figures().evaluations.count("mesh_to_sdf"), 0u);
  EXPECT_EQ(finer.figures().evaluations.at("build_tets"), 1u) << "an early parameter does reach it";
}

TEST(WholeGraph, BuildsARigidCollidersFieldOnceForAllFrames) {
  Evaluator evaluator(scene({{"swells.keys", Literal::Map{}}}));
  const CacheFigures before = evaluator.figures().cache;
  evaluator.evaluate_frames({1, 2, 3, 4, 5}, {"cube_sdf", "ball_sdf"}, false, [](const FrameResult& result) { ASSERT_FALSE(result.error); });
  // The falling cube is placed in every frame; its grid is the same buffer.
  const Sdf early = evaluator.get<Sdf>("cube_sdf", 1), late = evaluator.get<Sdf>("cube_sdf", 5);
  EXPECT_EQ(early.grid.host().data(), late.grid.host().data());
  EXPECT_FALSE(early.placement == late.placement);
  EXPECT_GT(evaluator.figures().cache.hits, before.hits);
  EXPECT_EQ(evaluator.figures().evaluations.at("mesh_to_sdf"), 6u) << "placed five times, and the one that stands still once";
}

}  // namespace whole_graph_test
}  // namespace knead
