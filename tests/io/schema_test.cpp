#include "io/schema.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <sstream>

#include "graph/report.h"

namespace knead {
namespace schema_test {

using Json = nlohmann::json;
using testing::HasSubstr;
using testing::Not;

// A toy with one of everything that can be declared.
class Toy : public Node {
 public:
  In<Scalar> value{this, "value", {.unit = "apples", .doc = "what to double"}};
  OptionalIn<Scalar> extra{this, "extra", {.doc = "added when there"}};
  ManyIn<Scalar> more{this, "more", {.doc = "all of these too"}};
  Param<double> factor{this, "factor", 2.0, {.min = 0, .max = 9, .unit = "times", .doc = "how much"}};
  Param<std::string> kind{this, "kind", "soft", {.choices = {"soft", "hard"}, .doc = "which"}};
  Param<Literal> keys{this, "keys", Literal{}, {.doc = "a structure"}};
  Out<Scalar> result{this, "result", {.doc = "the double"}};
  void evaluate(Context&) const override {}
};

Registry toys() {
  Registry registry;
  registry.add({"toy", 1, "Doubles | or more.\n\nSecond paragraph.", [] { return std::unique_ptr<Node>(std::make_unique<Toy>()); }, {}});
  registry.add({"pair", 1, "Two toys in one", nullptr, [] {
                  GraphSpec group;
                  group.inputs = {{"value", "Scalar", false, false, "what comes in"}, {"side", "Scalar", true, true, "more"}};
                  group.parameters = {{"factor", 3, "of both"}};
                  group.outputs = {{"result", "b.result"}};
                  return group;
                }});
  return registry;
}

TEST(Schema, DescribesEveryPortAndParameter) {
  const Json schema = Json::parse(graph_schema(toys()));
  const Json toy = schema.at("definitions").at("node_toy");
  const Json properties = toy.at("properties");
  EXPECT_EQ(properties.at("type").at("const"), "toy");
  for (const char* name : {"value", "extra", "more", "factor", "kind", "keys"}) EXPECT_TRUE(properties.contains(name)) << name;
  EXPECT_FALSE(properties.contains("result")) << "outputs are not given";
  EXPECT_EQ(toy.at("required"), Json({"type", "value"}));
  EXPECT_EQ(toy.at("additionalProperties"), false);
  EXPECT_EQ(properties.at("factor").at("default"), 2.0);
  EXPECT_EQ(properties.at("factor").at("anyOf").at(0).at("maximum"), 9.0);
  EXPECT_EQ(properties.at("kind").at("anyOf").at(0).at("enum"), Json({"soft", "hard"}));
  EXPECT_THAT(properties.at("factor").at("description").get<std::string>(), HasSubstr("how much"));
  EXPECT_EQ(properties.at("more").at("anyOf").at(1).at("type"), "array");
}

TEST(Schema, DescribesGroupsLikeNodes) {
  const Json pair = Json::parse(graph_schema(toys())).at("definitions").at("node_pair");
  EXPECT_EQ(pair.at("required"), Json({"type", "value"}));
  EXPECT_EQ(pair.at("properties").at("factor").at("default"), 3);
  EXPECT_TRUE(pair.at("properties").contains("side"));
}

TEST(Schema, ListsAndDefinesEveryBuiltinType) {
  const Json schema = Json::parse(graph_schema(Registry::builtin()));
  EXPECT_EQ(schema.at("$schema"), "http://json-schema.org/draft-07/schema#");
  EXPECT_EQ(schema.at("properties").at("knead").at("const"), 1);
  const Json types = schema.at("definitions").at("node").at("properties").at("type").at("enum");
  EXPECT_EQ(types, Json(Registry::builtin().names()));
  for (const Json& type : types) EXPECT_TRUE(schema.at("definitions").contains("node_" + type.get<std::string>())) << type;
}

TEST(Schema, KnowsThatLoopsHoldNodes) {
  const Json iterate = Json::parse(graph_schema(Registry::builtin())).at("definitions").at("node_iterate");
  EXPECT_EQ(iterate.at("properties").at("body").at("$ref"), "#/definitions/nodes");
  for (const char* name : {"state", "body", "next"}) EXPECT_THAT(iterate.at("required"), testing::Contains(name));
}

TEST(Schema, ResolvesAllItsReferences) {
  const Json schema = Json::parse(graph_schema(Registry::builtin()));
  int references = 0;
  const std::function<void(const Json&)> walk = [&](const Json& at) {
    if (at.is_object() && at.contains("$ref")) {
      ++references;
      const std::string target = at["$ref"].get<std::string>();
      EXPECT_TRUE(schema.contains(Json::json_pointer(target.substr(1)))) << target;
    }
    if (at.is_structured())
      for (const Json& item : at) walk(item);
  };
  walk(schema);
  EXPECT_GT(references, static_cast<int>(Registry::builtin().names().size()));
}

TEST(ManualPage, TellsEverythingThatIsDeclared) {
  const Registry registry = toys();
  const std::string page = manual_page(*registry.find("toy"));
  for (const char* text : {"toy\n", "Second paragraph.", "value ", "Scalar [apples]", "what to double", "Scalar, optional", "Scalar, many",
                           "default 2, 0 to 9 [times]", "one of: soft hard", "result"})
    EXPECT_THAT(page, HasSubstr(text));
  EXPECT_THAT(manual_page(*registry.find("pair")), HasSubstr("default 3"));
}

TEST(ManualPage, IsThereForEveryBuiltinType) {
  for (const std::string& name : Registry::builtin().names()) {
    const NodeType& type = *Registry::builtin().find(name);
    EXPECT_GT(node_title(type).size(), 10u) << name;
    EXPECT_THAT(node_title(type), Not(HasSubstr("\n"))) << name;
    EXPECT_GT(manual_page(type).size(), type.manual.size()) << name;
  }
}

TEST(NodeTable, HasARowForEveryType) {
  const Registry registry = toys();
  const std::string table = nodes_markdown(registry);
  EXPECT_THAT(table, HasSubstr("| [`toy`](#toy) | Doubles \\| or more | `value`, `extra`?, `more`... | `result` |"));
  EXPECT_THAT(table, HasSubstr("| [`pair`](#pair) | Two toys in one | `value`, `side`... | `result` |"));
  EXPECT_THAT(node_list(registry), HasSubstr("toy                Doubles | or more\n"));
}

}  // namespace schema_test
}  // namespace knead
