// A graph as it was written, before any check: node names, types and arguments, each with its place. Made by io/graph_file.h from YAML or by C++
// calls:
//
//   GraphSpec graph;
//   graph.add("ball", "primitive", {{"shape", "sphere"}});
//   graph.add("solid", "mesh_to_sdf", {{"mesh", "ball"}});        // a reference: "node" (its first output) or "node.output"
#pragma once
#include <string>
#include <utility>
#include <vector>

#include "graph/error.h"
#include "graph/literal.h"

namespace knead {

struct NodeSpec {
  std::string name;
  std::string type;
  Literal::Map arguments;  // everything but `type`
  int line = 0, column = 0;
};

struct GroupInputSpec {
  std::string name;
  std::string type;  // "Surface", ...
  bool optional = false;
  bool many = false;
  std::string doc;
};
struct GroupParameterSpec {
  std::string name;
  Literal value;  // default
  std::string doc;
};

struct KNEAD_API GraphSpec {
  std::string file;  // named in errors; relative paths in it are relative to its folder
  std::string description;
  std::vector<int> frames{1};  // what `knead run` does by default
  std::vector<NodeSpec> nodes;
  // When the graph is used as a node (`type: group`): what stands behind `inputs.NAME` and `$NAME` in its nodes, and what `group.NAME` means outside.
  std::vector<GroupInputSpec> inputs;
  std::vector<GroupParameterSpec> parameters;
  std::vector<std::pair<std::string, Literal>> outputs;

  GraphSpec& add(std::string name, std::string type, Literal::Map arguments = {});

  // Reads the tree of a whole graph file. Throws GraphErrors with everything wrong in its layout.
  static GraphSpec from_literal(const Literal& tree, const std::string& file);
};

// The nodes of a `nodes:` or `body:` map. Adds to `errors` what is wrong with the layout.
std::vector<NodeSpec> node_specs(const Literal& tree, const std::string& file, std::vector<Error>& errors);

// "1-48", "1-48x2,60", 7 or a list of these, in order. Throws Error(kGraph) with what was expected. At most a million frames.
KNEAD_API std::vector<int> parse_frames(const Literal& literal);

}  // namespace knead
