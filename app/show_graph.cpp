#include <fmt/format.h>

#include "app/common.h"
#include "app/placement.h"

namespace knead::app {

int show_graph(const GraphArguments& arguments, const DeviceArguments& device, bool dot) {
  const auto plan = load_plan(arguments);
  if (dot) {
    fmt::print("{}", plan_dot(*plan));
    return kGood;
  }
  fmt::print("{}\n", plan_text(*plan, *make_executor(device)));
  Evaluator evaluator(plan);
  const Placement placement = find_placement(evaluator, plan->frames);
  fmt::print("{}", placement_text(placement, plan->frames.size()));
  for (const std::string& line : placement.errors) fmt::print("{}\n", line);
  return kGood;
}

}  // namespace knead::app
