// The evaluator moves values between nodes, once per direction, and counts what moves, by itself and by nodes: shown on a device that is host memory
// under another tag.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/graph/on_fake.h"

namespace knead {
namespace transfer_test {

using fake_device::FakeDevice;
using testing::AllOf;
using testing::HasSubstr;
using toys::OnFake;
using toys::plan_of;

TEST(Transfer, BringsInputsToTheDeviceAndResultsBack) {
  OnFake on("  v: {type: value, value: 3, size: 4}\n  d: {type: device_add, in: v}\n  a: {type: add, a: d}");
  EXPECT_EQ(on.get("a"), 4);
  EXPECT_EQ(on.evaluator.figures().moved.count, 2u);
  EXPECT_EQ(on.evaluator.figures().moved.bytes, 2 * 4 * sizeof(double));
  EXPECT_EQ(on.fake.executor.figures().copies, 2u);
  EXPECT_EQ(on.fake.executor.figures().copied_bytes, 2 * 4 * sizeof(double));
}

// Holds what evaluator.h says of transfers: no byte reaches the device or comes from it that the figures do not have.
TEST(Transfer, CountsWhatNodesCopyBesideIts) {
  OnFake on("  v: {type: value, value: 3, size: 4}\n  d: {type: device_add, in: v}\n  p: {type: device_peek, in: d}\n  a: {type: add, a: p}");
  EXPECT_EQ(on.get("a"), 4);
  const EvaluatorFigures figures = on.evaluator.figures();
  EXPECT_EQ(figures.moved.count, 2u);
  EXPECT_EQ(figures.by_nodes.count, 1u);
  EXPECT_EQ(figures.by_nodes.bytes, sizeof(double));
  EXPECT_EQ(figures.moved.count + figures.by_nodes.count, on.fake.backend.transfers.count);
  EXPECT_EQ(figures.moved.bytes + figures.by_nodes.bytes, on.fake.backend.transfers.bytes);
}

TEST(Transfer, CountsFromWhenTheEvaluatorWasMade) {
  FakeDevice fake;
  const double one = 1;
  Buffer<double> there(1, fake.executor.memory());
  fake.executor.copy(&one, Device{}, there.data_for_write(), fake.executor.device(), sizeof one);
  EvaluatorOptions options;
  options.executor = &fake.executor;
  Evaluator evaluator(plan_of("  v: {type: value}\n  d: {type: device_add, in: v}"), options);
  EXPECT_EQ(evaluator.figures().by_nodes.count, 0u);
  EXPECT_EQ(toys::first(evaluator.get<toys::Numbers>("d", 1)), 2);
  EXPECT_EQ(evaluator.figures().moved.count, 2u);
  EXPECT_EQ(evaluator.figures().by_nodes.count, 0u);
}

TEST(Transfer, LeavesOnTheDeviceWhatIsReadThere) {
  OnFake on(
      "  v: {type: value}\n  d: {type: device_add, in: v}\n  e: {type: device_add, in: d}\n  f: {type: device_add, in: e}\n  a: {type: add, a: f}");
  EXPECT_EQ(on.get("a"), 4);
  EXPECT_EQ(on.evaluator.figures().moved.count, 2u);
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
  EXPECT_EQ(on.evaluator.figures().moved.count, 3u);  // v there; f and e back
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
  EXPECT_EQ(on.evaluator.figures().moved.count, 3u);
}

TEST(Transfer, HandsOutputsOutOnTheHost) {
  OnFake on("  v: {type: value}\n  d: {type: device_add, in: v}");
  EXPECT_EQ(on.get("d"), 2);
  EXPECT_EQ(on.get("d"), 2);
  EXPECT_EQ(on.evaluator.figures().moved.count, 2u);
}

TEST(Transfer, ALoopWithAHostNodeRunsOnTheHost) {
  OnFake on(
      "  v: {type: value, value: 0}\n  l: {type: iterate, max_iterations: 3, state: {x: v}, body: {d: {type: device_add, in: state.x}, a: {type: "
      "add, a: d}}, next: {x: a}}");
  EXPECT_EQ(on.get("l"), 3);
  EXPECT_EQ(on.evaluator.figures().moved.count, 0u);
}

// A value that is new in every frame but holds the same storage: only what is new is moved.
TEST(Transfer, MovesStorageThatValuesShareOnce) {
  OnFake on("  v: {type: value, value: 3, size: 1000}\n  f: {type: frame}\n  p: {type: placed, in: v, at: f}\n  d: {type: device_add, in: p}");
  for (int frame = 1; frame <= 5; ++frame) EXPECT_EQ(on.get("d", frame), 4);
  EXPECT_EQ(on.evaluator.figures().moved.count, 1u + 5);  // v; every frame's d back
}

TEST(Transfer, TooLittleMemoryIsAnErrorThatNamesTheSizesAndTheNextFrameIsMade) {
  OnFake on("  v: {type: value, size: 4000}\n  w: {type: value, size: 10}\n  d: {type: device_add, in: v}\n  e: {type: device_add, in: w}", 40000);
  const FrameResult starved = on.evaluator.evaluate(1, {"d"});
  ASSERT_TRUE(starved.error);
  EXPECT_EQ(starved.error->code(), ErrorCode::kMemory);
  EXPECT_THAT(starved.error->what(),
              AllOf(HasSubstr("out of memory on fake:0 (host memory): 32064 bytes were asked for"), HasSubstr("of 40000 bytes are free")));
  EXPECT_EQ(on.get("e"), 2);
}

TEST(Transfer, TheFakeDeviceTellsHostMemoryInAKernelFromItsOwn) {
#if defined(__SANITIZE_ADDRESS__)
  GTEST_SKIP() << "not looked for under AddressSanitizer";
#endif
  FakeDevice fake;
  double host = 1;
  Buffer<double> there(1, fake.executor.memory());
  EXPECT_THROW(fake.executor.launch(toys::AddOffset{&host, there.data_for_write(), 1}, 1), Error);
  EXPECT_THROW(there.host(), Error);
}

TEST(TransferDeathTest, TheFakeDeviceEndsAHostThatReadsItsMemory) {
  testing::FLAGS_gtest_death_test_style = "threadsafe";
  FakeDevice fake;
  const Buffer<double> there(1, fake.executor.memory());
  const double* address = there.view(fake.executor.device()).data();
  EXPECT_DEATH(
      {
        volatile double read = *address;
        (void)read;
      },
      "");
}

TEST(Transfer, ResultsOfDifferentDevicesAreKeptApart) {
  FakeDevice fake;  // first: it owns the memory of values in the cache
  const auto cache = std::make_shared<Cache>();
  const auto plan = plan_of("  v: {type: value}\n  d: {type: device_add, in: v}");
  EvaluatorOptions there, here;
  there.cache = here.cache = cache;
  there.executor = &fake.executor;
  Evaluator on_fake(plan, there), on_host(plan, here);
  EXPECT_EQ(toys::first(on_fake.get<toys::Numbers>("d", 1)), 2);
  EXPECT_EQ(toys::first(on_host.get<toys::Numbers>("d", 1)), 2);
  EXPECT_EQ(on_host.figures().evaluations.at("device_add"), 1u);
  EXPECT_EQ(on_host.figures().evaluations.count("value"), 0u);
}

}  // namespace transfer_test
}  // namespace knead
