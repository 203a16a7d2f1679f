#include <algorithm>

#include "graph/compiler.h"

namespace knead {
namespace {

constexpr size_t kDeepestGroups = 16;
constexpr int kMostGroups = 10000;  // groups of groups grow by powers

const Argument* find_argument(const std::vector<Argument>& arguments, const char* name) {
  const auto found = std::find_if(arguments.begin(), arguments.end(), [&](const Argument& a) { return a.name == name; });
  return found == arguments.end() ? nullptr : &*found;
}

std::string name_of(const Literal& key) {
  return key.as_string() ? *key.as_string() : key.text();
}

}  // namespace

bool Compiler::compile_loop(Scope& scope, const std::vector<Argument>& arguments, PlanNode& plan_node) {
  auto& loop = static_cast<Iterate&>(*plan_node.node);
  bool good = true;
  const Literal *state = nullptr, *body = nullptr, *next = nullptr;
  for (const auto& [name, part] : {std::pair{"state", &state}, {"body", &body}, {"next", &next}}) {
    const Argument* argument = find_argument(arguments, name);
    if (argument && argument->value && argument->value->as_map()) {
      *part = argument->value;
      continue;
    }
    good = false;
    if (!argument || argument->value)
      fail(argument ? where_of(scope, *argument->value, plan_node.name) : plan_node.where, std::string("a loop needs `") + name + ":` with a map",
           "state: {points: tets.points}, body: {...}, next: {points: stiff}");
  }
  for (const Argument& argument : arguments)
    if (argument.name != "state" && argument.name != "body" && argument.name != "next")
      good &= argument.value && set_param(scope, loop, plan_node.name, argument);
  if (!state || !body) {
    opaque_.push_back(plan_node.name + ".");
    return false;
  }

  Plan inner_plan;
  const std::vector<NodeSpec> specs = node_specs(*body, scope.file, errors_);
  Scope inner;
  inner.specs = &specs;
  inner.file = scope.file;
  inner.prefix = plan_node.name + ".";
  inner.plan = &inner_plan;
  inner.parent = &scope;
  inner.parameters = scope.parameters;
  inner.given = scope.given;
  inner.groups = scope.groups;
  std::vector<Iterate::State> states;
  good &= start_states(scope, inner, *state->as_map(), loop, plan_node, states);
  compile_scope(inner);
  for (const CompiledNode& compiled : inner.compiled) good &= !compiled.failed;
  good &= next && find_next(scope, inner, *next, states, plan_node);

  std::vector<Source> captures(inner_plan.externals.size());
  for (const auto& [source, external] : inner.captured) captures[static_cast<size_t>(external)] = {source.first, source.second};
  for (size_t i = states.size(); i < captures.size(); ++i) {
    loop.add_input({inner_plan.externals[i].name, inner_plan.externals[i].type, {}, true, false});
    plan_node.inputs.push_back({captures[i]});
  }
  for (const PlanNode& node : inner_plan.nodes)
    if (node.node->has_effect()) {
      fail(node.where, "a node that writes files cannot stand in a loop", "put it after the loop");
      good = false;
    }
  if (good) loop.set_body(std::move(inner_plan), std::move(states));
  return good;
}

// Every state becomes an external of the body and an input of the loop, which starts it.
bool Compiler::start_states(Scope& scope, Scope& inner, const Literal::Map& state, Iterate& loop, PlanNode& plan_node,
                            std::vector<Iterate::State>& states) {
  bool good = true;
  inner.states.emplace();
  for (const auto& [key, value] : state) {
    Iterate::State one;
    one.name = name_of(key);
    if (one.name == "report" || inner.states->count(one.name)) {
      fail(where_of(scope, key, plan_node.name, one.name),
           one.name == "report" ? "a state cannot be named report: the loop has an output of that name" : "state '" + one.name + "' is there twice");
      good = false;
      continue;
    }
    Reference start = connect(scope, value, {one.name, nullptr, false}, plan_node.name);
    good &= !start.failed;
    one.type = start.sources.empty() ? nullptr : scope.plan->type_of(start.sources[0]);
    inner.states->emplace(one.name, Source{Source::kExternal, static_cast<int>(states.size())});
    inner.plan->externals.push_back({"state." + one.name, one.type});
    loop.add_input({one.name, one.type, {}, true, false});
    plan_node.inputs.push_back(std::move(start.sources));
    states.push_back(std::move(one));
  }
  return good;
}

bool Compiler::find_next(Scope& scope, Scope& inner, const Literal& next, std::vector<Iterate::State>& states, const PlanNode& plan_node) {
  bool good = true;
  std::vector<bool> given(states.size());
  for (const auto& [key, value] : *next.as_map()) {
    const std::string name = name_of(key);
    const auto state = std::find_if(states.begin(), states.end(), [&](const Iterate::State& one) { return one.name == name; });
    if (state == states.end()) {
      std::vector<std::string> names;
      for (const Iterate::State& one : states) names.push_back(one.name);
      fail(where_of(scope, key, plan_node.name, "next"), "the loop has no state '" + name + "'", did_you_mean(name, names, "it has "));
      good = false;
      continue;
    }
    const auto s = static_cast<size_t>(state - states.begin());
    given[s] = true;
    const Reference reference = connect(inner, value, {name, state->type ? state->type->name : nullptr, false}, plan_node.name);
    if (reference.sources.empty() && !reference.failed)
      fail(where_of(scope, value, plan_node.name, "next"), "state '" + name + "' needs a value for the next round");
    if (reference.sources.empty() || reference.failed) {
      good = false;
      continue;
    }
    state->next = reference.sources[0];
    if (state->type) continue;
    // A state that starts with `none` is of the type that comes round: now the nodes that read it can be checked.
    state->type = inner.plan->externals[s].type = inner.plan->type_of(state->next);
    for (const PlanNode& node : inner.plan->nodes)
      for (size_t port = 0; port < node.inputs.size(); ++port) {
        const InputDeclaration& input = node.node->inputs()[port];
        const bool reads = std::count(node.inputs[port].begin(), node.inputs[port].end(), Source{Source::kExternal, static_cast<int>(s)}) > 0;
        if (!reads || !state->type || !input.type || same_type(*state->type, *input.type)) continue;
        Where where = node.where;
        where.member = input.name;
        fail(where, "expected " + with_article(input.type->name) + ", but 'state." + name + "' is " + with_article(state->type->name) +
                        " from the second round on");
        good = false;
      }
  }
  for (size_t s = 0; s < states.size(); ++s)
    if (!given[s]) {
      fail(where_of(scope, next, plan_node.name, "next"), "state '" + states[s].name + "' has no value for the next round",
           "add " + states[s].name + ": NODE to `next`");
      good = false;
    }
  return good;
}

// The nodes of a group become nodes of the plan in which the group stands.
void Compiler::expand_group(Scope& scope, const NodeSpec& spec, const NodeType& type, const std::vector<Argument>& arguments,
                            CompiledNode& compiled) {
  compiled.is_group = true;
  const Where where = where_of(scope, spec);
  const std::optional<GraphSpec> group = load_group(scope, type, arguments, where);
  if (!group) {
    opaque_.push_back(where.node + ".");
    return;
  }
  Scope inner;
  inner.specs = &group->nodes;
  inner.file = group->file;
  inner.prefix = where.node + ".";
  inner.plan = scope.plan;
  inner.groups = scope.groups;
  inner.groups.push_back(type.group ? type.name : *find_argument(arguments, "path")->value->as_string());
  for (const GroupParameterSpec& parameter : group->parameters) {
    inner.parameters[parameter.name] = parameter.value;
    group_parameters_.push_back(inner.prefix + parameter.name);
  }
  bind_group(scope, *group, arguments, where, inner, type.group ? "" : "path");
  compile_scope(inner);
  for (const auto& [name, reference] : group->outputs) {
    Reference found = connect(inner, reference, {name, nullptr, true}, inner.prefix + "outputs");
    compiled.failed |= found.failed;
    compiled.group_outputs.emplace_back(name, std::move(found.sources));
  }
}

std::optional<GraphSpec> Compiler::load_group(Scope& scope, const NodeType& type, const std::vector<Argument>& arguments, const Where& where) {
  const Argument* path = type.group ? nullptr : find_argument(arguments, "path");
  if (path && !path->value) return std::nullopt;
  if (!type.group && (!path || !path->value->as_string())) return fail(where, "a group needs `path:`, the graph file it stands for"), std::nullopt;
  const std::string& name = type.group ? type.name : *path->value->as_string();
  if (std::count(scope.groups.begin(), scope.groups.end(), name)) return fail(where, "group '" + name + "' uses itself"), std::nullopt;
  if (scope.groups.size() >= kDeepestGroups)
    return fail(where, "groups are nested more than " + std::to_string(kDeepestGroups) + " deep", "does a group use itself?"), std::nullopt;
  if (groups_expanded_ == kMostGroups) return std::nullopt;
  if (++groups_expanded_ == kMostGroups) return fail(where, "the graph has more than " + std::to_string(kMostGroups) + " groups"), std::nullopt;
  try {
    if (type.group) return type.group();
    if (options_.load_group) return options_.load_group(name);
    fail(where, "groups cannot be loaded here", "set CompileOptions::load_group");
  } catch (...) {
    take_errors(where);
  }
  return std::nullopt;
}

// The group's inputs and parameters from the node's arguments.
void Compiler::bind_group(Scope& scope, const GraphSpec& group, const std::vector<Argument>& arguments, const Where& where, Scope& inner,
                          const std::string& own_parameter) {
  const std::string& full = where.node;
  inner.inputs.emplace();
  std::vector<std::string> known;
  for (const GroupInputSpec& input : group.inputs) known.push_back(input.name);
  for (const GroupParameterSpec& parameter : group.parameters) known.push_back(parameter.name);
  for (const Argument& argument : arguments) {
    if (argument.name == own_parameter) continue;
    const auto input = std::find_if(group.inputs.begin(), group.inputs.end(), [&](const GroupInputSpec& one) { return one.name == argument.name; });
    if (input != group.inputs.end()) {
      Reference reference =
          !argument.value ? Reference{{}, true} : connect(scope, *argument.value, {input->name, input->type.c_str(), input->many}, full);
      if (reference.sources.empty() && !reference.failed && !input->optional) {
        fail(where_of(scope, *argument.value, full, input->name), "this input must be connected", "it takes a " + input->type);
        reference.failed = true;
      }
      inner.inputs->insert_or_assign(input->name, std::move(reference));
    } else if (const auto parameter = inner.parameters.find(argument.name); parameter != inner.parameters.end()) {
      if (!argument.value) continue;
      parameter->second = *argument.value;
      inner.given[argument.name] = where_of(scope, *argument.value, full, argument.name);
    } else {
      fail(where_of(scope, *argument.key, full, argument.name), "the node has no such input or parameter",
           did_you_mean(argument.name, known, "it takes "));
    }
  }
  for (const GroupInputSpec& input : group.inputs) {
    if (!inner.inputs->emplace(input.name, Reference{{}, !input.optional}).second || input.optional) continue;
    Where at = where;
    at.member = input.name;
    fail(at, "this input must be connected", "it takes a " + input.type);
  }
}

}  // namespace knead
