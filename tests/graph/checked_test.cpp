// Checked mode: nodes that do what they did not declare are found out.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "io/graph_file.h"
#include "tests/graph/toys.h"

namespace knead {
namespace checked_test {

using testing::AllOf;
using testing::HasSubstr;

struct Checked {
  explicit Checked(const std::string& nodes, bool checked = true) : evaluator(plan(nodes), options(checked)) {}
  static std::shared_ptr<const Plan> plan(const std::string& nodes) {
    return compile(read_graph_text("knead: 1\nnodes:\n" + nodes, "t.yaml"), toys::options());
  }
  static EvaluatorOptions options(bool checked) {
    EvaluatorOptions made;
    made.checked = checked;
    return made;
  }
  std::string error(const std::string& output, int frame = 1) {
    const FrameResult result = evaluator.evaluate(frame, {output});
    return result.error ? result.error->what() : "";
  }
  Evaluator evaluator;
};

class CheckedMode : public testing::Test {
 protected:
  void SetUp() override { toys::begin_anew(); }
};

TEST_F(CheckedMode, FindsANodeThatReadsTheFrameWithoutSayingSo) {
  EXPECT_THAT(Checked("  x: {type: sly_frame}").error("x"),
              AllOf(HasSubstr("t.yaml:3:3, node 'x'"), HasSubstr("node type 'sly_frame' reads the frame without saying so")));
  EXPECT_EQ(Checked("  x: {type: sly_frame}", false).error("x"), "");
  EXPECT_EQ(Checked("  x: {type: frame}").error("x"), "");
}

TEST_F(CheckedMode, FindsItInALoopToo) {
  const std::string loop = R"(  v: {type: value}
  l:
    type: iterate
    state: {x: v}
    body:
      f: {type: frame}
      s: {type: sly_frame}
      r: {type: relax, x: state.x, target: )";
  EXPECT_THAT(Checked(loop + "s}\n    next: {x: r}").error("l"), HasSubstr("node 'l.s': node type 'sly_frame' reads the frame"));
}

TEST_F(CheckedMode, FindsAResultThatDependsOnSomethingOutsideItsKey) {
  Checked checked("  x: {type: sly_global}\n  y: {type: add, a: x}");
  EXPECT_EQ(checked.error("y"), "");
  EXPECT_EQ(checked.error("y"), "");
  toys::world().hidden = 2;
  EXPECT_THAT(checked.error("y"),
              AllOf(HasSubstr("node 'x': output 'value' differs from its cached result"), HasSubstr("node type 'sly_global' depends on something")));
}

TEST_F(CheckedMode, FindsAnUnnamedDependenceOfASharedPart) {
  Checked checked("  x: {type: sly_once}");
  EXPECT_EQ(checked.error("x"), "");
  toys::world().hidden = 2;
  EXPECT_THAT(checked.error("x"), HasSubstr("a shared part differs from its cached result"));
}

TEST_F(CheckedMode, FindsANodeThatChangesItsInputs) {
  EXPECT_THAT(Checked("  v: {type: value}\n  x: {type: sly_write, in: v}").error("x"),
              HasSubstr("node 'x': node type 'sly_write' changed its inputs"));
  EXPECT_THAT(Checked("  v: {type: value}\n  l: {type: iterate, state: {x: v}, body: {w: {type: sly_write, in: state.x}}, next: {x: w}}").error("l"),
              HasSubstr("node 'l.w': node type 'sly_write' changed its inputs"));
}

TEST_F(CheckedMode, HasNothingAgainstHonestGraphsAndRunsEffectsOnce) {
  toys::world().files = {{"a", 3}};
  Checked checked(R"(
  v: {type: value}
  n: {type: file}
  f: {type: frame}
  s: {type: shares, name: 3}
  l: {type: iterate, max_iterations: 5, state: {x: v, m: none}, body: {r: {type: relax, x: state.x, target: n}, t: {type: tally, memory: state.m, of: r}}, next: {x: r, m: t}}
  sum: {type: sum, of: [v, n, f, s, l.x, l.m]}
  w: {type: write, in: sum}
)");
  for (int pass = 0; pass < 2; ++pass)
    checked.evaluator.evaluate_frames({1, 2, 3}, {"sum"}, true,
                                      [&](const FrameResult& result) { EXPECT_FALSE(result.error) << result.error->what(); });
  EXPECT_EQ(toys::world().written.size(), 6u);
}

}  // namespace checked_test
}  // namespace knead
