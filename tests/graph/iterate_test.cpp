// Loops: when they end, what they say, what they carry and what they do not allocate.
#include "graph/iterate.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <new>

#include "io/graph_file.h"
#include "tests/graph/toys.h"

namespace knead {
namespace iterate_test {
std::atomic<uint64_t> allocations{0};
}  // namespace iterate_test
}  // namespace knead

// Counts every allocation of this program. Kept out of line: a compiler that sees through to malloc takes the pairs for mismatched.
[[gnu::noinline]] void* operator new(size_t size) {
  knead::iterate_test::allocations.fetch_add(1, std::memory_order_relaxed);
  if (void* storage = std::malloc(size ? size : 1)) return storage;
  throw std::bad_alloc();
}
[[gnu::noinline]] void* operator new(size_t size, const std::nothrow_t&) noexcept {
  knead::iterate_test::allocations.fetch_add(1, std::memory_order_relaxed);
  return std::malloc(size ? size : 1);
}
[[gnu::noinline]] void operator delete(void* storage) noexcept {
  std::free(storage);
}
[[gnu::noinline]] void operator delete(void* storage, size_t) noexcept {
  std::free(storage);
}

namespace knead {
namespace iterate_test {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

const auto serial_executor = make_serial_executor();

struct Loop {
  explicit Loop(const std::string& nodes, Executor& executor = *serial_executor)
      : evaluator(compile(read_graph_text("knead: 1\nnodes:\n" + nodes, "t.yaml"), toys::options()), options(executor)) {}
  static EvaluatorOptions options(Executor& executor) {
    EvaluatorOptions made;
    made.executor = &executor;
    return made;
  }
  double get(const std::string& output, int frame = 1) { return toys::first(evaluator.get<toys::Numbers>(output, frame)); }
  Report report(const std::string& loop, int frame = 1) { return evaluator.get<Report>(loop + ".report", frame); }
  std::string error(const std::string& output) {
    const FrameResult result = evaluator.evaluate(1, {output});
    return result.error ? result.error->what() : "";
  }
  Evaluator evaluator;
};

// A loop that relaxes x from 0 to 8, with more parameters.
std::string relaxing(const std::string& parameters, const std::string& more_body = {}) {
  return "  v: {type: value, value: 0, size: 16}\n  t: {type: value, value: 8}\n  l:\n    type: iterate\n" + parameters +
         "    state: {x: v}\n    body:\n      r: {type: relax, x: state.x, target: t}\n" + more_body + "    next: {x: r}\n";
}

class IterateTest : public testing::Test {
 protected:
  void SetUp() override { toys::begin_anew(); }
};

TEST_F(IterateTest, EndsAtRestAndSaysSo) {
  Loop loop(relaxing("    threshold: 0.1\n"));
  const Report report = loop.report("l");
  EXPECT_EQ(report.word("ended"), "at rest");
  EXPECT_EQ(report.number("iterations"), 7);  // the seventh round moves 8 / 2^7
  EXPECT_EQ(report.number("unrest"), 8.0 / 128);
  EXPECT_EQ(loop.get("l"), 8 - 8.0 / 128);
}

TEST_F(IterateTest, EndsAtTheLimitAndSaysSo) {
  Loop loop(relaxing("    threshold: 0\n    max_iterations: 3\n"));
  EXPECT_EQ(loop.report("l").word("ended"), "iteration limit");
  EXPECT_EQ(loop.report("l").number("iterations"), 3);
  EXPECT_EQ(loop.get("l"), 7);
}

TEST_F(IterateTest, MakesTheRoundsThatAreAlwaysMade) {
  EXPECT_EQ(Loop(relaxing("    threshold: 100\n")).report("l").number("iterations"), 1);
  EXPECT_EQ(Loop(relaxing("    threshold: 100\n    min_iterations: 4\n")).report("l").number("iterations"), 4);
}

TEST_F(IterateTest, MakesNoRoundWhenNoneIsAllowed) {
  Loop loop(relaxing("    max_iterations: 0\n"));
  EXPECT_EQ(loop.get("l"), 0);
  EXPECT_EQ(loop.report("l").number("iterations"), 0);
  EXPECT_THAT(Loop("  v: {type: value}\n  l: {type: iterate, max_iterations: 0, state: {m: none}, body: {t: {type: tally, memory: state.m, of: v}}, "
                   "next: {m: t}}")
                  .error("l"),
              HasSubstr("node 'l': state 'm' has no value: it starts with none and no round was made"));
}

TEST_F(IterateTest, MakesAllRoundsWhenNothingSaysHowFarFromRestItIs) {
  Loop loop(
      "  v: {type: value}\n  s: {type: spell, in: v}\n  l: {type: iterate, max_iterations: 5, state: {w: s.word}, body: {z: {type: spell, in: v}}, "
      "next: {w: z.word}}");
  EXPECT_EQ(loop.report("l").number("iterations"), 5);
  EXPECT_EQ(loop.report("l").word("ended"), "iteration limit");
}

TEST_F(IterateTest, StartsAStateWithNone) {
  Loop loop(
      "  v: {type: value}\n  l: {type: iterate, threshold: 0, max_iterations: 6, state: {m: none, x: v}, body: {t: {type: tally, memory: state.m, "
      "of: v}, a: {type: add, a: state.x, b: t}}, next: {m: t, x: a}}");
  EXPECT_EQ(loop.get("l.m"), 6);
  EXPECT_EQ(loop.get("l.x"), 1 + 1 + 2 + 3 + 4 + 5 + 6);
}

TEST_F(IterateTest, StatesGoRoundTogether) {
  Loop loop(
      "  v: {type: value, value: 0}\n  w: {type: value, value: 1}\n  l: {type: iterate, threshold: 0, max_iterations: 10, state: {a: v, b: w}, body: "
      "{s: {type: add, a: state.a, b: state.b}}, next: {a: state.b, b: s}}");
  EXPECT_EQ(loop.get("l.a"), 55);  // Fibonacci
  EXPECT_EQ(loop.get("l.b"), 89);
}

TEST_F(IterateTest, AStateThatIsNoNumberAnyMoreIsAnError) {
  EXPECT_THAT(
      Loop("  v: {type: value, value: 10}\n  l: {type: iterate, state: {x: v}, body: {e: {type: explode, x: state.x}}, next: {x: e}}").error("l"),
      AllOf(HasSubstr("node 'l': state 'x' is no longer a number after"), HasSubstr("rounds")));
}

TEST_F(IterateTest, AnErrorInTheBodyNamesItsNode) {
  EXPECT_THAT(Loop(relaxing("", "      f: {type: failing, in: state.x, when: 4}\n")).error("l"),
              HasSubstr("t.yaml:10:7, node 'l.f': a number that fails"));
}

TEST_F(IterateTest, RunsOnceWhatTheStateDoesNotReach) {
  Loop loop(relaxing("    threshold: 0\n    max_iterations: 20\n",
                     "      once: {type: count, in: t, label: once}\n      always: {type: count, in: state.x, label: always}\n      both: {type: "
                     "add, a: once, b: always}\n"));
  loop.get("l");
  EXPECT_EQ(toys::runs_of("once"), 1);
  EXPECT_EQ(toys::runs_of("always"), 20);
}

TEST_F(IterateTest, SeesTheFrameAndItsOwnCacheKey) {
  Loop loop(
      "  v: {type: value, value: 0}\n  l: {type: iterate, threshold: 0, max_iterations: 3, state: {x: v}, body: {f: {type: frame}, a: {type: add, a: "
      "state.x, b: f}}, next: {x: a}}");
  EXPECT_EQ(loop.get("l", 2), 6);
  EXPECT_EQ(loop.get("l", 5), 15);
  EXPECT_EQ(loop.get("l", 2), 6);
  EXPECT_EQ(loop.evaluator.figures().evaluations.at("iterate"), 2u);
}

TEST_F(IterateTest, FollowsFilesReadInItsBody) {
  toys::world().files = {{"a", 2}};
  Loop loop(
      "  v: {type: value, value: 0}\n  l: {type: iterate, threshold: 0, max_iterations: 3, state: {x: v}, body: {f: {type: file}, a: {type: add, a: "
      "state.x, b: f}}, next: {x: a}}");
  EXPECT_EQ(loop.get("l"), 6);
  toys::world().files["a"] = 3;
  EXPECT_EQ(loop.get("l"), 9);
}

TEST_F(IterateTest, NestsAndCaptures) {
  Loop loop(R"(
  v: {type: value, value: 0}
  far: {type: value, value: 1000}
  outer:
    type: iterate
    max_iterations: 3
    threshold: 0
    state: {x: v}
    body:
      inner:
        type: iterate
        max_iterations: 2
        threshold: 0
        state: {y: state.x}
        body:
          a: {type: add, a: state.y, b: far}
          b: {type: add, a: a, b: state.x, offset: 1}
        next: {y: b}
    next: {x: inner.y}
)");
  double x = 0;
  for (int outer = 0; outer < 3; ++outer) {
    double y = x;
    for (int inner = 0; inner < 2; ++inner) y = y + 1000 + x + 1;
    x = y;
  }
  EXPECT_EQ(loop.get("outer"), x);
  std::vector<std::string> names;
  for (const NodeTime& time : Loop(relaxing("")).evaluator.evaluate(1, {"l"}).times) names.push_back(time.name);
  EXPECT_THAT(names, ElementsAre("v", "t", "l", "l.r"));
}

TEST_F(IterateTest, StopsWhenItIsCancelled) {
  int asked = 0;
  EvaluatorOptions options;
  options.executor = serial_executor.get();
  options.cancelled = [&] { return ++asked > 50; };
  Evaluator evaluator(
      compile(
          read_graph_text("knead: 1\nnodes:\n" + relaxing("    threshold: 0\n    max_iterations: 1000000\n    min_iterations: 1000000\n"), "t.yaml"),
          toys::options()),
      options);
  EXPECT_EQ(evaluator.evaluate(1, {"l"}).error->code(), ErrorCode::kCancelled);
  EXPECT_LT(asked, 60);
}

struct Counted {
  uint64_t heap, blocks;
};
Counted allocations_of(int rounds, Executor& executor, const std::string& more_body = {}) {
  Loop loop(relaxing("    threshold: 0\n    min_iterations: 1000000\n    max_iterations: " + std::to_string(rounds) + "\n", more_body), executor);
  loop.evaluator.evaluate(1, {"v", "t"});
  const uint64_t heap = allocations, blocks = host_memory_figures().from_system;
  const FrameResult result = loop.evaluator.evaluate(1, {"l"});
  EXPECT_FALSE(result.error);
  return {allocations - heap, host_memory_figures().from_system - blocks};
}

TEST_F(IterateTest, AllocatesNothingPerRound) {
  const std::string body =
      "      once: {type: add, a: t}\n      s: {type: add, a: r, b: once}\n      d: {type: device_add, in: s}\n      p: {type: spread, in: d}\n      "
      "y: {type: tally, memory: p, of: s}\n";
  for (int threads : {0, 1, 2}) {
    const auto executor = threads ? make_cpu_executor(threads) : make_serial_executor();
    allocations_of(3, *executor, body);
    const Counted few = allocations_of(10, *executor, body), many = allocations_of(1000, *executor, body);
    EXPECT_EQ(few.heap, many.heap) << executor->name();
    EXPECT_EQ(few.blocks, many.blocks) << executor->name();
    EXPECT_GT(few.heap, 0u);  // the counter counts
  }
}

}  // namespace iterate_test
}  // namespace knead
