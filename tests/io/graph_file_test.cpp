#include "io/graph_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <random>

namespace knead {
namespace graph_file_test {

using testing::HasSubstr;

// What is wrong with a text, one line per error; "" when nothing is.
std::string errors_of(const std::string& text) {
  try {
    read_graph_text(text, "press.yaml");
    return "";
  } catch (const Error& error) {
    return error.what();
  }
}

Literal value_of(const std::string& scalar) {
  return *parse_yaml("v: " + scalar, "t.yaml").find("v");
}

std::string tree_of(const std::string& text) {
  return parse_yaml(text, "t.yaml").text();
}

TEST(GraphFile, ReadsScalarsByTheCoreSchema) {
  EXPECT_TRUE(value_of("").is_null());
  EXPECT_TRUE(value_of("~").is_null());
  EXPECT_TRUE(value_of("null").is_null());
  ASSERT_TRUE(value_of("true").as_bool());
  EXPECT_TRUE(*value_of("true").as_bool());
  EXPECT_FALSE(*value_of("False").as_bool());
  EXPECT_EQ(*value_of("-12").as_int(), -12);
  EXPECT_EQ(*value_of("+7").as_int(), 7);
  EXPECT_EQ(*value_of("007").as_int(), 7);
  EXPECT_EQ(*value_of("0x1F").as_int(), 31);
  EXPECT_EQ(*value_of("0o17").as_int(), 15);
  EXPECT_EQ(value_of("99999999999999999999").number(), 1e20);
  for (const auto& [text, number] : {std::pair<const char*, double>{"1e-4", 1e-4},
                                     {"1.", 1},
                                     {".5", 0.5},
                                     {"-.5", -0.5},
                                     {"+0.25E2", 25},
                                     {"1e400", INFINITY},
                                     {"1e-400", 0},
                                     {"-.inf", -INFINITY}})
    EXPECT_EQ(std::get<double>(value_of(text).value), number) << text;
  EXPECT_TRUE(std::isnan(value_of(".nan").number()));
}

TEST(GraphFile, KeepsTextsThatOnlyLookLikeSomethingElse) {
  for (const char* text :
       {"none", "1-48", "yes", "on", "1e", "e5", ".", "-", "+", "1.2.3", "0x", "0xg", "1_000", "nan", "inf", "12:30:00", "2020-01-01", "-0x10"})
    EXPECT_EQ(value_of(std::string(text) == "-" ? "'-'" : text).text(), "\"" + std::string(text) + "\"") << text;
  for (const char* text : {"'12'", "\"true\"", "'~'", "!!str 12"}) EXPECT_TRUE(value_of(text).as_string()) << text;
}

TEST(GraphFile, ReadsJson) {
  EXPECT_EQ(tree_of(R"({"knead":1,"nodes":{"a":{"type":"t","list":[1,2.5,"x",null,true]}},"s":"\u00e4\n"})"),
            R"({"knead": 1, "nodes": {"a": {"type": "t", "list": [1, 2.5, "x", null, true]}}, "s": "ä\n"})");
}

TEST(GraphFile, GivesEveryLiteralItsPlace) {
  const Literal tree = parse_yaml("knead: 1\nnodes:\n  ball: {type: primitive,\n         radius: 2.5}\n  list:\n    - 1\n    - [a, b]\n", "t.yaml");
  const auto expect_place = [](const Literal& literal, int line, int column) {
    EXPECT_EQ(literal.line, line) << literal.text();
    EXPECT_EQ(literal.column, column) << literal.text();
  };
  expect_place(tree, 1, 1);
  const Literal& nodes = *tree.find("nodes");
  expect_place(nodes, 3, 3);
  expect_place(nodes.as_map()->at(0).first, 3, 3);
  expect_place(nodes.as_map()->at(0).second, 3, 9);
  expect_place(nodes.as_map()->at(0).second.as_map()->at(1).first, 4, 10);
  expect_place(nodes.as_map()->at(0).second.as_map()->at(1).second, 4, 18);
  const Literal::List& list = *nodes.as_map()->at(1).second.as_list();
  expect_place(list[0], 6, 7);
  expect_place(list[1].as_list()->at(1), 7, 11);
}

TEST(GraphFile, CountsColumnsInCharacters) {
  const Literal tree = parse_yaml("{ä: ö, b: 12}", "t.yaml");
  EXPECT_EQ(tree.find("b")->column, 11);
}

TEST(GraphFile, NamesThePlaceOfAnError) {
  EXPECT_THAT(errors_of("knead: 1\nnodes:\n  a: {type: x\n  b: 2\n"), HasSubstr("press.yaml:4:"));
  EXPECT_THAT(errors_of("knead: 1\nnodes:\n  a: {type: x}\n  a: {type: y}\n"), HasSubstr("press.yaml:4:3: the key \"a\" is there twice"));
  EXPECT_THAT(errors_of("knead: 1\nnodes:\n  a: {type: x, size: 1, size: 2}\n"), HasSubstr("press.yaml:3:25: the key \"size\" is there twice"));
  EXPECT_THAT(errors_of("knead: 2\nnodes: {}\n"), HasSubstr("press.yaml:1:8:"));
  EXPECT_THAT(errors_of("knead: 1\nnods: {}\n"), testing::AllOf(HasSubstr("press.yaml:2:1: unknown key 'nods'"), HasSubstr("did you mean 'nodes'?")));
  EXPECT_THAT(errors_of("knead: 1\nnodes:\n  a: !thing {type: x}\n  b: !thing c\n"), HasSubstr("press.yaml:4:6: the tag '!thing'"));
}

TEST(GraphFile, ReportsSeveralErrorsAtOnce) {
  try {
    parse_yaml("a: {b: 1, b: 2}\nc: 3\nc: 4\n", "t.yaml");
    FAIL() << "expected errors";
  } catch (const GraphErrors& errors) {
    EXPECT_EQ(errors.errors().size(), 2u) << errors.what();
  }
}

TEST(GraphFile, RefusesWhatIsNoGraph) {
  EXPECT_NE(errors_of(""), "");
  EXPECT_NE(errors_of("# only a comment\n"), "");
  EXPECT_NE(errors_of("just text"), "");
  EXPECT_NE(errors_of("[1, 2]"), "");
  EXPECT_NE(errors_of("? [a]\n: b\n"), "");
  EXPECT_NE(errors_of(std::string("knead: 1\n\0nodes: {}", 20)), "");
  EXPECT_THAT(errors_of("knead: 1\nnodes: {}\n---\nknead: 1\n"), HasSubstr("second document"));
  EXPECT_THAT(errors_of("knead: 1\nnodes: *nowhere\n"), HasSubstr("press.yaml:2:8"));
}

TEST(GraphFile, FollowsAnchorsAndMergeKeys) {
  EXPECT_EQ(tree_of("a: &soft {s: 0.3, n: 2}\nb: {<<: *soft, n: 5}\nc: *soft\n"),
            R"({"a": {"s": 0.3, "n": 2}, "b": {"n": 5, "s": 0.3}, "c": {"s": 0.3, "n": 2}})");
  EXPECT_EQ(tree_of("a: &a {x: 1}\nb: &b {x: 2, y: 3}\nc: {<<: [*a, *b]}\n"), R"({"a": {"x": 1}, "b": {"x": 2, "y": 3}, "c": {"x": 1, "y": 3}})");
  EXPECT_EQ(tree_of("{'<<': 1}"), R"({"<<": 1})");
  EXPECT_THROW(tree_of("{<<: 1}"), GraphErrors);
  EXPECT_THROW(tree_of("a: &a [*a]"), GraphErrors);
}

TEST(GraphFile, RefusesAliasBombs) {
  std::string bomb = "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n";
  for (int i = 1; i < 12; ++i) {
    const std::string before = "*a" + std::to_string(i - 1);
    bomb += "a" + std::to_string(i) + ": &a" + std::to_string(i) + " [" + before;
    for (int k = 0; k < 9; ++k) bomb += ", " + before;
    bomb += "]\n";
  }
  EXPECT_THAT(errors_of(bomb), HasSubstr("aliases of aliases"));
  std::string chain = "a0: &a0 [x]\n";
  for (int i = 1; i < 300; ++i) chain += "a" + std::to_string(i) + ": &a" + std::to_string(i) + " [*a" + std::to_string(i - 1) + "]\n";
  EXPECT_THAT(errors_of(chain), HasSubstr("levels deep"));
}

TEST(GraphFile, RefusesDeepTrees) {
  for (const int depth : {200, 100000}) {
    EXPECT_NE(errors_of(std::string(static_cast<size_t>(depth), '[')), "");
    EXPECT_NE(errors_of(std::string(static_cast<size_t>(depth), '[') + std::string(static_cast<size_t>(depth), ']')), "");
  }
}

TEST(GraphFile, SurvivesMangledTexts) {
  const std::string good =
      "knead: 1\nframes: 1-48\nnodes:\n  a: &x {type: t, list: [1, 'two', \"three\"], k: {1: [0, 0, 2]}}\n  b: {<<: *x, path: out/h.####.obj}\n  c: "
      "|\n    text\n";
  std::mt19937 random(7);
  int refused = 0;
  for (int round = 0; round < 2000; ++round) {
    std::string text = good;
    const int edits = 1 + static_cast<int>(random() % 4);
    for (int e = 0; e < edits; ++e) {
      const size_t at = random() % text.size();
      switch (random() % 3) {
        case 0: text[at] = static_cast<char>(random() % 256); break;
        case 1: text.erase(at, 1 + random() % 8); break;
        default: text.insert(at, 1, "{}[]:,&*!|>'\"\n\t -?"[random() % 18]); break;
      }
      if (text.empty()) text = " ";
    }
    try {
      parse_yaml(text, "t.yaml");
    } catch (const GraphErrors&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, 100);
}

TEST(GraphFile, TakesPathsFromTheFilesFolder) {
  const GraphSpec spec = read_graph_text(
      "knead: 1\nnodes:\n  a: {type: read_mesh, path: m.obj}\n  b: {type: read_mesh, path: /abs/m.obj}\n  c: {type: write_mesh, path: out/h.obj}\n"
      "  d: {type: iterate, body: {e: {type: read_vdb, path: s.vdb}, f: {type: write_mesh, path: w.obj}}}\n  g: {type: read_mesh, path: $file}\n",
      "scenes/press.yaml", "results");
  const auto path_of = [&](size_t i) { return Literal(spec.nodes[i].arguments).find("path")->text(); };
  EXPECT_EQ(path_of(0), "\"scenes/m.obj\"");
  EXPECT_EQ(path_of(1), "\"/abs/m.obj\"");
  EXPECT_EQ(path_of(2), "\"results/out/h.obj\"");
  EXPECT_EQ(path_of(4), "\"$file\"");
  const Literal body = *Literal(spec.nodes[3].arguments).find("body");
  EXPECT_EQ(body.find("e")->find("path")->text(), "\"scenes/s.vdb\"");
  EXPECT_EQ(body.find("f")->find("path")->text(), "\"results/w.obj\"");
}

TEST(GraphFile, NamesAFileThatCannotBeRead) {
  const auto error_of = [](const std::string& path) -> std::string {
    try {
      read_graph_file(path);
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ErrorCode::kFile);
      return error.what();
    }
    return "";
  };
  EXPECT_THAT(error_of("/no/such/graph.yaml"), HasSubstr("/no/such/graph.yaml: no such file"));
  EXPECT_THAT(error_of(std::filesystem::temp_directory_path().string()), HasSubstr("folder"));
  EXPECT_THAT(error_of("/dev/zero"), HasSubstr("larger than"));
}

TEST(GraphFile, NamesTheTabThatIndentsALine) {
  for (const char* text : {"knead: 1\nnodes:\n\ta: {type: primitive}\n", "knead: 1\nnodes:\n  a:\n  \ttype: primitive\n",
                           "knead: 1\nnodes:\n  a:\n\t  type: primitive\n"})
    EXPECT_THAT(errors_of(text), testing::AllOf(HasSubstr("indented by a tab"), HasSubstr("indent by spaces"))) << text;
  EXPECT_THAT(errors_of("knead: 1\nnodes:\n\ta: {type: primitive}\n"), HasSubstr("press.yaml:3:1"));
}

TEST(GraphFile, LetsAnEditorsSchemaStand) {
  EXPECT_EQ(errors_of(R"({"$schema": "knead.schema.json", "knead": 1, "nodes": {"a": {"type": "primitive"}}})"), "");
}

}  // namespace graph_file_test
}  // namespace knead
