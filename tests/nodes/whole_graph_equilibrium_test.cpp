// A graph with an equilibrium on a device: on a fake one always (host memory that the host may not touch), and on CUDA where there is a device.
#include <gtest/gtest.h>

#include <cstring>

#include "graph/evaluator.h"
#include "io/graph_file.h"
#include "kernels/port_types.h"
#include "tests/kernels/on_device.h"

namespace knead {
namespace whole_graph_equilibrium_test {

// A capsule that turns as it falls and a ball that swells press a blob that is pinned at its foot; at frame 1 nothing touches.
const char* const kPress = R"(knead: 1
frames: 1-4
nodes:
  body: {type: primitive, shape: blob, resolution: 10, height: 2}
  thumb: {type: primitive, shape: capsule, radius: 0.4, height: 0.4, resolution: 8}
  falls: {type: transform, mesh: thumb, keys: {1: {translate: [0.1, 2.4, 0]}, 2: {translate: [0.1, 1.45, 0]}, 4: {translate: [0.1, 1.35, 0], rotate: [0, 40, 70]}}}
  ball: {type: primitive, shape: sphere, radius: 0.4, resolution: 3}
  swells: {type: transform, mesh: ball, keys: {1: {translate: [1.9, 0, 0], scale: 0.8}, 2: {translate: [1.2, 0, 0], scale: 0.9}, 4: {translate: [1.15, 0, 0], scale: 1}}}
  thumb_sdf: {type: mesh_to_sdf, mesh: falls, voxel_size: 0.06}
  ball_sdf: {type: mesh_to_sdf, mesh: swells, resolution: 16}
  pins: {type: weights, surface: body, region: plane, normal: [0, 1, 0], point: [0, -0.7, 0]}
  tets: {type: build_tets, surface: body, max_depth: 4}
  press: {type: equilibrium, surface: body, sdf: [thumb_sdf, ball_sdf], tets: tets, lattice: tets.lattice, pins: pins}
  exact: {type: collide_sdf, mode: project, surface: press.surface, sdf: [thumb_sdf, ball_sdf]}
)";

struct Results {
  Surface surface;
  Buffer<Vec3f> points;
  Report report;
};

struct OnExecutor {
  explicit OnExecutor(Executor& executor) : evaluator(compile(read_graph_text(kPress, "scene.yaml"), graph_file_options()), options(executor)) {}
  static EvaluatorOptions options(Executor& executor) {
    EvaluatorOptions made;
    made.executor = &executor;
    return made;
  }
  Results get(int frame) {
    const FrameResult result = evaluator.evaluate(frame, {"exact.surface", "press.points", "press.report"});
    EXPECT_FALSE(result.error) << result.error->what();
    if (result.error) return {};
    return {result.values.at("exact.surface").as<Surface>(), result.values.at("press.points").as<Points>().values,
            result.values.at("press.report").as<Report>()};
  }
  Evaluator evaluator;
};

bool same_bits(const Buffer<Vec3f>& a, const Buffer<Vec3f>& b) {
  return a.size() == b.size() && std::memcmp(a.host().data(), b.host().data(), a.bytes()) == 0;
}

double apart(const Buffer<Vec3f>& a, const Buffer<Vec3f>& b) {
  double most = 0;
  for (size_t i = 0; i < a.size(); ++i) most = std::max(most, static_cast<double>(length(a.host()[i] - b.host()[i])));
  return most;
}

class WholeGraphEquilibrium : public testing::TestWithParam<const char*> {
 protected:
  void SetUp() override {
    device_ = on_device::device_named(GetParam());
    KNEAD_NEEDS(device_);
  }
  std::unique_ptr<Executor> device_;
};

// Both descend to where the forces balance: roundings on the way, which differ, do not add up.
TEST_P(WholeGraphEquilibrium, GivesTheHostsShape) {
  constexpr double kRounding = 1e-5;  // of the diagonal
  const auto cpu = make_cpu_executor(2);
  OnExecutor here(*cpu), there(*device_);
  for (const int frame : {2, 3, 4}) {
    const Results expected = here.get(frame), result = there.get(frame);
    ASSERT_EQ(result.surface.vertices(), expected.surface.vertices());
    EXPECT_EQ(result.report.word("ended"), expected.report.word("ended")) << "frame " << frame;
    EXPECT_NEAR(result.report.number("iterations"), expected.report.number("iterations"), 2) << "frame " << frame;
    EXPECT_LT(apart(result.surface.points, expected.surface.points) / expected.surface.diagonal(), kRounding) << "frame " << frame;
    if (frame == 4) EXPECT_GT(apart(here.get(1).surface.points, expected.surface.points) / expected.surface.diagonal(), 0.02) << "a press";
  }
}

TEST_P(WholeGraphEquilibrium, NothingTouchedMeansNothingChanged) {
  OnExecutor there(*device_);
  const Results result = there.get(1);
  EXPECT_EQ(result.report.word("ended"), "no contact");
  EXPECT_TRUE(same_bits(result.surface.points, there.evaluator.get<Surface>("body", 1).points));
}

TEST_P(WholeGraphEquilibrium, MovesTablesOnceAndThenReadsOneStructAnEvaluation) {
  OnExecutor there(*device_);
  there.get(3);
  const DeviceFigures first = on_device::figures_of(*device_);
  const uint64_t by_nodes = there.evaluator.figures().by_nodes.count;
  const Results result = there.get(4);
  const DeviceFigures second = on_device::figures_of(*device_);
  EXPECT_LT(second.copied_bytes - first.copied_bytes, first.copied_bytes / 4);
  const EvaluatorFigures figures = there.evaluator.figures();
  EXPECT_EQ(figures.moved.bytes + figures.by_nodes.bytes, second.copied_bytes);
  const auto looks = static_cast<uint64_t>(result.report.number("evaluations") + result.report.number("memory_updates"));
  const uint64_t copies = there.evaluator.figures().by_nodes.count - by_nodes;
  EXPECT_GE(copies, looks);
  EXPECT_LE(copies, looks + 14)
      << "contacts listed anew, where colliders came in, the colliders (two tables, and one again), and where faces are pierced";
}

TEST_P(WholeGraphEquilibrium, FramesSideBySideAreThoseOneByOne) {
  const auto other = on_device::device_named(GetParam());
  OnExecutor single(*device_), batch(*other);
  int frames = 0;
  batch.evaluator.evaluate_frames({4, 3, 1, 2}, {"press.points"}, false, [&](const FrameResult& result) {
    ASSERT_FALSE(result.error) << result.error->what();
    EXPECT_TRUE(same_bits(result.values.at("press.points").as<Points>().values, single.get(result.frame).points)) << result.frame;
    ++frames;
  });
  EXPECT_EQ(frames, 4);
}

// A fine H that starts from the state of a coarse one, which passes through the host.
TEST_P(WholeGraphEquilibrium, StartsFromAnotherH) {
  std::string text = kPress;
  text.replace(text.find("  press:"), 0,
               "  coarse: {type: build_tets, surface: body, max_depth: 3}\n"
               "  first: {type: equilibrium, surface: body, sdf: [thumb_sdf, ball_sdf], tets: coarse, lattice: coarse.lattice, pins: pins}\n");
  text.replace(text.find("pins: pins}\n  exact"), 10, "pins: pins, start: first.state");
  const auto cpu = make_cpu_executor(2);
  Results results[2];
  for (Executor* executor : {cpu.get(), device_.get()}) {
    Evaluator evaluator(compile(read_graph_text(text.c_str(), "scene.yaml"), graph_file_options()), OnExecutor::options(*executor));
    const FrameResult result = evaluator.evaluate(4, {"exact.surface", "press.points", "press.report"});
    ASSERT_FALSE(result.error) << result.error->what();
    results[executor == device_.get()] = {result.values.at("exact.surface").as<Surface>(), result.values.at("press.points").as<Points>().values,
                                          result.values.at("press.report").as<Report>()};
  }
  for (const Results& result : results) EXPECT_EQ(result.report.word("started"), "state");
  EXPECT_EQ(results[1].report.word("ended"), results[0].report.word("ended"));
  EXPECT_LT(apart(results[0].surface.points, results[1].surface.points) / results[0].surface.diagonal(), 1e-4);
}

INSTANTIATE_TEST_SUITE_P(Devices, WholeGraphEquilibrium, testing::Values("fake", "cuda"), [](const auto& info) { return std::string(info.param); });

}  // namespace whole_graph_equilibrium_test
}  // namespace knead
