#include "app/verdict.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "graph/report.h"

namespace knead::app {
namespace {

template <class Declaration>
bool has_port(const std::vector<Declaration>& ports, const char* type) {
  return std::any_of(ports.begin(), ports.end(), [&](const Declaration& port) { return port.type && std::strcmp(port.type->name, type) == 0; });
}

bool has_report(const Node& node) {
  const auto& outputs = node.outputs();
  return std::any_of(outputs.begin(), outputs.end(), [](const auto& output) { return output.type && same_type(*output.type, port_type<Report>()); });
}

bool at_rest(const std::string& ended) {
  static const std::set<std::string> good{"at rest", "no contact", "rounding"};
  return good.count(ended) > 0;
}

}  // namespace

// A node that takes reports repeats what others say. A node that takes anything of a solver but its surface goes on from where that one ended.
Judge::Judge(const Plan& plan) {
  const auto solves = [](const PlanNode& node) { return has_report(*node.node) && !has_port(node.node->inputs(), "Report"); };
  for (const PlanNode& node : plan.nodes) {
    has_colliders_ |= has_port(node.node->outputs(), "Sdf");
    if (!solves(node)) continue;
    solvers_.insert(node.name);
    for (const auto& port : node.inputs)
      for (const Source source : port) {
        const PlanNode& from = plan.nodes[static_cast<size_t>(source.node)];
        const PortType* type = plan.type_of(source);
        if (solves(from) && type && std::strcmp(type->name, "Surface") != 0) beginnings_.insert(from.name);
      }
  }
}

Verdict Judge::judge(const std::string& line) const {
  Verdict verdict;
  verdict.nodes = read_node_figures(line);
  for (const NodeFigures& node : verdict.nodes) {
    const std::string ended = node.report.word("ended");
    const double iterations = node.report.number("iterations"), moved = node.report.number("displacement_max");
    verdict.warned |= !node.warnings.empty();
    verdict.enclosed |= node.report.number("enclosed_colliders", 0) > 0;
    if (has_colliders_ && std::isfinite(moved)) verdict.touched = verdict.touched.value_or(false) || moved > 0;
    if (ended.empty() || !solvers_.count(node.name)) continue;
    if (!at_rest(ended) && !beginnings_.count(node.name)) verdict.restless.push_back(node.name);
    if (std::isfinite(iterations)) verdict.ended = fmt::format("{:.0f} iteration{}, {}", iterations, iterations == 1 ? "" : "s", ended);
  }
  if (verdict.touched == false) verdict.ended = "no contact";
  return verdict;
}

}  // namespace knead::app
