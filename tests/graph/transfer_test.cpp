// Only the scheduler moves data, once per direction, and counts it: shown on a device that is host memory under another tag.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "io/graph_file.h"
#include "tests/graph/toys.h"

namespace knead {
namespace transfer_test {

using toys::FakeExecutor;

std::shared_ptr<const Plan> plan_of(const std::string& nodes) {
  return compile(read_graph_text("knead: 1\nnodes:\n" + nodes, "t.yaml"), toys::options());
}

struct OnFake {
  explicit OnFake(const std::string& nodes) : evaluator(plan_of(nodes), options()) {}
  EvaluatorOptions options() {
    EvaluatorOptions made;
    made.executor = &fake;
    return made;
  }
  double get(const std::string& output, int frame = 1) { return toys::first(evaluator.get<toys::Numbers>(output, frame)); }
  FakeExecutor fake;
  Evaluator evaluator;
};

TEST(Transfer, BringsInputsToTheDeviceAndResultsBack) {
  OnFake on("  v: {type: value, value: 3, size: 4}\n  d: {type: device_add, in: v}\n  a: {type: add, a: d}");
  EXPECT_EQ(on.get("a"), 4);
  EXPECT_EQ(on.evaluator.figures().transfers, 2u);
  EXPECT_EQ(on.evaluator.figures().transferred_bytes, 2 * 4 * sizeof(double));
  EXPECT_EQ(on.fake.to_here, 1);
  EXPECT_EQ(on.fake.to_host, 1);
  EXPECT_GE(on.fake.synchronised, 2);
}

TEST(Transfer, LeavesOnTheDeviceWhatIsReadThere) {
  OnFake on(
      "  v: {type: value}\n  d: {type: device_add, in: v}\n  e: {type: device_add, in: d}\n  f: {type: device_add, in: e}\n  a: {type: add, a: f}");
  EXPECT_EQ(on.get("a"), 4);
  EXPECT_EQ(on.evaluator.figures().transfers, 2u);
}

TEST(Transfer, MovesAValueOnceForAllItsReaders) {
  OnFake on(R"(
  v: {type: value}
  d: {type: device_add, in: v}
  e: {type: device_add, in: v}
  f: {type: device_add, in: d}
  x: {type: add, a: f}
  y: {type: add, a: f, b: e}
)");
  EXPECT_EQ(on.get("x"), 3);
  EXPECT_EQ(on.get("y"), 5);
  EXPECT_EQ(on.fake.to_here, 1);  // v
  EXPECT_EQ(on.fake.to_host, 2);  // f, e
}

TEST(Transfer, MovesWhatFramesShareOnce) {
  OnFake on(
      "  v: {type: value}\n  d: {type: device_add, in: v}\n  f: {type: frame}\n  a: {type: add, a: d, b: f}\n  b: {type: device_add, in: v, offset: "
      "2}");
  int frames = 0;
  on.evaluator.evaluate_frames({1, 2, 3, 4, 5, 6, 7, 8}, {"a", "b"}, false, [&](const FrameResult& result) {
    ++frames;
    EXPECT_EQ(toys::first(result.values.at("a").as<toys::Numbers>()), 2 + result.frame);
  });
  EXPECT_EQ(frames, 8);
  EXPECT_EQ(on.fake.to_here, 1);
  EXPECT_EQ(on.fake.to_host, 2);
  EXPECT_EQ(on.evaluator.figures().transfers, 3u);
}

TEST(Transfer, HandsOutputsOutOnTheHost) {
  OnFake on("  v: {type: value}\n  d: {type: device_add, in: v}");
  EXPECT_EQ(on.get("d"), 2);
  EXPECT_EQ(on.get("d"), 2);
  EXPECT_EQ(on.evaluator.figures().transfers, 2u);
}

TEST(Transfer, MovesNothingInsideALoopOnTheDevice) {
  OnFake on(R"(
  v: {type: value, value: 0}
  t: {type: value, value: 8}
  l: {type: iterate, max_iterations: 100, threshold: 0, state: {x: v}, body: {r: {type: relax, x: state.x, target: t}, d: {type: device_add, in: r, offset: 0}}, next: {x: d}}
)");
  EXPECT_NEAR(on.get("l"), 8, 1e-12);
  EXPECT_EQ(on.evaluator.figures().transfers, 3u);  // v and t there, x back
}

TEST(Transfer, ALoopWithAHostNodeRunsOnTheHost) {
  OnFake on(
      "  v: {type: value, value: 0}\n  l: {type: iterate, max_iterations: 3, state: {x: v}, body: {d: {type: device_add, in: state.x}, a: {type: "
      "add, a: d}}, next: {x: a}}");
  EXPECT_EQ(on.get("l"), 3);
  EXPECT_EQ(on.evaluator.figures().transfers, 0u);
}

TEST(Transfer, ResultsOfDifferentDevicesAreKeptApart) {
  FakeExecutor fake;  // first: it owns the memory of values in the cache
  const auto cache = std::make_shared<Cache>();
  const auto plan = plan_of("  v: {type: value}\n  d: {type: device_add, in: v}");
  EvaluatorOptions there, here;
  there.cache = here.cache = cache;
  there.executor = &fake;
  Evaluator on_fake(plan, there), on_host(plan, here);
  EXPECT_EQ(toys::first(on_fake.get<toys::Numbers>("d", 1)), 2);
  EXPECT_EQ(toys::first(on_host.get<toys::Numbers>("d", 1)), 2);
  EXPECT_EQ(on_host.figures().evaluations.at("device_add"), 1u);
  EXPECT_EQ(on_host.figures().evaluations.count("value"), 0u);
}

}  // namespace transfer_test
}  // namespace knead
