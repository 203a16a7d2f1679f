#include <fmt/format.h>

#include <filesystem>

#include "app/common.h"
#include "app/outputs.h"
#include "app/placement.h"
#include "io/files.h"

namespace knead::app {
namespace {

// Input files that are not there in some frame. Those of the first frames are read and tell more by themselves.
std::vector<std::string> missing_inputs(const Plan& plan) {
  std::vector<std::string> lines;
  for (const PlanNode& node : plan.nodes) {
    const std::string path = path_of(*node.node);
    if (path.empty() || node.node->has_effect() || !has_frame_pattern(path)) continue;
    std::vector<int> missing;
    for (const int frame : plan.frames)
      if (std::error_code failed; !std::filesystem::exists(frame_path(path, frame), failed)) missing.push_back(frame);
    if (!missing.empty())
      lines.push_back(
          fmt::format("{}: '{}' is not there at frame{} {}", node.where.text(), path, missing.size() == 1 ? "" : "s", frames_text(missing)));
  }
  return lines;
}

}  // namespace

int check(const GraphArguments& arguments) {
  const auto plan = load_plan(arguments);
  const std::vector<std::string> unused = unused_nodes(*plan), missing = missing_inputs(*plan);
  Evaluator evaluator(plan);
  const Placement placement = find_placement(evaluator, plan->frames);
  fmt::print("{}", placement_text(placement, plan->frames.size()));
  const size_t warnings = unused.size() + placement.warnings.size(), errors = missing.size() + placement.errors.size();
  for (const auto* lines : {&unused, &placement.warnings})
    for (const std::string& line : *lines) fmt::print("{} (warning)\n", line);
  for (const auto* lines : {&missing, &placement.errors})
    for (const std::string& line : *lines) fmt::print(stderr, "{}\n", line);
  fmt::print("{}: {}, {}, {}\n", arguments.graph, errors ? counted(errors, "error") : "no errors", counted(warnings, "warning"),
             counted(plan->nodes.size(), "node"));
  return errors ? kGraphWrong : kGood;
}

}  // namespace knead::app
