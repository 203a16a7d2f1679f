// The whole main job on a device: the loop stays there from its second round to its end, and the results are those of the host. On a fake device
// (host memory that the host may not touch) they are the serial executor's to the bit, for it runs the same bodies; on CUDA they are so up to
// rounding.
#include <gtest/gtest.h>

#include <cstdlib>
#include <cstring>
#include <thread>

#include "graph/evaluator.h"
#include "io/graph_file.h"
#include "kernels/port_types.h"
#include "tests/graph/fake_device.h"
#include "tests/kernels/on_device.h"
#include "tests/nodes/press_scene.h"

namespace knead {
namespace whole_graph_device_test {

using fake_device::FakeDevice;
using press_scene::kPress;

// A ball that is in beyond its middle: it comes in from outside over the first rounds. Nothing is pinned, so that the rigid motion is taken out, and
// the pull to rest is painted.
const char* const kDeep = R"(knead: 1
frames: 1-2
nodes:
  body: {type: primitive, shape: sphere, radius: 1.0, resolution: 3}
  ball: {type: primitive, shape: sphere, radius: 0.3, resolution: 3}
  moves: {type: transform, mesh: ball, keys: {1: {translate: [0, 0.85, 0]}, 2: {translate: [0.1, 0.9, 0]}}}
  solid: {type: mesh_to_sdf, mesh: moves, voxel_size: 0.05}
  paint: {type: weights, surface: body, region: plane, normal: [0, 1, 0], point: [0, -0.5, 0]}
  tets: {type: build_tets, surface: body, max_depth: 4}
  way: {type: approach, surface: body, sdf: solid}
  press:
    type: iterate
    max_iterations: 90
    state: {points: tets.points, surface: body, memory: way}
    body:
      push: {type: collide_sdf, surface: state.surface, sdf: solid, memory: state.memory}
      lift: {type: map_to_tets, displacement: push.displacement, points: state.points, lattice: tets.lattice, tets: tets}
      volume: {type: restore_volume, points: lift, tets: tets, sweeps: 3}
      stiff: {type: enforce_stiffness, points: volume, tets: tets, stiffness: 0.3}
      held: {type: hold, points: stiff, tets: tets, lattice: tets.lattice, weights: paint, strength: 0.01}
      map: {type: map_to_surface, points: held, lattice: tets.lattice}
    next: {points: held, surface: map, memory: push.memory}
)";

struct Results {
  std::vector<Vec3f> surface, points;
  std::string ended;
  double iterations = 0, unrest = 0, diagonal = 0;
};

struct OnExecutor {
  OnExecutor(Executor& executor, const char* graph, const std::vector<std::pair<std::string, Literal>>& overrides = {})
      : evaluator(plan(graph, overrides), options(executor)) {}
  static std::shared_ptr<const Plan> plan(const char* graph, const std::vector<std::pair<std::string, Literal>>& overrides) {
    CompileOptions options = graph_file_options();
    options.overrides = overrides;
    return compile(read_graph_text(graph, "scene.yaml"), options);
  }
  static EvaluatorOptions options(Executor& executor) {
    EvaluatorOptions made;
    made.executor = &executor;
    return made;
  }
  Results get(int frame) {
    const FrameResult result = evaluator.evaluate(frame, {"press.surface", "press.points", "press.report"});
    EXPECT_FALSE(result.error) << result.error->what();
    if (result.error) return {};
    Results results;
    const Surface& surface = result.values.at("press.surface").as<Surface>();
    const auto y = surface.points.host(), x = result.values.at("press.points").as<Points>().values.host();
    results.surface.assign(y.begin(), y.end());
    results.points.assign(x.begin(), x.end());
    results.diagonal = surface.diagonal();
    const Report& report = result.values.at("press.report").as<Report>();
    results.ended = report.word("ended");
    results.iterations = report.number("iterations");
    results.unrest = report.number("unrest");
    return results;
  }
  Evaluator evaluator;
};

bool same_bits(const std::vector<Vec3f>& a, const std::vector<Vec3f>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(Vec3f)) == 0;
}

void expect_same(const Results& a, const Results& b, const std::string& what) {
  EXPECT_TRUE(same_bits(a.surface, b.surface)) << what << ": the surface";
  EXPECT_TRUE(same_bits(a.points, b.points)) << what << ": H";
  EXPECT_EQ(a.iterations, b.iterations) << what;
  EXPECT_EQ(a.ended, b.ended) << what;
  EXPECT_EQ(a.unrest, b.unrest) << what;
}

TEST(WholeGraphOnADevice, GivesTheSerialExecutorsBits) {
  const auto serial = make_serial_executor();
  for (const auto& [graph, frames] : {std::pair{kPress, std::vector<int>{1, 3, 5}}, {kDeep, std::vector<int>{1}}})
    for (const int batch : {0, 8}) {
      FakeDevice fake(size_t{1} << 30, batch);
      OnExecutor here(*serial, graph), there(fake.executor, graph);
      for (const int frame : frames)
        expect_same(here.get(frame), there.get(frame), "frame " + std::to_string(frame) + ", batches of " + std::to_string(batch));
      EXPECT_EQ(fake.executor.figures().loops, frames.size()) << "every loop stays on the device";
    }
}

TEST(WholeGraphOnADevice, TransfersAndAllocatesNothingInTheLoop) {
  for (const auto& [graph, loop] : {std::pair{kPress, std::string("press.press.")}, {kDeep, std::string("press.")}}) {
    DeviceFigures figures[2];
    uint64_t transfers[2];
    for (const int many : {0, 1}) {
      FakeDevice fake;
      OnExecutor there(fake.executor, graph, {{loop + "max_iterations", many ? 60 : 5}, {loop + "min_iterations", 1000}, {loop + "threshold", 0.0}});
      EXPECT_EQ(there.get(1).iterations, many ? 60 : 5);
      EXPECT_EQ(fake.backend.rounds_run, many ? 59 : 4) << "the first round is run from the host";
      figures[many] = fake.executor.figures();
      transfers[many] = there.evaluator.figures().moved.count;
    }
    EXPECT_EQ(transfers[0], transfers[1]);
    EXPECT_EQ(figures[0].allocations, figures[1].allocations);
    EXPECT_EQ(figures[0].copies, figures[1].copies);
    EXPECT_EQ(figures[0].launches, figures[1].launches);
    EXPECT_EQ(figures[1].copies, transfers[1] + 1) << "beside the scheduler's, only how the loop ended";
  }
}

TEST(WholeGraphOnADevice, MovesTablesAndRigidFieldsOnceForAllFrames) {
  FakeDevice fake;
  OnExecutor there(fake.executor, kDeep);
  there.get(1);
  const uint64_t first = there.evaluator.figures().moved.bytes;
  there.get(2);
  const uint64_t second = there.evaluator.figures().moved.bytes - first;
  EXPECT_LT(second, first / 4) << "the field moves with the ball, and its grid stays";
}

TEST(WholeGraphOnADevice, NothingTouchedMeansNothingChanged) {
  FakeDevice fake;
  OnExecutor there(fake.executor, kPress);
  const Surface rest = there.evaluator.get<Surface>("body", 1);
  EXPECT_TRUE(same_bits({rest.points.host().begin(), rest.points.host().end()}, there.get(1).surface));
}

void expect_same_side_by_side(OnExecutor& batch, OnExecutor& single) {
  int frames = 0;
  batch.evaluator.evaluate_frames({5, 3, 1, 4, 2}, {"press.surface"}, false, [&](const FrameResult& result) {
    ASSERT_FALSE(result.error) << result.error->what();
    const auto points = result.values.at("press.surface").as<Surface>().points.host();
    EXPECT_TRUE(same_bits({points.begin(), points.end()}, single.get(result.frame).surface)) << result.frame;
    ++frames;
  });
  EXPECT_EQ(frames, 5);
}

TEST(WholeGraphOnADevice, FramesSideBySideAreThoseOneByOne) {
  FakeDevice one, many;
  OnExecutor single(one.executor, kPress), batch(many.executor, kPress);
  expect_same_side_by_side(batch, single);
  EXPECT_EQ(many.executor.figures().joined, 5u) << "their loops run as one";
  EXPECT_EQ(one.executor.figures().joined, 0u);
}

class WholeGraphOnCuda : public testing::TestWithParam<bool> {
 protected:
  void SetUp() override {
    cuda_ = on_device::device_named("cuda", GetParam());
    KNEAD_NEEDS(cuda_);
  }
  std::unique_ptr<Executor> cuda_;
};

// Each round of the loop adds a few roundings of a coordinate and takes most of those before it back, so that they add up to far less than 90 times
// as much; what is left is below what ends the loop (threshold 1e-4).
TEST_P(WholeGraphOnCuda, GivesTheHostsShapeAndTheSameBytesAgain) {
  constexpr double kRounding = 5e-5;  // of the diagonal
  const auto serial = make_serial_executor();
  for (const auto& [graph, frames] : {std::pair{kPress, std::vector<int>{1, 3, 5}}, {kDeep, std::vector<int>{1, 2}}}) {
    OnExecutor here(*serial, graph), there(*cuda_, graph), again(*cuda_, graph);
    for (const int frame : frames) {
      const Results expected = here.get(frame), first = there.get(frame);
      expect_same(first, again.get(frame), "frame " + std::to_string(frame) + " again");
      ASSERT_EQ(first.surface.size(), expected.surface.size());
      double worst = 0;
      for (size_t i = 0; i < first.surface.size(); ++i) worst = std::max(worst, static_cast<double>(length(first.surface[i] - expected.surface[i])));
      EXPECT_LT(worst / expected.diagonal, kRounding) << "frame " << frame;
      EXPECT_NEAR(first.iterations, expected.iterations, 2) << "frame " << frame;
    }
  }
}

TEST_P(WholeGraphOnCuda, TransfersAllocatesAndLaunchesNothingInTheLoop) {
  DeviceFigures few, many;
  for (const int rounds : {5, 60}) {
    const auto device = on_device::device_named("cuda", GetParam());
    OnExecutor there(*device, kDeep, {{"press.max_iterations", rounds}, {"press.min_iterations", 1000}, {"press.threshold", 0.0}});
    EXPECT_EQ(there.get(1).iterations, rounds);
    (rounds == 5 ? few : many) = on_device::figures_of(*device);
  }
  EXPECT_EQ(few.allocations, many.allocations);
  EXPECT_EQ(few.copies, many.copies);
  EXPECT_EQ(few.launches, many.launches);
  EXPECT_EQ(many.loops, 1u);
}

// Across the rounds at which the host looks whether the loop was cancelled.
TEST_P(WholeGraphOnCuda, ManyRoundsGiveTheBitsOfBatches) {
  const auto batches = on_device::device_named("cuda", false);
  const std::vector<std::pair<std::string, Literal>> long_loop = {
      {"press.max_iterations", 1100}, {"press.min_iterations", 2000}, {"press.threshold", 0.0}};
  OnExecutor here(*cuda_, kDeep, long_loop), there(*batches, kDeep, long_loop);
  const Results is = here.get(1);
  EXPECT_EQ(is.iterations, 1100);
  expect_same(is, there.get(1), "batches");
}

TEST_P(WholeGraphOnCuda, TheHostStartsALoopOnce) {
  OnExecutor(*cuda_, kDeep, {{"press.max_iterations", 60}, {"press.min_iterations", 1000}, {"press.threshold", 0.0}}).get(1);
  const uint64_t launches = on_device::figures_of(*cuda_).loop_launches;
  if (!GetParam()) {
    EXPECT_GE(launches, 59u);
    return;
  }
  if (launches != 1 && !on_device::cuda_required()) GTEST_SKIP() << "CUDA refuses a graph that repeats by itself: a driver before 12.4?";
  EXPECT_EQ(launches, 1u) << "CUDA refuses a graph that repeats by itself: a driver before 12.4?";
}

TEST_P(WholeGraphOnCuda, FramesSideBySideAreThoseOneByOne) {
  OnExecutor single(*cuda_, kPress), batch(*cuda_, kPress);
  expect_same_side_by_side(batch, single);
  EXPECT_EQ(on_device::figures_of(*cuda_).joined, 5u) << "their loops run as one";
}

// Two evaluators share the device; each has its own threads.
TEST_P(WholeGraphOnCuda, TwoEvaluatorsAtOnceGiveTheSameBytes) {
  const Results press = OnExecutor(*cuda_, kPress).get(5), deep = OnExecutor(*cuda_, kDeep).get(2);
  std::vector<Results> is(4);
  std::vector<std::thread> threads;
  for (size_t t = 0; t < is.size(); ++t)
    threads.emplace_back([&, t] { is[t] = t % 2 ? OnExecutor(*cuda_, kDeep).get(2) : OnExecutor(*cuda_, kPress).get(5); });
  for (std::thread& thread : threads) thread.join();
  for (size_t t = 0; t < is.size(); ++t) expect_same(is[t], t % 2 ? deep : press, "thread " + std::to_string(t));
}

// All memory is taken, down to the smallest piece.
TEST_P(WholeGraphOnCuda, AFrameWithoutMemoryIsAnErrorAndTheNextOneIsMade) {
  const Results expected = OnExecutor(*cuda_, kPress).get(5);
  {
    std::vector<Buffer<std::byte>> taken;
    for (size_t piece = size_t{1} << 30; piece >= 512; piece /= 2) try {
        while (true) taken.emplace_back(piece, cuda_->memory());
      } catch (const Error& error) {
        ASSERT_EQ(error.code(), ErrorCode::kMemory) << error.what();
      }
    OnExecutor starved(*cuda_, kPress);
    const FrameResult result = starved.evaluator.evaluate(5, {"press.surface"});
    ASSERT_TRUE(result.error);
    EXPECT_EQ(result.error->code(), ErrorCode::kMemory) << result.error->what();
  }
  expect_same(OnExecutor(*cuda_, kPress).get(5), expected, "with memory again");
}

TEST_P(WholeGraphOnCuda, NothingTouchedMeansNothingChanged) {
  OnExecutor there(*cuda_, kPress);
  const Surface rest = there.evaluator.get<Surface>("body", 1);
  EXPECT_TRUE(same_bits({rest.points.host().begin(), rest.points.host().end()}, there.get(1).surface));
}

INSTANTIATE_TEST_SUITE_P(Loops, WholeGraphOnCuda, testing::Values(true, false),
                         [](const auto& info) { return std::string(info.param ? "InOneGraph" : "InBatches"); });

}  // namespace whole_graph_device_test
}  // namespace knead
