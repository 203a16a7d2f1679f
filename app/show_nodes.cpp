#include <fmt/format.h>

#include "app/common.h"
#include "io/schema.h"
#include "io/stats.h"

namespace knead::app {

int show_nodes(const std::string& name, bool schema, bool figures_schema, bool markdown) {
  const Registry& registry = Registry::builtin();
  if (schema) {
    fmt::print("{}", graph_schema(registry));
  } else if (figures_schema) {
    fmt::print("{}", stats_schema());
  } else if (markdown) {
    fmt::print("{}", nodes_markdown(registry));
  } else if (name.empty()) {
    fmt::print("{}\n`knead nodes NAME` shows a node's page.\n", node_list(registry));
  } else if (const NodeType* type = registry.find(name)) {
    fmt::print("{}", manual_page(*type));
  } else {
    const std::string near = nearest_name(name, registry.names());
    throw UsageError(
        fmt::format("there is no node type '{}'{}", name, near.empty() ? "; `knead nodes` lists them" : "; did you mean '" + near + "'?"));
  }
  return kGood;
}

}  // namespace knead::app
