// Every example is a test: it runs and asserts the figures that it is there to show.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <random>
#include <string>
#include <vector>

#include "graph/evaluator.h"
#include "io/graph_file.h"
#include "kernels/port_types.h"
#include "tests/paths.h"

namespace knead {
namespace examples_test {

constexpr double kDeepestAllowed = 1e-4;  // of the diagonal

std::shared_ptr<const Plan> plan_of(const std::string& file) {
  const std::string path = source_dir() + "/examples/" + file;
  return compile(read_graph_file(path), graph_file_options());
}

std::vector<FrameResult> run(Evaluator& evaluator, const std::vector<int>& frames, const std::vector<std::string>& outputs) {
  std::vector<FrameResult> results;
  evaluator.evaluate_frames(frames, outputs, false, [&](FrameResult result) { results.push_back(std::move(result)); });
  std::sort(results.begin(), results.end(), [](const auto& a, const auto& b) { return a.frame < b.frame; });
  return results;
}

const Report& report_of(const FrameResult& result, const std::string& name) {
  return result.values.at(name).as<Report>();
}

TEST(ExampleHead, KeepsItsVolumeAndStaysOutsideSoftAndStiff) {
  Evaluator evaluator(plan_of("head/head.yaml"));
  const std::vector<int> frames{1, 20, 24, 28, 32, 40, 44, 48};
  const auto results = run(evaluator, frames, {"soft.report", "stiff.report"});
  ASSERT_EQ(results.size(), frames.size());
  double most = 0;
  for (const FrameResult& result : results) {
    ASSERT_FALSE(result.error) << result.error->what();
    for (const char* name : {"soft.report", "stiff.report"}) {
      const Report& report = report_of(result, name);
      EXPECT_LT(std::fabs(report.number("volume_error")), 0.01) << name << " frame " << result.frame;
      EXPECT_LE(report.number("penetration_max_relative"), kDeepestAllowed) << name << " frame " << result.frame;
      most = std::max(most, report.number("displacement_max_relative"));
    }
  }
  EXPECT_GT(most, 0.03) << "the fist must dent the head";
  EXPECT_EQ(evaluator.figures().evaluations["build_tets"], 2u) << "once for each deform";
}

TEST(ExampleHead, ComesOutUntouchedBeforeTheFistArrives) {
  Evaluator evaluator(plan_of("head/head.yaml"));
  const Surface rest = evaluator.get<Surface>("head.surface", 1);
  const Surface soft = evaluator.get<Surface>("soft.surface", 1);
  ASSERT_EQ(rest.points.size(), soft.points.size());
  EXPECT_EQ(std::memcmp(rest.points.host().data(), soft.points.host().data(), rest.points.bytes()), 0);
}

TEST(ExampleHead, GivesTheSameBytesInAnyOrderOnAnyNumberOfThreads) {
  const std::vector<int> frames{26, 32};
  const auto points_of = [&](int threads, bool backwards) {
    const auto executor = make_cpu_executor(threads);
    EvaluatorOptions options;
    options.executor = executor.get();
    Evaluator evaluator(plan_of("head/head.yaml"), options);
    std::vector<int> order = frames;
    if (backwards) std::reverse(order.begin(), order.end());
    std::vector<Buffer<Vec3f>> points(2);
    for (const int frame : order) points[frame == frames[1]] = evaluator.get<Surface>("soft.surface", frame).points;
    return points;
  };
  const auto one = points_of(1, false), two = points_of(2, true);
  for (size_t i = 0; i < 2; ++i) EXPECT_EQ(std::memcmp(one[i].host().data(), two[i].host().data(), one[i].bytes()), 0) << "frame " << frames[i];
}

TEST(ExampleCrush, RecoversItsVolumeWithoutInvertedTets) {
  Evaluator evaluator(plan_of("crush/crush.yaml"));
  const auto results = run(evaluator, {6, 12}, {"figures.report"});
  ASSERT_EQ(results.size(), 2u);
  for (const FrameResult& result : results) {
    ASSERT_FALSE(result.error) << result.error->what();
    const Report& report = report_of(result, "figures.report");
    EXPECT_LT(std::fabs(report.number("volume_error")), 0.05) << "frame " << result.frame;
    EXPECT_EQ(report.number("inverted_tets"), 0) << "frame " << result.frame;
    EXPECT_LE(report.number("iterations"), 250) << "frame " << result.frame;
    EXPECT_LE(report.number("penetration_max_relative"), kDeepestAllowed) << "frame " << result.frame;
  }
}

TEST(ExampleCascade, ComesToRestFromACoarseStart) {
  Evaluator evaluator(plan_of("crush/cascade.yaml"));
  const auto results = run(evaluator, {6, 12}, {"figures.report"});
  for (const FrameResult& result : results) {
    ASSERT_FALSE(result.error) << result.error->what();
    const Report& report = report_of(result, "figures.report");
    EXPECT_EQ(report.word("started"), "state") << result.frame;
    EXPECT_EQ(report.word("ended"), "at rest") << result.frame;
    EXPECT_LE(report.number("iterations"), 40) << result.frame;
    EXPECT_LT(std::fabs(report.number("volume_error")), 1e-3) << result.frame;
    EXPECT_EQ(report.number("inverted_tets"), 0) << result.frame;
    EXPECT_LE(report.number("penetration_max_relative"), kDeepestAllowed) << result.frame;
  }
}

TEST(ExampleSdfPipeline, PushesABodyThroughARingFromAVdbFile) {
  Evaluator evaluator(plan_of("sdf_pipeline/sdf_pipeline.yaml"));
  const auto results = run(evaluator, {1, 16, 24}, {"press.report", "press.surface"});
  ASSERT_EQ(results.size(), 3u);
  for (const FrameResult& result : results) {
    ASSERT_FALSE(result.error) << result.error->what();
    const Report& report = report_of(result, "press.report");
    EXPECT_LT(std::fabs(report.number("volume_error")), 0.03) << "frame " << result.frame;
    EXPECT_LE(report.number("penetration_max_relative"), kDeepestAllowed) << "frame " << result.frame;
  }
  EXPECT_EQ(report_of(results[0], "press.report").number("displacement_max_relative"), 0);
  EXPECT_GT(report_of(results[2], "press.report").number("displacement_max_relative"), 0.03);
  EXPECT_EQ(evaluator.figures().evaluations["read_vdb"], 1u);
}

}  // namespace examples_test
}  // namespace knead
