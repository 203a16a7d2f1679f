// What is computed, when, how often and by whom.
#include "graph/evaluator.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "io/graph_file.h"
#include "tests/graph/toys.h"

namespace knead {
namespace evaluator_test {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Pair;
using testing::UnorderedElementsAre;

std::shared_ptr<const Plan> plan_of(const std::string& nodes, const std::vector<std::pair<std::string, Literal>>& overrides = {}) {
  CompileOptions options = toys::options();
  options.overrides = overrides;
  return compile(read_graph_text("knead: 1\nnodes:\n" + nodes, "t.yaml"), options);
}

class EvaluatorTest : public testing::Test {
 protected:
  void SetUp() override { toys::begin_anew(); }
};

double value_of(const FrameResult& result, const std::string& output) {
  return toys::first(result.values.at(output).as<toys::Numbers>());
}

const char* const kChain = R"(
  a: {type: value, value: 1}
  b: {type: count, in: a, label: b}
  c: {type: add, a: b, offset: 1}
  d: {type: count, in: c, label: d}
  f: {type: frame}
  e: {type: add, a: d, b: f}
  g: {type: count, in: e, label: g}
  w: {type: write, in: g}
)";

TEST_F(EvaluatorTest, ComputesWhatIsAskedForAndNothingElse) {
  Evaluator evaluator(plan_of(kChain));
  EXPECT_EQ(toys::first(evaluator.get<toys::Numbers>("c", 7)), 2);
  EXPECT_EQ(toys::runs_of("b"), 1);
  EXPECT_EQ(toys::runs_of("d"), 0);
  EXPECT_EQ(toys::first(evaluator.get<toys::Numbers>("g", 7)), 9);
  EXPECT_TRUE(toys::world().written.empty());
}

TEST_F(EvaluatorTest, AnEmptyPlanAndNoOutputsAreFine) {
  Evaluator evaluator(plan_of("  {}"));
  EXPECT_FALSE(evaluator.evaluate(1, {}, true).error);
  int frames = 0;
  evaluator.evaluate_frames({1, 2, 3}, {}, true, [&](const FrameResult& result) { frames += !result.error; });
  evaluator.evaluate_frames({}, {}, true, [&](const FrameResult&) { ++frames; });
  EXPECT_EQ(frames, 3);
}

TEST_F(EvaluatorTest, AnUnknownOutputIsTheCallersErrorWithTheNearestName) {
  Evaluator evaluator(plan_of(kChain));
  try {
    evaluator.evaluate(1, {"c.sam"});
    FAIL();
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("did you mean 'c.sum'?"));
  }
}

TEST_F(EvaluatorTest, ComputesNothingAgainWhenNothingChanged) {
  Evaluator evaluator(plan_of(kChain));
  evaluator.evaluate(1, {"g"});
  const EvaluatorFigures before = evaluator.figures();
  const FrameResult again = evaluator.evaluate(1, {"g"});
  EXPECT_EQ(evaluator.figures().evaluations, before.evaluations);
  EXPECT_EQ(evaluator.figures().cache.misses, before.cache.misses);
  EXPECT_EQ(evaluator.figures().cache.hits, before.cache.hits + 1);
  EXPECT_EQ(value_of(again, "g"), 3);
  ASSERT_EQ(again.times.size(), 1u);
  EXPECT_TRUE(again.times[0].cached);
}

TEST_F(EvaluatorTest, AnEditRecomputesOnlyWhatItReaches) {
  EvaluatorOptions options;
  options.cache = std::make_shared<Cache>();
  Evaluator before(plan_of(kChain), options);
  before.evaluate(1, {"g"});
  Evaluator late(plan_of(kChain, {{"g.label", "g2"}}), options);
  EXPECT_EQ(value_of(late.evaluate(1, {"g"}), "g"), 3);
  EXPECT_THAT(late.figures().evaluations, ElementsAre(Pair("count", 1)));
  Evaluator middle(plan_of(kChain, {{"c.offset", 5}}), options);
  EXPECT_EQ(value_of(middle.evaluate(1, {"g"}), "g"), 7);
  EXPECT_THAT(middle.figures().evaluations, ElementsAre(Pair("add", 2), Pair("count", 2)));  // c, d, e, g
  EXPECT_EQ(toys::runs_of("b"), 1);
  Evaluator back(plan_of(kChain), options);
  back.evaluate(1, {"g"});
  EXPECT_THAT(back.figures().evaluations, IsEmpty());
}

TEST_F(EvaluatorTest, NamesDoNotMatterToTheCache) {
  EvaluatorOptions options;
  options.cache = std::make_shared<Cache>();
  Evaluator(plan_of("  a: {type: value, value: 4}\n  b: {type: add, a: a}"), options).evaluate(1, {"b"});
  Evaluator renamed(plan_of("  x: {type: value, value: 4}\n  y: {type: add, a: x}"), options);
  EXPECT_EQ(value_of(renamed.evaluate(1, {"y"}), "y"), 4);
  EXPECT_THAT(renamed.figures().evaluations, IsEmpty());
}

TEST_F(EvaluatorTest, FollowsTheContentsOfFiles) {
  toys::world().files = {{"a", 1}, {"s1", 10}, {"s2", 20}};
  Evaluator evaluator(plan_of("  a: {type: file, path: a}\n  s: {type: file, path: s#}\n  sum: {type: add, a: a, b: s}"));
  EXPECT_EQ(toys::first(evaluator.get<toys::Numbers>("sum", 1)), 11);
  EXPECT_EQ(toys::first(evaluator.get<toys::Numbers>("sum", 2)), 21);
  toys::world().files["a"] = 5;
  EXPECT_EQ(toys::first(evaluator.get<toys::Numbers>("sum", 1)), 15);
  const FrameResult missing = evaluator.evaluate(3, {"sum"});
  ASSERT_TRUE(missing.error);
  EXPECT_EQ(missing.error->code(), ErrorCode::kFile);
  EXPECT_THAT(missing.error->what(), HasSubstr("s3, node 's': there is no such file"));
}

TEST_F(EvaluatorTest, GivesTheSameValuesInAnyOrderAndSideBySide) {
  std::vector<int> frames(60);
  for (int i = 0; i < 60; ++i) frames[static_cast<size_t>(i)] = i - 20;
  std::shuffle(frames.begin(), frames.end(), std::mt19937(3));
  const auto serial = make_serial_executor(), three = make_cpu_executor(3);
  for (Executor* executor : {serial.get(), three.get()}) {
    EvaluatorOptions options;
    options.executor = executor;
    Evaluator evaluator(plan_of(kChain), options);
    std::map<int, double> values;
    evaluator.evaluate_frames(frames, {"g"}, true, [&](FrameResult result) {
      ASSERT_FALSE(result.error) << result.error->what();
      EXPECT_TRUE(values.emplace(result.frame, value_of(result, "g")).second);
    });
    EXPECT_EQ(values.size(), 60u);
    for (const auto& [frame, value] : values) EXPECT_EQ(value, 2 + frame);
    EXPECT_EQ(evaluator.figures().evaluations.at("write"), 60u);
  }
  EXPECT_EQ(toys::runs_of("b"), 2);  // once per evaluator
  EXPECT_EQ(toys::world().written.size(), 120u);
}

TEST_F(EvaluatorTest, BeginsFramesInTheOrderThatWasAskedFor) {
  const auto serial = make_serial_executor();
  EvaluatorOptions options;
  options.executor = serial.get();
  Evaluator evaluator(plan_of(kChain), options);
  std::vector<int> order;
  evaluator.evaluate_frames({5, 3, 9, 3}, {"g"}, false, [&](const FrameResult& result) { order.push_back(result.frame); });
  EXPECT_THAT(order, ElementsAre(5, 3, 9, 3));
}

TEST_F(EvaluatorTest, AFrameThatFailsLeavesTheOthers) {
  Evaluator evaluator(plan_of("  f: {type: frame}\n  x: {type: failing, in: f, when: 3}\n  w: {type: write, in: x}"));
  std::vector<int> good, bad;
  evaluator.evaluate_frames({1, 2, 3, 4, 5}, {"x"}, true, [&](const FrameResult& result) {
    (result.error ? bad : good).push_back(result.frame);
    if (result.error) {
      EXPECT_STREQ(result.error->what(), "t.yaml:4:3, node 'x': a number that fails (use another)");
      EXPECT_THAT(result.values, IsEmpty());
    }
  });
  EXPECT_THAT(good, UnorderedElementsAre(1, 2, 4, 5));
  EXPECT_THAT(bad, ElementsAre(3));
  EXPECT_THAT(toys::world().written, UnorderedElementsAre(Pair(1, 1), Pair(2, 2), Pair(4, 4), Pair(5, 5)));
}

TEST_F(EvaluatorTest, FramesThatStarveEachOtherAreTriedAgainAlone) {
  Evaluator evaluator(plan_of("  f: {type: frame}\n  g: {type: greedy, in: f}"));
  std::vector<int> good;
  evaluator.evaluate_frames({1, 2, 3, 4, 5, 6}, {"g"}, false, [&](const FrameResult& result) {
    if (!result.error) good.push_back(result.frame);
  });
  EXPECT_THAT(good, UnorderedElementsAre(1, 2, 3, 4, 5, 6));
  Evaluator hopeless(
      plan_of("  v: {type: value, value: 0}\n  f: {type: frame}\n  x: {type: failing, in: v, how: memory}\n  y: {type: add, a: f, b: x}"));
  int failed = 0;
  hopeless.evaluate_frames({1, 2, 3}, {"y"}, false,
                           [&](const FrameResult& result) { failed += result.error && result.error->code() == ErrorCode::kMemory; });
  EXPECT_EQ(failed, 3);
}

TEST_F(EvaluatorTest, ANodeThatFailsStopsOnlyWhatNeedsItAndTheFirstErrorIsToldWhateverTheThreads) {
  const auto three = make_cpu_executor(3);
  EvaluatorOptions options;
  options.executor = three.get();
  Evaluator evaluator(plan_of(R"(
  v: {type: value, value: 0}
  late: {type: failing, in: v, how: standard}
  early: {type: failing, in: v}
  skipped: {type: count, in: early, label: skipped}
  other: {type: count, in: v, label: other}
  w: {type: write, in: other}
  x: {type: write, in: skipped}
)"),
                      options);
  for (int i = 0; i < 20; ++i) EXPECT_THAT(evaluator.evaluate(i, {}, true).error->what(), HasSubstr("node 'early': a number that fails"));
  EXPECT_EQ(toys::runs_of("skipped"), 0);
  EXPECT_EQ(toys::runs_of("other"), 1);
  EXPECT_EQ(toys::world().written.size(), 20u);
}

TEST_F(EvaluatorTest, EveryKindOfExceptionComesBackAsAnErrorOfItsNode) {
  const auto error = [](const std::string& how) {
    return *Evaluator(plan_of("  v: {type: value, value: 0}\n  x: {type: failing, in: v, how: " + how + "}")).evaluate(1, {"x"}).error;
  };
  EXPECT_EQ(error("error").code(), ErrorCode::kInput);
  EXPECT_STREQ(error("standard").what(), "t.yaml:4:3, node 'x': a standard exception");
  EXPECT_EQ(error("strange").code(), ErrorCode::kInternal);
  EXPECT_EQ(error("memory").code(), ErrorCode::kMemory);
  EXPECT_EQ(error("memory").where().node, "x");
}

TEST_F(EvaluatorTest, ANodeThatForgetsAnOutputIsFoundOut) {
  EXPECT_THAT(Evaluator(plan_of("  x: {type: forgets}")).evaluate(1, {"x"}).error->what(),
              HasSubstr("node type 'forgets' did not set its output 'value'"));
}

TEST_F(EvaluatorTest, GetThrowsTheFramesError) {
  Evaluator evaluator(plan_of("  v: {type: value, value: 0}\n  x: {type: failing, in: v}"));
  EXPECT_THROW(evaluator.get<toys::Numbers>("x", 1), Error);
  EXPECT_EQ(toys::first(evaluator.get<toys::Numbers>("v", 1)), 0);
}

TEST_F(EvaluatorTest, IsCancelledPromptlyFromAnotherThread) {
  std::atomic<bool> cancel{false};
  EvaluatorOptions options;
  options.cancelled = [&] { return cancel.load(); };
  Evaluator evaluator(plan_of("  f: {type: frame}\n  s: {type: sleepy, in: f}\n  w: {type: write, in: s}"), options);
  std::thread canceller([&] {
    while (toys::world().asleep == 0) std::this_thread::yield();
    cancel = true;
  });
  int reported = 0;
  const auto start = std::chrono::steady_clock::now();
  evaluator.evaluate_frames({1, 2, 3, 4, 5, 6, 7, 8}, {}, true, [&](const FrameResult&) { ++reported; });
  canceller.join();
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(8));  // a node that is not stopped sleeps for ten
  EXPECT_EQ(reported, 0);
  EXPECT_TRUE(toys::world().written.empty());
  EXPECT_EQ(evaluator.evaluate(1, {"s"}).error->code(), ErrorCode::kCancelled);
  cancel = false;
  EXPECT_EQ(toys::first(evaluator.get<toys::Numbers>("f", 1)), 1);
}

TEST_F(EvaluatorTest, AnExceptionOfTheHostsCallbackComesOut) {
  Evaluator evaluator(plan_of(kChain));
  std::vector<int> frames(100, 1);
  std::atomic<int> told{0};
  EXPECT_THROW(evaluator.evaluate_frames(frames, {"g"}, false,
                                         [&](const FrameResult&) {
                                           ++told;
                                           throw std::runtime_error("the host");
                                         }),
               std::runtime_error);
  EXPECT_LT(told, 100);
}

TEST_F(EvaluatorTest, RepeatsWarningsFromTheCacheOncePerFrame) {
  Evaluator evaluator(plan_of("  v: {type: value}\n  x: {type: warns, in: v}\n  f: {type: frame}\n  y: {type: add, a: x, b: f}"));
  std::vector<std::vector<std::string>> warnings;
  evaluator.evaluate_frames({1, 2}, {"y", "x"}, false, [&](const FrameResult& result) { warnings.push_back(result.warnings); });
  warnings.push_back(evaluator.evaluate(3, {"y"}).warnings);
  for (const auto& each : warnings) EXPECT_THAT(each, ElementsAre("node 'x': a curious number"));
  EXPECT_EQ(warnings.size(), 3u);
  EXPECT_EQ(evaluator.figures().evaluations.at("warns"), 1u);
}

TEST_F(EvaluatorTest, RepeatsTheWarningsOfAllThatACachedNodeStandsOn) {
  Evaluator evaluator(
      plan_of("  v: {type: value}\n  x: {type: warns, in: v}\n  y: {type: add, a: x, b: v}\n"
              "  z: {type: add, a: y, b: v}\n  w: {type: write, in: z}"));
  std::vector<std::vector<std::string>> warnings;
  evaluator.evaluate_frames({1, 2}, {"v"}, true, [&](const FrameResult& result) { warnings.push_back(result.warnings); });
  warnings.push_back(evaluator.evaluate(1, {"z"}).warnings);
  for (const auto& each : warnings) EXPECT_THAT(each, ElementsAre("node 'x': a curious number"));
  EXPECT_EQ(warnings.size(), 3u);
}

TEST_F(EvaluatorTest, SharesPartsBetweenFramesAndMakesThemOnce) {
  const auto three = make_cpu_executor(3);
  EvaluatorOptions options;
  options.executor = three.get();
  Evaluator evaluator(plan_of("  a: {type: shares, name: 100}\n  b: {type: shares, name: 200}\n  c: {type: add, a: a, b: b}"), options);
  std::vector<int> frames(32);
  for (int i = 0; i < 32; ++i) frames[static_cast<size_t>(i)] = i;
  evaluator.evaluate_frames(frames, {"c"}, false, [&](const FrameResult& result) { EXPECT_EQ(value_of(result, "c"), 300 + 2 * result.frame); });
  EXPECT_EQ(toys::runs_of("shared part"), 2);
}
TEST_F(EvaluatorTest, MakesSharedPartsBeforeFramesRunSideBySide) {
  const auto four = make_cpu_executor(4);
  EvaluatorOptions options;
  options.executor = four.get();
  Evaluator evaluator(plan_of("  f: {type: frame}\n  g: {type: count, in: f, label: beside}\n  p: {type: shares}"), options);
  evaluator.evaluate_frames({1, 2, 3, 4, 5, 6, 7, 8}, {"g", "p"}, false, [](const FrameResult& result) { EXPECT_FALSE(result.error); });
  EXPECT_EQ(toys::runs_of("beside"), 8);
  EXPECT_EQ(toys::runs_of("shared part"), 1);
  EXPECT_EQ(toys::runs_of("shared part made beside others"), 0);
}
TEST_F(EvaluatorTest, CountsWhatIsMadeForAllFramesApartFromTheFrames) {
  Evaluator evaluator(plan_of("  o: {type: value}\n  a: {type: add, a: o, b: o}\n  p: {type: shares}\n  c: {type: add, a: a, b: p}"));
  std::map<int, std::vector<std::string>> worked, set_up;
  evaluator.evaluate_frames({3, 4, 5}, {"c"}, false, [&](const FrameResult& result) {
    for (const NodeTime& time : result.times) {
      if (!time.cached) worked[result.frame].push_back(time.name);
      if (time.set_up > 0) set_up[result.frame].push_back(time.name);
      EXPECT_TRUE(!time.cached || time.seconds == 0) << time.name;
    }
  });
  for (const int frame : {3, 4, 5}) {
    EXPECT_THAT(worked[frame], ElementsAre("p", "c")) << "the first frame's own share of `p` is its own";
    EXPECT_THAT(set_up[frame], ElementsAre("o", "a", "p")) << "with `o`, at which no frame looks";
  }
  const EvaluatorFigures figures = evaluator.figures();
  EXPECT_EQ(figures.set_up.size(), 3u);
  EXPECT_GT(figures.set_up_seconds, 0);
  EXPECT_LE(figures.set_up.at("p"), figures.seconds.at("p"));
}

// `a` and `b` have one part: one makes it, and the other's waiting is no work.
TEST_F(EvaluatorTest, CountsNoWaitingForAPartThatIsMade) {
  const auto two = make_cpu_executor(2);
  EvaluatorOptions options;
  options.executor = two.get();
  double least = 1e9, most = 0;
  for (int round = 0; round < 5; ++round) {  // the best of some, since a thread may be kept from its work
    Evaluator evaluator(plan_of("  a: {type: shares, name: 100}\n  b: {type: shares, name: 100}\n  c: {type: add, a: a, b: b}"), options);
    evaluator.evaluate_frames({1, 2, 3}, {"c"}, false, [](const FrameResult& result) { EXPECT_FALSE(result.error); });
    const EvaluatorFigures figures = evaluator.figures();
    const double a = figures.seconds.at("a"), b = figures.seconds.at("b");
    least = std::min(least, std::min(a, b));
    most = std::max(most, std::max(a, b));
  }
  EXPECT_GT(most, 0.004);
  EXPECT_LT(least, 0.5 * most);
}
TEST_F(EvaluatorTest, HasNoSetUpForOneFrame) {
  Evaluator evaluator(plan_of("  a: {type: value}\n  p: {type: shares}\n  c: {type: add, a: a, b: p}"));
  evaluator.evaluate_frames({3}, {"c"}, false, [&](const FrameResult& result) {
    double sum = 0;
    for (const NodeTime& time : result.times) {
      EXPECT_FALSE(time.cached) << time.name;
      sum += time.seconds;
    }
    EXPECT_EQ(result.times.size(), 3u);
    EXPECT_GT(result.seconds, 0);
  });
  EXPECT_THAT(evaluator.figures().set_up, testing::IsEmpty());
}
TEST_F(EvaluatorTest, ServesSeveralHostThreads) {
  Evaluator evaluator(plan_of(kChain));
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&, t] {
      for (int i = 0; i < 50; ++i) EXPECT_EQ(toys::first(evaluator.get<toys::Numbers>("g", i * (t + 1))), 2 + i * (t + 1));
    });
  for (std::thread& thread : threads) thread.join();
}
TEST_F(EvaluatorTest, WorksWithACacheThatHoldsNothing) {
  EvaluatorOptions options;
  options.cache = std::make_shared<Cache>(0);
  Evaluator evaluator(plan_of(kChain + std::string("  p: {type: shares}\n")), options);
  int frames = 0;
  evaluator.evaluate_frames({1, 2, 3, 4}, {"g", "p"}, true, [&](const FrameResult& result) {
    ++frames;
    EXPECT_EQ(value_of(result, "g"), 2 + result.frame);
  });
  EXPECT_EQ(frames, 4);
  EXPECT_EQ(evaluator.figures().cache.entries, 0u);
}
TEST_F(EvaluatorTest, TellsTimesInPlanOrder) {
  const FrameResult result = Evaluator(plan_of(kChain)).evaluate(1, {"g"});
  std::vector<std::string> names;
  for (const NodeTime& time : result.times) names.push_back(time.name);
  EXPECT_THAT(names, ElementsAre("a", "b", "c", "d", "f", "e", "g"));
}
TEST_F(EvaluatorTest, FrameKeyNamesEverythingThatAFrameDependsOn) {
  toys::world().files = {{"s1", 10}, {"s2", 10}};
  const char* const graph = "  s: {type: file, path: s#}\n  a: {type: add, a: s, offset: 2}\n  w: {type: write, in: a}\n  u: {type: value}";
  Evaluator evaluator(plan_of(graph));
  const Key key = evaluator.frame_key(1, {}, true);
  EXPECT_EQ(key, Evaluator(plan_of(graph)).frame_key(1, {}, true));
  EXPECT_EQ(key, Evaluator(plan_of(graph, {{"u.value", 9}})).frame_key(1, {}, true));  // does not reach the file
  EXPECT_NE(key, Evaluator(plan_of(graph, {{"a.offset", 3}})).frame_key(1, {}, true));
  EXPECT_NE(key, evaluator.frame_key(2, {}, true));
  EXPECT_NE(key, evaluator.frame_key(1, {"u"}, true));
  toys::world().files["s1"] = 11;
  EXPECT_NE(key, evaluator.frame_key(1, {}, true));
  EXPECT_THROW(evaluator.frame_key(3, {}, true), Error);
}

}  // namespace evaluator_test
}  // namespace knead
