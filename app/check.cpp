#include <fmt/format.h>

#include "app/common.h"

namespace knead::app {

int check(const GraphArguments& arguments) {
  const auto plan = load_plan(arguments);
  const std::vector<std::string> unused = unused_nodes(*plan);
  for (const std::string& line : unused) fmt::print("{} (warning)\n", line);
  fmt::print("{}: no errors, {} warning{}, {} nodes\n", arguments.graph, unused.size(), unused.size() == 1 ? "" : "s", plan->nodes.size());
  return kGood;
}

}  // namespace knead::app
