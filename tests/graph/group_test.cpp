// Groups: graphs used as nodes.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "io/graph_file.h"
#include "tests/graph/toys.h"

namespace knead {
namespace group_test {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

using Files = std::map<std::string, std::string>;

const char* const kBlend = R"(knead: 1
inputs:
  a: Numbers
  b: {type: Numbers, optional: true}
  more: {type: Numbers, many: true, optional: true}
parameters:
  offset: 10
  scale: {default: 2, doc: of the frame}
nodes:
  sum: {type: add, a: inputs.a, b: inputs.b, offset: $offset}
  rest: {type: sum, of: [sum, inputs.more]}
  f: {type: frame, scale: $scale}
outputs: {total: rest, frame: f, plain: sum.sum}
)";

CompileOptions with(const Files& files, const std::vector<std::pair<std::string, Literal>>& overrides = {}) {
  CompileOptions options = toys::options();
  options.load_group = [files](const std::string& path) {
    const auto found = files.find(path);
    if (found == files.end()) throw Error(ErrorCode::kFile, {path, 0, 0, {}, {}}, "there is no such file");
    return read_graph_text(found->second, path);
  };
  options.overrides = overrides;
  return options;
}

std::shared_ptr<const Plan> plan_of(const std::string& nodes, const Files& files = {{"blend", kBlend}},
                                    const std::vector<std::pair<std::string, Literal>>& overrides = {}) {
  GraphSpec spec = read_graph_text("knead: 1\nnodes:\n" + nodes, "t.yaml");
  for (NodeSpec& node : spec.nodes)  // the reader has resolved paths against the file's folder, which is none
    for (auto& [key, value] : node.arguments)
      if (key.text() == "\"path\"" && value.as_string()) value = Literal(value.as_string()->substr(value.as_string()->rfind('/') + 1));
  return compile(spec, with(files, overrides));
}

std::vector<std::string> errors_of(const std::string& nodes, const Files& files = {{"blend", kBlend}},
                                   const std::vector<std::pair<std::string, Literal>>& overrides = {}) {
  try {
    plan_of(nodes, files, overrides);
  } catch (const GraphErrors& errors) {
    std::vector<std::string> texts;
    for (const Error& error : errors.errors()) texts.push_back(error.what());
    return texts;
  }
  return {};
}

double value_of(const std::shared_ptr<const Plan>& plan, const std::string& output, int frame = 1) {
  EvaluatorOptions options;
  const auto serial = make_serial_executor();
  options.executor = serial.get();
  return toys::first(Evaluator(plan, options).get<toys::Numbers>(output, frame));
}

TEST(Group, PutsItsNodesIntoThePlanUnderItsName) {
  const auto plan = plan_of("  v: {type: value, value: 3}\n  g: {type: group, path: blend, a: v}\n  after: {type: add, a: g}");
  std::vector<std::string> names;
  for (const PlanNode& node : plan->nodes) names.push_back(node.name);
  EXPECT_THAT(names, ElementsAre("v", "g.sum", "g.rest", "g.f", "after"));
  EXPECT_EQ(value_of(plan, "g"), 13);
  EXPECT_EQ(value_of(plan, "g.total"), 13);
  EXPECT_EQ(value_of(plan, "g.frame", 5), 10);
  EXPECT_EQ(value_of(plan, "g.sum"), 13);
  EXPECT_EQ(value_of(plan, "after"), 13);
}

TEST(Group, TakesOptionalInputsListsAndParameters) {
  const auto plan = plan_of("  v: {type: value, value: 3}\n  g: {type: group, path: blend, a: v, b: v, more: [v, v], offset: 0, scale: 7}");
  EXPECT_EQ(value_of(plan, "g"), 12);
  EXPECT_EQ(value_of(plan, "g.frame", 2), 14);
}

TEST(Group, CanBeUsedTwiceWithDifferentParameters) {
  const auto plan = plan_of("  v: {type: value}\n  g: {type: group, path: blend, a: v}\n  h: {type: group, path: blend, a: g, offset: 100}");
  EXPECT_EQ(value_of(plan, "h"), 111);
}

TEST(Group, NestsAndHandsParametersDown) {
  const Files files{{"blend", kBlend}, {"outer", R"(knead: 1
inputs: {in: Numbers}
parameters: {by: 4}
nodes:
  one: {type: group, path: blend, a: inputs.in, offset: $by}
  two: {type: group, path: blend, a: one, offset: $by}
outputs: {out: two}
)"}};
  EXPECT_EQ(value_of(plan_of("  v: {type: value}\n  g: {type: group, path: outer, in: v}", files), "g"), 9);
  EXPECT_EQ(value_of(plan_of("  v: {type: value}\n  g: {type: group, path: outer, in: v, by: 1}", files), "g"), 3);
}

TEST(Group, StandsInALoopAndHoldsOne) {
  EXPECT_EQ(value_of(plan_of(R"(
  v: {type: value}
  l:
    type: iterate
    max_iterations: 3
    state: {x: v}
    body:
      g: {type: group, path: blend, a: state.x, b: v, offset: 0}
    next: {x: g}
)"),
                     "l"),
            4);
  const Files files{{"loop", R"(knead: 1
inputs: {start: Numbers, step: Numbers}
parameters: {rounds: 5}
nodes:
  l: {type: iterate, max_iterations: $rounds, state: {x: inputs.start}, body: {a: {type: add, a: state.x, b: inputs.step, offset: $rounds}}, next: {x: a}}
outputs: {x: l}
)"}};
  EXPECT_EQ(value_of(plan_of("  v: {type: value}\n  g: {type: group, path: loop, start: v, step: v, rounds: 2}", files), "g"), 1 + 2 * (1 + 2));
}

TEST(Group, MayBeBuiltIn) {
  Registry registry;
  toys::put<toys::ValueNode>(registry, "value");
  toys::put<toys::Add>(registry, "add");
  registry.add({"twice", 1, "a + a", nullptr, [] {
                  GraphSpec graph;
                  graph.inputs.push_back({"path", "Numbers", false, false, ""});  // no name is taken
                  graph.add("sum", "add", {{"a", "inputs.path"}, {"b", "inputs.path"}});
                  graph.outputs.emplace_back("sum", "sum");
                  return graph;
                }});
  GraphSpec graph;
  graph.add("v", "value", {{"value", 21}}).add("t", "twice", {{"path", "v"}});
  CompileOptions options;
  options.registry = &registry;
  EXPECT_EQ(value_of(compile(graph, options), "t"), 42);
}

TEST(Group, SaysWhatIsWrongWithItsUse) {
  EXPECT_THAT(errors_of("  v: {type: value}\n  s: {type: spell, in: v}\n  g: {type: group, path: blend, aa: v, b: s, ofset: 2}"),
              ElementsAre("t.yaml:5:3, node 'g', 'a': this input must be connected (it takes a Numbers)",
                          "t.yaml:5:33, node 'g', 'aa': the node has no such input or parameter (did you mean 'a'?)",
                          "t.yaml:5:43, node 'g', 'b': expected a Numbers, but 's' is a Word (did you mean 's.number'?)",
                          "t.yaml:5:46, node 'g', 'ofset': the node has no such input or parameter (did you mean 'offset'?)"));
  EXPECT_THAT(errors_of("  v: {type: value}\n  g: {type: group, path: blend, a: [v, v]}\n  b: {type: add, a: g.totl}"),
              ElementsAre(HasSubstr("takes one value"), HasSubstr("'g' has no output 'totl' (did you mean 'total'?)")));
  EXPECT_THAT(errors_of("  g: {type: group, path: nowhere}\n  h: {type: group}\n  a: {type: add, a: g, b: h.x}"),
              ElementsAre(HasSubstr("nowhere, node 'g': there is no such file"), HasSubstr("node 'h': a group needs `path:`")));
}

TEST(Group, NamesThePlaceWhereAParameterWasGiven) {
  const Files files{
      {"inner",
       "knead: 1\ninputs: {a: Numbers}\nparameters: {by: 1}\nnodes:\n  s: {type: add, a: inputs.a, offset: $by}\n  t: {type: add, a: s, "
       "offset: $by}\noutputs: {t: t}\n"},
      {"outer",
       "knead: 1\ninputs: {a: Numbers}\nparameters: {much: 1}\nnodes:\n  i: {type: group, path: inner, a: inputs.a, by: $much}\noutputs: {i: i}\n"}};
  EXPECT_THAT(errors_of("  v: {type: value}\n  g: {type: group, path: outer, a: v, much: lots}\n  h: {type: add, a: g}", files),
              ElementsAre(HasSubstr("t.yaml:4:45, node 'g', 'much': expected a number, found a text")));
}

TEST(Group, NamesItsOwnFileForWhatIsWrongInside) {
  const Files files{{"bad",
                     "knead: 1\ninputs: {a: Numbers}\nparameters: {offset: 1}\nnodes:\n  s: {type: ad, a: inputs.a}\n  t: {type: add, a: inputs.b, "
                     "offset: $ofset}\noutputs: {x: s, y: u}\n"}};
  EXPECT_THAT(errors_of("  v: {type: value}\n  g: {type: group, path: bad, a: v}\n  h: {type: add, a: g}", files),
              ElementsAre(HasSubstr("bad:5:3, node 'g.s': unknown node type 'ad'"),
                          HasSubstr("bad:6:21, node 'g.t', 'a': 'inputs' has no output 'b' (did you mean 'a'?)"),
                          HasSubstr("bad:6:39, node 'g.t': the graph has no parameter 'ofset' (did you mean 'offset'?)"),
                          HasSubstr("bad:7:20, node 'g.outputs', 'y': there is no node 'u'")));
}

TEST(Group, SeesNothingOfTheGraphThatUsesIt) {
  const Files files{{"peeks", "knead: 1\nnodes:\n  a: {type: add, a: v}\noutputs: {x: a}\n"}};
  EXPECT_THAT(errors_of("  v: {type: value}\n  g: {type: group, path: peeks}", files), ElementsAre(HasSubstr("there is no node 'v'")));
}

TEST(Group, DoesNotUseItselfOrAThousandOthers) {
  const Files loop{{"self", "knead: 1\nnodes: {g: {type: group, path: self}, h: {type: group, path: self}}\noutputs: {x: g}\n"}};
  EXPECT_THAT(errors_of("  g: {type: group, path: self}", loop),
              ElementsAre(HasSubstr("group 'self' uses itself"), HasSubstr("group 'self' uses itself")));
  Files bomb;
  for (int i = 0; i < 12; ++i) {
    const std::string next = "b" + std::to_string(i + 1);
    std::string nodes;
    for (int k = 0; k < 10; ++k) nodes += "  g" + std::to_string(k) + ": {type: group, path: " + next + "}\n";
    bomb["b" + std::to_string(i)] = "knead: 1\nnodes:\n" + nodes;
  }
  bomb["b12"] = "knead: 1\nnodes: {v: {type: value}}\n";
  EXPECT_THAT(errors_of("  g: {type: group, path: b0}", bomb), ElementsAre(HasSubstr("more than 10000 groups")));
}

TEST(Group, LetsValuesFromTheCommandLineIn) {
  const std::string graph = "  v: {type: value}\n  g: {type: group, path: blend, a: v, offset: 1}";
  EXPECT_EQ(value_of(plan_of(graph, {{"blend", kBlend}}, {{"g.offset", 5}}), "g"), 6);
  EXPECT_EQ(value_of(plan_of(graph, {{"blend", kBlend}}, {{"g.scale", 5}}), "g.frame", 2), 10);
  EXPECT_EQ(value_of(plan_of(graph, {{"blend", kBlend}}, {{"g.f.scale", 5}}), "g.frame", 2), 10);
  EXPECT_THAT(errors_of(graph, {{"blend", kBlend}}, {{"g.f.scal", 5}, {"g.ofset", 1}}),
              ElementsAre(HasSubstr("--set, node 'g', 'ofset': the node has no such"),
                          HasSubstr("--set, 'g.f.scal': no node has this parameter (did you mean 'g.f.scale'?)")));
  EXPECT_THAT(errors_of("  g: {type: group, path: nowhere}", {}, {{"g.f.scal", 5}}), ElementsAre(HasSubstr("no such file")));
}

TEST(Group, IsNotAGraphToRunWhenItNeedsInputs) {
  try {
    compile(read_graph_text(kBlend, "blend.yaml"), toys::options());
    FAIL();
  } catch (const GraphErrors& errors) {
    ASSERT_EQ(errors.errors().size(), 1u);
    EXPECT_THAT(errors.what(), AllOf(HasSubstr("blend.yaml"), HasSubstr("made to be used as a group")));
  }
}

TEST(Group, OutputsOfTheGraphThatIsRunCanBeAskedFor) {
  const auto spec = read_graph_text("knead: 1\nparameters: {p: 6}\nnodes: {v: {type: value, value: $p}}\noutputs: {answer: v}\n", "t.yaml");
  EXPECT_EQ(value_of(compile(spec, toys::options()), "answer"), 6);
}

}  // namespace group_test
}  // namespace knead
