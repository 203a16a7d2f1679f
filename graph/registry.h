// Node types by name.
#pragma once
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "graph/node.h"
#include "graph/spec.h"

namespace knead {

struct NodeType {
  std::string name;
  int version = 1;                                   // part of every cache key: raise it when the same inputs give another result
  std::string manual;                                // the page shown by `knead nodes NAME`
  std::function<std::unique_ptr<Node>()> make = {};  // may hold what the node is made from: a mesh in memory
  std::function<GraphSpec()> group = {};             // set instead of `make` for a built-in group: a graph used as a node
};

class KNEAD_API Registry {
 public:
  void add(NodeType type);
  const NodeType* find(const std::string& name) const;
  std::vector<std::string> names() const;  // sorted

  static const Registry& builtin();  // iterate, group and everything in nodes/

 private:
  std::map<std::string, NodeType> types_;
};

void register_iterate(Registry& registry);
void register_group(Registry& registry);
void register_all_nodes(Registry& registry);  // generated from the files of nodes/

// One per file of nodes/, where `stem` is the file's stem and the node's name.
#define KNEAD_REGISTER(stem, Class, version, manual)                                                             \
  void register_##stem(Registry& registry) {                                                                     \
    registry.add({#stem, version, manual, [] { return std::unique_ptr<Node>(std::make_unique<Class>()); }, {}}); \
  }

}  // namespace knead
