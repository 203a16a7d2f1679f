// Loops that stay on their device: the same end and the same numbers as on the host, and nothing transferred, allocated or asked in between.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/graph/on_fake.h"

namespace knead {
namespace device_loop_test {

using fake_device::FakeDevice;
using testing::HasSubstr;
using toys::OnFake;

struct Ran {
  std::vector<double> values;
  std::string ended, error;
  double iterations = 0, unrest = 0;
  DeviceFigures figures;
  uint64_t transfers = 0;
  int rounds = 0;  // that the device has run, needed or not
  friend bool operator==(const Ran& a, const Ran& b) {
    return a.values == b.values && a.ended == b.ended && a.iterations == b.iterations && a.unrest == b.unrest && a.error == b.error;
  }
};

Ran run(const std::string& nodes, Executor* executor) {
  EvaluatorOptions options;
  options.executor = executor;
  Evaluator evaluator(compile(read_graph_text("knead: 1\nnodes:\n" + nodes, "t.yaml"), toys::options()), options);
  const FrameResult result = evaluator.evaluate(1, {"l", "l.report"});
  Ran ran;
  ran.transfers = evaluator.figures().moved.count;
  if (result.error) {
    ran.error = result.error->what();
    return ran;
  }
  const auto values = result.values.at("l").as<toys::Numbers>().values;
  ran.values.assign(values.host().begin(), values.host().end());
  const Report& report = result.values.at("l.report").as<Report>();
  ran.ended = report.word("ended");
  ran.iterations = report.number("iterations");
  ran.unrest = report.number("unrest");
  return ran;
}
Ran run_on_fake(const std::string& nodes, int batch = 0) {
  FakeDevice fake(size_t{1} << 26, batch);
  Ran ran = run(nodes, &fake.executor);
  ran.figures = fake.executor.figures();
  ran.rounds = fake.backend.rounds_run;
  return ran;
}
Ran run_on_host(const std::string& nodes) {
  const auto serial = make_serial_executor();
  return run(nodes, serial.get());
}

// x goes from 0 to 8 by halves, through two nodes that both run on any device.
std::string relaxing(const std::string& parameters,
                     const std::string& body = "r: {type: relax, x: state.x, target: t}, d: {type: device_add, in: r, offset: 0}") {
  return "  v: {type: value, value: 0, size: 5}\n  t: {type: value, value: 8}\n  l: {type: iterate, " + parameters + ", state: {x: v}, body: {" +
         body + "}, next: {x: d}}";
}

TEST(DeviceLoop, EndsAsOnTheHost) {
  for (const char* parameters :
       {"threshold: 0.1", "threshold: 0, max_iterations: 9", "threshold: 100", "threshold: 100, min_iterations: 4", "max_iterations: 0",
        "max_iterations: 1", "max_iterations: 2, threshold: 0", "threshold: 0, min_iterations: 700, max_iterations: 700"})
    for (const int batch : {0, 1, 4}) {
      const Ran here = run_on_host(relaxing(parameters)), there = run_on_fake(relaxing(parameters), batch);
      EXPECT_TRUE(here.error.empty()) << here.error;
      EXPECT_EQ(here, there) << parameters << ", batches of " << batch << ": " << there.error << there.iterations;
    }
}

TEST(DeviceLoop, TransfersAllocatesAndLaunchesNothingFromRoundToRound) {
  const Ran few = run_on_fake(relaxing("threshold: 0, min_iterations: 1000, max_iterations: 10"));
  const Ran many = run_on_fake(relaxing("threshold: 0, min_iterations: 1000, max_iterations: 400"));
  EXPECT_EQ(many.iterations, 400);
  EXPECT_EQ(many.rounds, 399);  // the first is run from the host
  EXPECT_EQ(few.figures.allocations, many.figures.allocations);
  EXPECT_EQ(few.figures.copies, many.figures.copies);
  EXPECT_EQ(few.figures.launches, many.figures.launches);
  EXPECT_EQ(few.figures.recorded, many.figures.recorded);
  EXPECT_EQ(many.figures.loops, 1u);
  EXPECT_EQ(many.transfers, 3u);           // v and t there, x back
  EXPECT_EQ(many.figures.copies, 3u + 1);  // and how the loop ended
}

TEST(DeviceLoop, GivesBackAllMemory) {
  FakeDevice fake(size_t{1} << 26);
  run(relaxing("threshold: 0, max_iterations: 20"), &fake.executor);
  EXPECT_EQ(fake.executor.figures().bytes, 0u);
  EXPECT_GT(fake.executor.figures().most_bytes, 0u);
}

TEST(DeviceLoop, RoundsAfterTheEndComeToNothing) {
  const Ran stops = run_on_fake(relaxing("threshold: 0.1")), overruns = run_on_fake(relaxing("threshold: 0.1"), 16);
  EXPECT_EQ(stops, overruns);
  EXPECT_EQ(stops.rounds, 6);
  EXPECT_EQ(overruns.rounds, 16);
  EXPECT_EQ(stops.figures.loop_launches, 1u) << "it goes on by itself";
  EXPECT_EQ(overruns.figures.loop_launches, 16u);
}

// What a node of the loop does on the host is caught, and the loop is run from there: slower, and right.
TEST(DeviceLoop, ANodeThatLooksFromTheHostTakesTheLoopOffTheDevice) {
  const std::string body = "r: {type: relax, x: state.x, target: t}, p: {type: peek, in: r}, d: {type: device_add, in: p, offset: 0}";
  const auto peeking = [&](int rounds) { return relaxing("threshold: 0, min_iterations: 1000, max_iterations: " + std::to_string(rounds), body); };
  const Ran few = run_on_fake(peeking(10)), many = run_on_fake(peeking(30));
  EXPECT_EQ(many, run_on_host(peeking(30)));
  EXPECT_EQ(many.figures.loops, 0u);
  EXPECT_EQ(many.transfers - few.transfers, 2 * 20u);  // what the node sees, and how far from rest the state is
  EXPECT_GT(many.figures.launches, few.figures.launches);
}

TEST(DeviceLoop, ALoopInALoopIsRunFromTheHostAndItselfStaysOnTheDevice) {
  const std::string nodes =
      "  v: {type: value, value: 0}\n  t: {type: value, value: 8}\n  l: {type: iterate, max_iterations: 3, threshold: 0, state: {x: v}, body: {i: "
      "{type: "
      "iterate, max_iterations: 5, threshold: 0, state: {y: state.x}, body: {r: {type: relax, x: state.y, target: t}}, next: {y: r}}}, next: {x: "
      "i.y}}";
  const Ran there = run_on_fake(nodes);
  EXPECT_EQ(there, run_on_host(nodes));
  EXPECT_EQ(there.figures.loops, 3u);
}

TEST(DeviceLoop, StatesThatChangePlacesAreRunFromTheHost) {
  const std::string nodes =
      "  v: {type: value, value: 0}\n  w: {type: value, value: 1}\n  l: {type: iterate, threshold: 0, max_iterations: 7, state: {a: v, b: w}, body: "
      "{s: "
      "{type: device_add, in: state.a}}, next: {a: state.b, b: s}}";
  EXPECT_EQ(run_on_fake(nodes), run_on_host(nodes));
}

TEST(DeviceLoop, ABrokenStateIsTheSameErrorInTheSameRound) {
  const std::string nodes = "  v: {type: value, value: 0}\n  l: {type: iterate, state: {x: v}, body: {b: {type: break, x: state.x}}, next: {x: b}}";
  const Ran there = run_on_fake(nodes);
  EXPECT_THAT(there.error, HasSubstr("state 'x' is no longer a number after 6 rounds"));
  EXPECT_EQ(there, run_on_host(nodes));
  EXPECT_EQ(there, run_on_fake(nodes, 4));
}

TEST(DeviceLoop, LeavesWhatGoesInAsItWas) {
  FakeDevice fake(size_t{1} << 26);
  EvaluatorOptions options;
  options.executor = &fake.executor;
  const std::string more = "\n  a: {type: device_add, in: v}\n  b: {type: add, a: a, b: l}";
  Evaluator evaluator(compile(read_graph_text("knead: 1\nnodes:\n" + relaxing("threshold: 0.1") + more, "t.yaml"), toys::options()), options);
  EXPECT_NEAR(toys::first(evaluator.get<toys::Numbers>("b", 1)), 1 + 8 - 8.0 / 128, 1e-12);
  EXPECT_EQ(toys::first(evaluator.get<toys::Numbers>("a", 1)), 1);
}

// Frames side by side bring their loops to the device together; each ends when it is at rest, with the numbers that it has alone.
TEST(DeviceLoop, LoopsOfSeveralFramesRunAsOne) {
  const std::string nodes =
      "  v: {type: frame, scale: 16}\n  t: {type: value, value: 8}\n  l: {type: iterate, threshold: 0.1, state: {x: v}, body: {r: {type: relax, x: "
      "state.x, "
      "target: t}}, next: {x: r}}";
  const auto plan = compile(read_graph_text("knead: 1\nnodes:\n" + nodes, "t.yaml"), toys::options());
  for (const int batch : {0, 4}) {
    FakeDevice fake(size_t{1} << 26, batch);
    EvaluatorOptions options;
    options.executor = &fake.executor;
    Evaluator together(plan, options);
    const auto serial = make_serial_executor();
    options.executor = serial.get();
    Evaluator alone(plan, options);
    std::vector<int> frames;
    for (int frame = 1; frame <= 50; ++frame) frames.push_back(frame);  // more than run at once
    size_t done = 0;
    together.evaluate_frames(frames, {"l", "l.report"}, false, [&](const FrameResult& result) {
      ASSERT_FALSE(result.error) << result.error->what();
      EXPECT_EQ(toys::first(result.values.at("l").as<toys::Numbers>()), toys::first(alone.get<toys::Numbers>("l", result.frame)));
      EXPECT_EQ(result.values.at("l.report").as<Report>().number("iterations"), alone.get<Report>("l.report", result.frame).number("iterations"));
      ++done;
    });
    EXPECT_EQ(done, 50u);
    EXPECT_GE(fake.executor.figures().joined, 32u);
    EXPECT_LT(fake.backend.rounds_run, 50 * 6);
  }
}

TEST(DeviceLoop, LoopsThatAreNotAlikeAreRunOneAfterTheOther) {
  OnFake on(
      "  v: {type: grow}\n  t: {type: value, value: 8}\n"
      "  l: {type: iterate, threshold: 0.1, state: {x: v}, body: {r: {type: relax, x: state.x, target: t}}, next: {x: r}}");
  size_t done = 0;
  on.evaluator.evaluate_frames({1, 2, 3, 4}, {"l"}, false, [&](const FrameResult& result) {
    ASSERT_FALSE(result.error) << result.error->what();
    EXPECT_EQ(result.values.at("l").as<toys::Numbers>().values.size(), static_cast<size_t>((result.frame + 1) / 2));
    EXPECT_NEAR(toys::first(result.values.at("l").as<toys::Numbers>()), 8, 0.2);
    ++done;
  });
  EXPECT_EQ(done, 4u);
  EXPECT_EQ(on.fake.executor.figures().joined, 4u) << "in two pairs";
}

TEST(DeviceLoop, AFrameThatFailsDoesNotHoldUpTheOthers) {
  OnFake on(
      "  f: {type: frame}\n  v: {type: failing, in: f, when: 3}\n  t: {type: value, value: 8}\n"
      "  l: {type: iterate, threshold: 0.1, state: {x: v}, body: {r: {type: relax, x: state.x, target: t}}, next: {x: r}}");
  int good = 0, bad = 0;
  on.evaluator.evaluate_frames({1, 2, 3, 4, 5}, {"l"}, false, [&](const FrameResult& result) { ++(result.error ? bad : good); });
  EXPECT_EQ(good, 4);
  EXPECT_EQ(bad, 1);
}

// Its loops do not wait for those of the other frames, which wait for it to return.
TEST(DeviceLoop, WhatTakesAFrameMayEvaluateOnTheSameDevice) {
  const std::string nodes =
      "  v: {type: frame}\n  t: {type: value, value: 8}\n  l: {type: iterate, threshold: 0.1, state: {x: v}, body: {r: {type: relax, x: state.x, "
      "target: t}}, next: {x: r}}";
  const auto plan = compile(read_graph_text("knead: 1\nnodes:\n" + nodes, "t.yaml"), toys::options());
  FakeDevice fake;
  const auto serial = make_serial_executor();  // nodes run on the thread that asks for them
  EvaluatorOptions options;
  options.executor = &fake.executor;
  options.host_executor = serial.get();
  Evaluator frames(plan, options), other(plan, options);
  int same = 0;
  frames.evaluate_frames({1, 2, 3, 4}, {"l"}, false, [&](const FrameResult& result) {
    same += toys::first(result.values.at("l").as<toys::Numbers>()) == toys::first(other.get<toys::Numbers>("l", result.frame));
  });
  EXPECT_EQ(same, 4);
}

TEST(DeviceLoop, IsCancelledBetweenItsPartsOnTheDevice) {
  FakeDevice fake(size_t{1} << 26);
  EvaluatorOptions options;
  options.executor = &fake.executor;
  int asked = 0;
  options.cancelled = [&] { return ++asked > 20; };
  Evaluator evaluator(
      compile(read_graph_text("knead: 1\nnodes:\n" + relaxing("threshold: 0, min_iterations: 1000000, max_iterations: 1000000"), "t.yaml"),
              toys::options()),
      options);
  EXPECT_EQ(evaluator.evaluate(1, {"l"}).error->code(), ErrorCode::kCancelled);
  EXPECT_LT(fake.backend.rounds_run, 20000);
}

}  // namespace device_loop_test
}  // namespace knead
