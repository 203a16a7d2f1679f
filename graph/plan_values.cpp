#include "graph/plan_values.h"

namespace knead {

size_t PlanContext::input_count(int port) const {
  size_t count = 0;
  for (const Source source : sources(port)) count += static_cast<bool>(values_.at(source));
  return count;
}

const Value& PlanContext::input(int port, size_t i) const {
  for (const Source source : sources(port)) {
    const Value& value = values_.at(source);
    if (value && i-- == 0) return value;
  }
  throw Error(ErrorCode::kInput, "input '" + plan_node().node->inputs()[static_cast<size_t>(port)].name + "' has no value", "connect it");
}

int PlanContext::frame() const {
  if (checked() && !plan_node().node->depends_on_frame())
    throw Error(ErrorCode::kInternal, "node type '" + plan_node().type->name + "' reads the frame without saying so", "override depends_on_frame()");
  return frame_number();
}

Key PlanContext::content_of_inputs() const {
  Hasher hasher;
  for (int port = 0; port < static_cast<int>(plan_node().inputs.size()); ++port)
    for (size_t i = 0; i < input_count(port); ++i) hasher.add(input(port, i).type()->content(input(port, i)));
  return hasher.key();
}

void PlanContext::evaluate() {
  const Node& node = *plan_node().node;
  try {
    for (Value& output : outputs()) output = Value();  // storage of the round before, to be used again
    const Key before = checked() ? content_of_inputs() : Key{};
    node.evaluate(*this);
    if (checked() && content_of_inputs() != before)
      throw Error(ErrorCode::kInternal, "node type '" + plan_node().type->name + "' changed its inputs",
                  "published buffers are shared: write to new ones");
    for (size_t k = 0; k < node.outputs().size(); ++k)
      if (!outputs()[k])
        throw Error(ErrorCode::kInternal, "node type '" + plan_node().type->name + "' did not set its output '" + node.outputs()[k].name + "'");
  } catch (...) {
    throw error_in_flight(plan_node().where);
  }
}

}  // namespace knead
