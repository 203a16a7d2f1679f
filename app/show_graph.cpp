#include <fmt/format.h>

#include "app/common.h"

namespace knead::app {

int show_graph(const GraphArguments& arguments, const DeviceArguments& device, bool dot) {
  const auto plan = load_plan(arguments);
  fmt::print("{}", dot ? plan_dot(*plan) : plan_text(*plan, *make_executor(device)));
  return kGood;
}

}  // namespace knead::app
