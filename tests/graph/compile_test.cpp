// What the compiler says of wrong graphs, and what it makes of right ones.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "graph/plan.h"
#include "io/graph_file.h"
#include "tests/graph/fake_device.h"
#include "tests/graph/toys.h"

namespace knead {
namespace compile_test {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::StartsWith;

using Overrides = std::vector<std::pair<std::string, Literal>>;

std::shared_ptr<const Plan> plan_of(const std::string& nodes, const Overrides& overrides = {}) {
  CompileOptions options = toys::options();
  options.overrides = overrides;
  return compile(read_graph_text("knead: 1\nnodes:\n" + nodes, "t.yaml"), options);
}

// One text per error.
std::vector<std::string> errors_of(const std::string& nodes, const Overrides& overrides = {}) {
  try {
    plan_of(nodes, overrides);
  } catch (const GraphErrors& errors) {
    std::vector<std::string> texts;
    for (const Error& error : errors.errors()) texts.push_back(error.what());
    return texts;
  }
  return {};
}

TEST(Compile, OrdersNodesByWhatTheyNeed) {
  const auto plan = plan_of(R"(
  last: {type: add, a: middle, b: first}
  middle: {type: add, a: first}
  first: {type: value}
)");
  std::vector<std::string> names;
  for (const PlanNode& node : plan->nodes) names.push_back(node.name);
  EXPECT_THAT(names, ElementsAre("first", "middle", "last"));
  EXPECT_EQ(plan->find("last"), (Source{2, 0}));
  EXPECT_EQ(plan->find("last.sum"), (Source{2, 0}));
  EXPECT_THROW(plan->find("lst"), Error);
}

TEST(Compile, TakesAnEmptyGraph) {
  EXPECT_TRUE(plan_of("  {}")->nodes.empty());
}

TEST(Compile, NamesUnknownTypesNodesOutputsAndParametersWithTheNearestAtOnceAndInOrder) {
  EXPECT_THAT(errors_of(R"(
  a: {type: vlaue}
  b: {type: value, vlue: 3}
  c: {type: add, a: d, b: b.valu}
  dd: {type: value, size: 0}
  e: {type: add, a: dd, offset: many}
  f: {type: count, in: dd, mood: hasti}
)"),
              ElementsAre("t.yaml:4:3, node 'a': unknown node type 'vlaue' (did you mean 'value'?)",
                          "t.yaml:5:20, node 'b', 'vlue': the node has no such input or parameter (did you mean 'value'?)",
                          "t.yaml:6:21, node 'c', 'a': there is no node 'd' (did you mean 'a'?)",
                          "t.yaml:6:27, node 'c', 'b': 'b' has no output 'valu' (did you mean 'value'?)",
                          "t.yaml:7:27, node 'dd', 'size': 0 is out of range: expected at least 1",
                          "t.yaml:8:33, node 'e', 'offset': expected a number, found a text",
                          "t.yaml:9:34, node 'f', 'mood': 'hasti' is not one of: calm, hasty; did you mean 'hasty'?"));
}

TEST(Compile, ListsWhatThereIsWhenNothingIsNear) {
  EXPECT_THAT(errors_of("  a: {type: value, whatever_else: 3}"), ElementsAre(HasSubstr("(it takes value, size)")));
  EXPECT_THAT(errors_of("  a: {type: value}\n  s: {type: spell, in: a}\n  b: {type: add, a: s.absolutely}"),
              ElementsAre(HasSubstr("(it has word, number)")));
}

TEST(Compile, ReportsAMistakeOnceAndNotWhatFollowsFromIt) {
  EXPECT_THAT(errors_of(R"(
  a: {type: nonsense}
  b: {type: add, a: a, b: a.anything}
  c: {type: add, a: b.sum}
  d: {type: add, a: b}
)"),
              ElementsAre(HasSubstr("unknown node type 'nonsense'")));
}

TEST(Compile, AsksForInputsThatMustBeConnected) {
  EXPECT_THAT(errors_of("  a: {type: add}\n  b: {type: add, a: none}\n  c: {type: add, a: ~}"),
              ElementsAre("t.yaml:3:3, node 'a', 'a': this input must be connected (it takes a Numbers)",
                          "t.yaml:4:21, node 'b', 'a': this input must be connected (it takes a Numbers)",
                          "t.yaml:5:21, node 'c', 'a': this input must be connected (it takes a Numbers)"));
}

TEST(Compile, TakesNoneForAnOptionalInput) {
  const auto plan = plan_of(
      "  v: {type: value}\n  a: {type: add, a: v, b: none}\n  s: {type: sum, of: none}\n  t: {type: sum}\n  l: {type: sum, of: [v, none, v]}");
  EXPECT_THAT(plan->nodes[1].inputs[1], IsEmpty());
  EXPECT_THAT(plan->nodes[2].inputs[0], IsEmpty());
  EXPECT_THAT(plan->nodes[4].inputs[0], ElementsAre(Source{0, 0}, Source{0, 0}));
}

TEST(Compile, TellsWhichOutputWouldFitOnATypeMismatch) {
  EXPECT_THAT(
      errors_of(
          "  v: {type: value}\n  s: {type: spell, in: v}\n  a: {type: add, a: s}\n  b: {type: add, a: s.number}\n  c: {type: sum, of: [v, s.word]}"),
      ElementsAre("t.yaml:5:21, node 'a', 'a': expected a Numbers, but 's' is a Word (did you mean 's.number'?)",
                  "t.yaml:7:26, node 'c', 'of': expected a Numbers, but 's.word' is a Word (did you mean 's.number'?)"));
}

TEST(Compile, RefusesAListWhereOneValueGoes) {
  EXPECT_THAT(errors_of("  v: {type: value}\n  a: {type: add, a: [v, v]}"),
              ElementsAre("t.yaml:4:21, node 'a', 'a': this input takes one value, and a list was given"));
  EXPECT_THAT(errors_of("  v: {type: value}\n  a: {type: add, a: [v]}"), IsEmpty());
}

TEST(Compile, RefusesWhatIsNoReference) {
  EXPECT_THAT(
      errors_of("  v: {type: value}\n  a: {type: add, a: 3, b: {x: 1}}"),
      ElementsAre(HasSubstr("t.yaml:4:21, node 'a', 'a': expected the name of a node or of its output, found an integer"), HasSubstr("found a map")));
  EXPECT_THAT(errors_of("  v: {type: value}\n  w: {type: write, in: v}\n  a: {type: add, a: w}"), ElementsAre(HasSubstr("'w' has no outputs")));
}

TEST(Compile, ShowsACycleOnce) {
  EXPECT_THAT(errors_of("  a: {type: add, a: c}\n  b: {type: add, a: a}\n  c: {type: add, a: b}\n  d: {type: add, a: b}"),
              ElementsAre(AllOf(HasSubstr("a cycle: a -> c -> b -> a"), HasSubstr("node of type iterate"))));
  EXPECT_THAT(errors_of("  a: {type: add, a: a}"), ElementsAre(HasSubstr("a cycle: a -> a")));
  EXPECT_THAT(errors_of("  a: {type: add, a: b}\n  b: {type: add, a: a}\n  c: {type: add, a: d}\n  d: {type: add, a: c}").size(), 2u);
}

TEST(Compile, RefusesBadNames) {
  EXPECT_THAT(errors_of("  1a: {type: value}\n  a.b: {type: value}\n  state: {type: value}\n  inputs: {type: value}\n  none: {type: value}"),
              ElementsAre(HasSubstr("'1a' is no name"), HasSubstr("'a.b' is no name"), HasSubstr("'state' has a meaning"), HasSubstr("'inputs'"),
                          HasSubstr("'none'")));
  EXPECT_THAT(errors_of("  a: {value: 2}"), ElementsAre(HasSubstr("t.yaml:3:3, node 'a': the node has no type")));
  EXPECT_THAT(errors_of("  v: {type: value}\n  a: {type: add, a: state.x}"),
              ElementsAre(HasSubstr("there is no state here (only the body of a loop has states)")));
}

TEST(Compile, ChecksGraphsMadeByCallsAsWell) {
  GraphSpec graph;
  graph.add("a", "value", {{"value", 2}}).add("a", "value").add("b", "").add("c d", "value").add("e", "add", {{"a", "f"}});
  try {
    compile(graph, toys::options());
    FAIL();
  } catch (const GraphErrors& errors) {
    std::vector<std::string> texts;
    for (const Error& error : errors.errors()) texts.push_back(error.what());
    EXPECT_THAT(texts, ElementsAre(HasSubstr("node 'a': node 'a' is there twice"), HasSubstr("'c d' is no name"),
                                   HasSubstr("node 'b': the node has no type"), HasSubstr("there is no node 'f'")));
  }
}

TEST(Compile, SurvivesVeryLongChains) {
  std::string forward = "  n0: {type: value}\n", backward;
  for (int i = 1; i < 3000; ++i) forward += "  n" + std::to_string(i) + ": {type: add, a: n" + std::to_string(i - 1) + "}\n";
  for (int i = 0; i < 3000; ++i) backward += "  n" + std::to_string(i) + ": {type: add, a: n" + std::to_string(i + 1) + "}\n";
  backward += "  n3000: {type: value}\n";
  EXPECT_EQ(plan_of(forward)->nodes.size(), 3000u);
  for (const std::string& error : errors_of(backward)) EXPECT_THAT(error, HasSubstr("nodes wait for each other here"));
}

TEST(Compile, MarksWhatDependsOnTheFrame) {
  const auto plan = plan_of("  v: {type: value}\n  f: {type: frame}\n  a: {type: add, a: v}\n  b: {type: add, a: a, b: f}\n  c: {type: add, a: b}");
  std::vector<bool> depends;
  for (const PlanNode& node : plan->nodes) depends.push_back(node.frame_dependent);
  EXPECT_THAT(depends, ElementsAre(false, true, false, true, true));
}

TEST(Compile, PutsValuesFromTheCommandLineInEverywhere) {
  const std::string graph = R"(
  v: {type: value, value: 1}
  w: {type: value}
  a: {type: add, a: v}
  l:
    type: iterate
    state: {x: a}
    body:
      r: {type: relax, x: state.x, target: v}
    next: {x: r}
)";
  const auto plan = plan_of(graph, {{"v.value", 5}, {"v.size", 2}, {"a.a", "w"}, {"l.max_iterations", 7}, {"l.r.rate", 0.25}});
  const auto shown = [](const Plan& p, const std::string& node, const std::string& param) -> std::string {
    for (const PlanNode& one : p.nodes)
      for (const ParamBase* each : one.node->params())
        if (one.name == node && each->name() == param) return each->show().text();
    return "none";
  };
  EXPECT_EQ(shown(*plan, "v", "value"), "5");
  EXPECT_EQ(shown(*plan, "v", "size"), "2");
  EXPECT_EQ(shown(*plan, "l", "max_iterations"), "7");
  const std::string text = plan_text(*plan, *make_serial_executor());
  EXPECT_THAT(text, HasSubstr("rate = 0.25"));
  EXPECT_THAT(text, HasSubstr("a <- w.value"));
}

TEST(Compile, TheLastOfTwoValuesForTheSameParameterHolds) {
  const auto plan = plan_of("  v: {type: value}", {{"v.value", 5}, {"v.value", 6}});
  EXPECT_EQ(plan->nodes[0].node->params()[0]->show().number(), 6);
}

TEST(Compile, SaysWhatIsWrongWithValuesFromTheCommandLine) {
  const std::string graph = "  v: {type: value}\n  a: {type: add, a: v}";
  EXPECT_THAT(errors_of(graph, {{"v.valu", 5}, {"u.value", 5}, {"v.size", -1}, {"a.b", "x"}}),
              ElementsAre("--set, node 'v', 'size': -1 is out of range: expected at least 1",
                          "--set, node 'a', 'b': there is no node 'x' (did you mean 'v'?)",
                          "--set, 'v.valu': no node has this parameter (did you mean 'v.value'?)",
                          "--set, 'u.value': no node has this parameter (did you mean 'v.value'?)"));
}

TEST(Compile, DoesNotBlameValuesForWhatCouldNotBeLookedInto) {
  EXPECT_THAT(errors_of("  v: {type: nonsense}\n  l: {type: iterate}", {{"v.value", 5}, {"l.r.rate", 5}}),
              ElementsAre(HasSubstr("unknown node type"), HasSubstr("`state:`"), HasSubstr("`body:`"), HasSubstr("`next:`")));
}

TEST(Compile, GivesEqualKeysToEqualNodesAndOthersToOthers) {
  const auto plan = plan_of(
      "  a: {type: value, value: 2}\n  b: {type: value, value: 2.0}\n  c: {type: value, value: 3}\n  d: {type: value, value: 2, size: 2}\n  e: "
      "{type: frame}");
  const auto key = [&](size_t i) { return plan->nodes[i].static_key; };
  EXPECT_EQ(key(0), key(1));
  EXPECT_NE(key(0), key(2));
  EXPECT_NE(key(0), key(3));
  EXPECT_NE(key(0), key(4));
}

const char* const kLoop = R"(
  v: {type: value}
  l:
    type: iterate
    state: {x: v}
    body:
      r: {type: relax, x: state.x, target: v}
    next: {x: r}
  after: {type: add, a: l}
  w: {type: write, in: after}
)";

TEST(CompileLoop, GivesStatesAndAReportAsOutputs) {
  const auto plan = plan_of(kLoop);
  EXPECT_NO_THROW(plan->find("l.x"));
  EXPECT_NO_THROW(plan->find("l.report"));
  EXPECT_EQ(plan->find("l"), plan->find("l.x"));
}

TEST(CompileLoop, AsksForItsParts) {
  EXPECT_THAT(
      errors_of("  l: {type: iterate, state: 3, thresold: 1}"),
      ElementsAre(HasSubstr("needs `body:`"), HasSubstr("needs `next:`"), HasSubstr("t.yaml:3:29, node 'l': a loop needs `state:` with a map"),
                  AllOf(StartsWith("t.yaml:3:32"), HasSubstr("did you mean 'threshold'?"))));
}

TEST(CompileLoop, ReportsWhatIsWrongInsideAndAroundAtOnce) {
  EXPECT_THAT(errors_of(R"(
  v: {type: value}
  l:
    type: iterate
    threshold: low
    state: {x: v, y: nowhere, report: v}
    body:
      r: {type: relax, x: state.xx, target: vv}
      broken: 3
      s: {type: rlax, x: state.x, target: broken}
    next: {x: s, z: r}
  after: {type: add, a: l.x, b: l.nothing}
)"),
              ElementsAre(AllOf(StartsWith("t.yaml:7:16"), HasSubstr("expected a number")),
                          AllOf(StartsWith("t.yaml:8:22"), HasSubstr("no node 'nowhere'")), HasSubstr("a state cannot be named report"),
                          AllOf(StartsWith("t.yaml:10:27"), HasSubstr("no state 'xx'"), HasSubstr("did you mean 'x'?")),
                          AllOf(StartsWith("t.yaml:10:45"), HasSubstr("no node 'vv'"), HasSubstr("did you mean 'v'?")),
                          HasSubstr("t.yaml:11:7, node 'l.broken': the node has no type"),
                          AllOf(StartsWith("t.yaml:12:7"), HasSubstr("did you mean 'relax'?")),
                          HasSubstr("t.yaml:13:11, node 'l', 'next': state 'y' has no value"),
                          AllOf(StartsWith("t.yaml:13:18"), HasSubstr("the loop has no state 'z'"))));
}

TEST(CompileLoop, ChecksTheTypesThatGoRound) {
  EXPECT_THAT(errors_of(R"(
  v: {type: value}
  l:
    type: iterate
    state: {x: v, memory: none}
    body:
      s: {type: spell, in: state.x}
      t: {type: tally, memory: state.memory, of: s.number}
    next: {x: s, memory: s.word}
)"),
              ElementsAre(HasSubstr("t.yaml:10:7, node 'l.t', 'memory': expected a Numbers, but 'state.memory' is a Word from the second round on"),
                          HasSubstr("t.yaml:11:15, node 'l', 'x': expected a Numbers, but 's' is a Word (did you mean 's.number'?)")));
  EXPECT_THAT(errors_of("  v: {type: value}\n  l: {type: iterate, state: {x: v}, body: {t: {type: tally, of: state.x}}, next: {x: none}}"),
              ElementsAre(HasSubstr("state 'x' needs a value for the next round")));
}

TEST(CompileLoop, RefusesEffectsInItsBody) {
  EXPECT_THAT(errors_of(R"(
  v: {type: value}
  l:
    type: iterate
    state: {x: v}
    body:
      r: {type: relax, x: state.x, target: v}
      w: {type: write, in: r}
    next: {x: r}
)"),
              ElementsAre("t.yaml:10:7, node 'l.w': a node that writes files cannot stand in a loop (put it after the loop)"));
}

TEST(CompileLoop, SeesACycleThroughItsBody) {
  EXPECT_THAT(errors_of("  v: {type: value}\n  a: {type: add, a: l}\n  l: {type: iterate, state: {x: v}, body: {r: {type: relax, x: state.x, target: "
                        "a}}, next: {x: r}}"),
              ElementsAre(HasSubstr("a cycle: a -> l -> l.r -> a")));
}

TEST(CompileLoop, CapturesThroughTwoLoopsOnce) {
  const auto plan = plan_of(R"(
  v: {type: value}
  far: {type: value, value: 8}
  outer:
    type: iterate
    state: {x: v}
    body:
      mid: {type: add, a: state.x}
      inner:
        type: iterate
        state: {y: mid}
        body:
          r: {type: relax, x: state.y, target: far}
          q: {type: relax, x: r, target: far}
          p: {type: add, a: q, b: state.x}
        next: {y: p}
    next: {x: inner}
)");
  const PlanNode& outer = plan->nodes.back();
  ASSERT_EQ(outer.inputs.size(), 2u);  // x and far
  EXPECT_THAT(outer.inputs[1], ElementsAre(plan->find("far")));
  EXPECT_THAT(plan_text(*plan, *make_serial_executor()), AllOf(HasSubstr("target <- far.value"), HasSubstr("b <- state.x")));
}

TEST(CompileLoop, KeyChangesWithItsBody) {
  const auto key = [](const std::string& inside) {
    const auto plan = plan_of("  v: {type: value}\n  l: {type: iterate, state: {x: v}, body: {r: {type: relax, x: state.x, target: v" + inside);
    return plan->nodes.back().static_key;
  };
  const Key plain = key("}}, next: {x: r}}");
  EXPECT_EQ(plain, key("}}, next: {x: r}}"));
  EXPECT_NE(plain, key(", rate: 0.1}}, next: {x: r}}"));
  EXPECT_NE(plain, key("}, s: {type: add, a: r}}, next: {x: r}}"));
  EXPECT_NE(plain, key("}}, next: {x: state.x}}"));
  EXPECT_NE(plain, key("}}, next: {x: r}, max_iterations: 3}"));
}

TEST(PlanDump, SaysWhatDependsOnWhatAndWhen) {
  const auto plan = plan_of(std::string(kLoop) + "  f: {type: frame}\n  g: {type: add, a: f, b: l}\n");
  const std::string text = plan_text(*plan, *make_serial_executor());
  EXPECT_THAT(text, AllOf(HasSubstr("v (value): on host, once"), HasSubstr("f (frame): on host, every frame"),
                          HasSubstr("w (write): on host, every frame, writes"), HasSubstr("l.r (relax): on serial, every round"),
                          HasSubstr("next x <- l.r.x")));
  const std::string dot = plan_dot(*plan);
  EXPECT_THAT(dot, AllOf(StartsWith("digraph knead {"), HasSubstr("\"v\" -> \"l\""), HasSubstr("subgraph \"cluster_l\""), HasSubstr("shape=note")));
  EXPECT_EQ(std::count(dot.begin(), dot.end(), '{'), std::count(dot.begin(), dot.end(), '}'));
}

TEST(PlanDump, ShowsTransfersToADevice) {
  const auto plan = plan_of("  v: {type: value}\n  d: {type: device_add, in: v}\n  e: {type: device_add, in: d}\n  a: {type: add, a: e}");
  fake_device::FakeDevice fake;
  EXPECT_THAT(plan_text(*plan, fake.executor), AllOf(HasSubstr("in <- v.value  [transfer host -> fake]"), HasSubstr("in <- d.sum\n"),
                                                     HasSubstr("a <- e.sum  [transfer fake -> host]")));
}

}  // namespace compile_test
}  // namespace knead
