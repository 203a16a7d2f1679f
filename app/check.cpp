#include <fmt/format.h>

#include <set>

#include "app/common.h"
#include "graph/evaluator.h"

namespace knead::app {
namespace {

// Files that cannot be read now, in the first and the last frame. They may be there by the time of the run, so the graph is not wrong.
std::vector<std::string> missing_inputs(const Plan& plan) {
  std::vector<std::string> lines;
  std::set<std::string> told;
  const std::set<int> frames{plan.frames.empty() ? 1 : plan.frames.front(), plan.frames.empty() ? 1 : plan.frames.back()};
  for (const int frame : frames)
    for (const PlanNode& node : plan.nodes) try {
        Hasher ignored;
        node.node->add_to_key(ignored, frame);
      } catch (const Error&) {
        const std::string line = error_in_flight(node.where).what();
        if (told.insert(line).second) lines.push_back(line);
      }
  return lines;
}

}  // namespace

int check(const GraphArguments& arguments) {
  const auto plan = load_plan(arguments);
  std::vector<std::string> warnings = unused_nodes(*plan);
  for (const std::string& line : missing_inputs(*plan)) warnings.push_back(line);
  for (const std::string& line : warnings) fmt::print("{} (warning)\n", line);
  fmt::print("{}: no errors, {} warning{}, {} nodes\n", arguments.graph, warnings.size(), warnings.size() == 1 ? "" : "s", plan->nodes.size());
  return kGood;
}

}  // namespace knead::app
