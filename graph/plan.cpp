#include "graph/plan.h"

#include "graph/iterate.h"

namespace knead {

Source Plan::find(const std::string& reference) const {
  if (const auto found = names.find(reference); found != names.end()) return found->second;
  std::vector<std::string> known;
  for (const auto& [name, source] : names) known.push_back(name);
  const std::string near = nearest_name(reference, known);
  throw Error(ErrorCode::kGraph, "the graph has no output '" + reference + "'", near.empty() ? "" : "did you mean '" + near + "'?");
}

const PortType* Plan::type_of(Source source) const {
  return source.node == Source::kExternal ? externals[static_cast<size_t>(source.output)].type
                                          : nodes[static_cast<size_t>(source.node)].node->outputs()[static_cast<size_t>(source.output)].type;
}

std::vector<int> Plan::sinks() const {
  std::vector<int> sinks;
  for (size_t i = 0; i < nodes.size(); ++i)
    if (nodes[i].node->has_effect() && !nodes[i].left_out) sinks.push_back(static_cast<int>(i));
  return sinks;
}

std::vector<char> Plan::reached_from(const std::vector<Source>& targets) const {
  std::vector<char> reached(nodes.size());
  for (const Source target : targets) reached[static_cast<size_t>(target.node)] = true;
  for (size_t i = nodes.size(); i-- > 0;)
    if (reached[i])
      for (const auto& port : nodes[i].inputs)
        for (const Source source : port) reached[static_cast<size_t>(source.node)] = true;
  return reached;
}

namespace {

std::string source_text(const Plan& plan, Source source) {
  if (source.node == Source::kExternal) return plan.externals[static_cast<size_t>(source.output)].name;
  const PlanNode& node = plan.nodes[static_cast<size_t>(source.node)];
  return node.name + "." + node.node->outputs()[static_cast<size_t>(source.output)].name;
}

std::string where_it_runs(const Node& node, const Executor& executor) {
  return node.runs() == Runs::kHost ? "host" : executor.name();
}

void append_text(std::string& text, const Plan& plan, const Executor& executor, const std::string& indent) {
  const auto runs_on = [&](Source source) {
    return source.node == Source::kExternal ? std::string() : where_it_runs(*plan.nodes[static_cast<size_t>(source.node)].node, executor);
  };
  for (const PlanNode& node : plan.nodes) {
    const std::string place = where_it_runs(*node.node, executor);
    text += indent + node.name + " (" + node.type->name + "): on " + place;
    if (indent.empty()) text += node.frame_dependent ? ", every frame" : ", once";
    if (!indent.empty()) text += node.state_dependent ? ", every round" : ", first round";
    if (node.node->has_effect()) text += ", writes";
    text += '\n';
    for (size_t port = 0; port < node.inputs.size(); ++port)
      for (const Source source : node.inputs[port]) {
        const std::string from = runs_on(source);
        const bool moves = executor.device() != Device{} && !from.empty() && (from == "host") != (place == "host");
        text += indent + "  " + node.node->inputs()[port].name + " <- " + source_text(plan, source) +
                (moves ? "  [transfer " + from + " -> " + place + "]" : "") + '\n';
      }
    for (const ParamBase* param : node.node->params())
      if (param->is_set()) text += indent + "  " + param->name() + " = " + param->show().text() + '\n';
    if (const auto* loop = dynamic_cast<const Iterate*>(node.node.get())) {
      append_text(text, loop->body(), executor, indent + "    ");
      for (const Iterate::State& state : loop->states())
        text += indent + "  next " + state.name + " <- " + source_text(loop->body(), state.next) + '\n';
    }
  }
}

void append_dot(std::string& text, const Plan& plan, const std::string& prefix) {
  const auto id = [&](const std::string& name) { return "\"" + prefix + name + "\""; };
  for (const External& external : plan.externals)
    text += "  " + id(external.name) + " [label=\"" + external.name + "\", shape=ellipse, style=dashed];\n";
  for (const PlanNode& node : plan.nodes) {
    text += "  " + id(node.name) + " [label=\"" + node.name + "\\n" + node.type->name + "\"" +
            (node.frame_dependent ? ", style=filled, fillcolor=\"#ffe9c7\"" : "") + (node.node->has_effect() ? ", shape=note" : "") + "];\n";
    for (size_t port = 0; port < node.inputs.size(); ++port)
      for (const Source source : node.inputs[port]) {
        const std::string from = source.node == Source::kExternal ? id(plan.externals[static_cast<size_t>(source.output)].name)
                                                                  : id(plan.nodes[static_cast<size_t>(source.node)].name);
        text += "  " + from + " -> " + id(node.name) + " [label=\"" + node.node->inputs()[port].name + "\"];\n";
      }
    if (const auto* loop = dynamic_cast<const Iterate*>(node.node.get())) {
      text += "  subgraph \"cluster_" + node.name + "\" {\n  label=\"" + node.name + "\";\n";
      append_dot(text, loop->body(), node.name + "/");
      text += "  }\n";
    }
  }
}

}  // namespace

std::string plan_text(const Plan& plan, const Executor& executor) {
  std::string text;
  append_text(text, plan, executor, "");
  return text;
}

std::string plan_dot(const Plan& plan) {
  std::string text = "digraph knead {\n  rankdir=LR;\n  node [shape=box, fontname=\"sans-serif\"];\n";
  append_dot(text, plan, "");
  return text + "}\n";
}

}  // namespace knead
