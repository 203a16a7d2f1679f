#include <algorithm>
#include <tuple>

#include "graph/compiler.h"

namespace knead {
namespace {

constexpr size_t kDeepestChain = 200;  // nodes that wait for each other while they are compiled; each takes 20 kB of stack under AddressSanitizer
constexpr int kFromCommandLine = -1;   // Literal::line of --set values

bool is_name(const std::string& text) {
  const auto letter = [](char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_'; };
  return !text.empty() && letter(text[0]) && std::all_of(text.begin(), text.end(), [&](char c) { return letter(c) || (c >= '0' && c <= '9'); });
}

// Every output by "node.output", and the first also by "node".
void name_outputs(Plan& plan, const Scope& top) {
  const auto name = [&](const std::string& node, const std::string& output, Source source) {
    plan.names.try_emplace(node, source);
    plan.names.insert_or_assign(node + "." + output, source);
  };
  for (size_t i = 0; i < plan.nodes.size(); ++i) {
    const auto& outputs = plan.nodes[i].node->outputs();
    for (size_t k = 0; k < outputs.size(); ++k) name(plan.nodes[i].name, outputs[k].name, {static_cast<int>(i), static_cast<int>(k)});
  }
  for (size_t i = 0; i < top.compiled.size(); ++i)
    for (const auto& [output, sources] : top.compiled[i].group_outputs)
      if (!sources.empty()) name((*top.specs)[i].name, output, sources[0]);
}

void mark_frames(Plan& plan) {
  for (PlanNode& node : plan.nodes) {
    node.frame_dependent = node.node->depends_on_frame();
    for (const auto& sources : node.inputs)
      for (const Source source : sources) node.frame_dependent |= plan.nodes[static_cast<size_t>(source.node)].frame_dependent;
  }
}

void add_parameters(const Plan& plan, std::vector<std::string>& known) {
  for (const PlanNode& node : plan.nodes) {
    for (const ParamBase* param : node.node->params()) known.push_back(node.name + "." + param->name());
    if (const auto* loop = dynamic_cast<const Iterate*>(node.node.get())) add_parameters(loop->body(), known);
  }
}

}  // namespace

std::shared_ptr<const Plan> Compiler::run(const GraphSpec& spec) {
  auto plan = std::make_shared<Plan>();
  plan->file = spec.file;
  plan->frames = spec.frames;
  Scope scope;
  scope.specs = &spec.nodes;
  scope.file = spec.file;
  scope.plan = plan.get();
  if (!spec.inputs.empty()) scope.inputs.emplace();
  for (const GroupInputSpec& input : spec.inputs) {
    scope.inputs->insert_or_assign(input.name, Reference{{}, !input.optional});
    if (!input.optional)
      fail({spec.file, 0, 0, {}, input.name}, "this graph is made to be used as a group: its input '" + input.name + "' has no value here",
           "use it in another graph by {type: group, path: ...}");
  }
  for (const GroupParameterSpec& parameter : spec.parameters) scope.parameters[parameter.name] = parameter.value;
  compile_scope(scope);
  for (const auto& [name, reference] : spec.outputs) {
    const Reference found = connect(scope, reference, {name, nullptr, true}, "outputs");
    if (!found.sources.empty()) plan->names.try_emplace(name, found.sources[0]);
  }
  report_unused_overrides(*plan);
  leave_out_others(*plan);
  if (!errors_.empty()) {
    std::stable_sort(errors_.begin(), errors_.end(), [](const Error& a, const Error& b) {
      return std::tie(a.where().file, a.where().line, a.where().column) < std::tie(b.where().file, b.where().line, b.where().column);
    });
    // A group may use what it was given more than once.
    const auto same = [](const Error& a, const Error& b) { return std::string_view(a.what()) == b.what(); };
    errors_.erase(std::unique(errors_.begin(), errors_.end(), same), errors_.end());
    throw GraphErrors(std::move(errors_));
  }
  name_outputs(*plan, scope);
  mark_frames(*plan);
  return plan;
}

void Compiler::compile_scope(Scope& scope) {
  scope.compiled.resize(scope.specs->size());
  check_names(scope);
  for (size_t i = 0; i < scope.specs->size(); ++i) compile_node(scope, i);
}

void Compiler::check_names(Scope& scope) {
  for (size_t i = 0; i < scope.specs->size(); ++i) {
    const NodeSpec& spec = (*scope.specs)[i];
    if (!is_name(spec.name))
      fail(where_of(scope, spec), "'" + spec.name + "' is no name for a node", "letters, digits and _ only, and no digit first");
    else if (spec.name == "state" || spec.name == "inputs" || spec.name == "none")
      fail(where_of(scope, spec), "'" + spec.name + "' has a meaning of its own and cannot name a node");
    else if (!scope.by_name.emplace(spec.name, i).second)
      fail(where_of(scope, spec), "node '" + spec.name + "' is there twice", "give one of them another name");
  }
}

CompiledNode& Compiler::compile_node(Scope& scope, size_t i) {
  CompiledNode& compiled = scope.compiled[i];
  const NodeSpec& spec = (*scope.specs)[i];
  const std::string full = scope.prefix + spec.name;
  if (compiled.state == CompiledNode::kDone) return compiled;
  if (compiled.state == CompiledNode::kUnderWay) {
    if (!compiled.failed) {
      std::string path;
      for (auto it = std::find(stack_.begin(), stack_.end(), full); it != stack_.end(); ++it) path += *it + " -> ";
      fail(where_of(scope, spec), "a cycle: " + path + full, "a loop is written as a node of type iterate");
    }
    compiled.failed = true;
    return compiled;
  }
  if (stack_.size() >= kDeepestChain) {
    if (stack_.size() == kDeepestChain)
      fail(where_of(scope, spec), "more than " + std::to_string(kDeepestChain) + " nodes wait for each other here",
           "write nodes after those they use");
    compiled.failed = true;
    return compiled;
  }
  compiled.state = CompiledNode::kUnderWay;
  stack_.push_back(full);
  const size_t errors_before = errors_.size();
  compile_arguments(scope, spec, compiled);
  compiled.failed |= errors_.size() > errors_before;
  stack_.pop_back();
  compiled.state = CompiledNode::kDone;
  return compiled;
}

void Compiler::compile_arguments(Scope& scope, const NodeSpec& spec, CompiledNode& compiled) {
  const Where where = where_of(scope, spec);
  const NodeType* type = registry_.find(spec.type);
  if (!type) {
    if (spec.type.empty())
      fail(where, "the node has no type", "add type: ...; `knead nodes` lists the types");
    else if (const std::string makers = makers_of(spec.type); !makers.empty())
      fail(where, "unknown node type '" + spec.type + "'", makers);
    else
      fail(where, "unknown node type '" + spec.type + "'", did_you_mean(spec.type, registry_.names()));
    opaque_.push_back(where.node + ".");
    return;
  }
  if (spec.type == "group" || type->group) {
    const auto takes = [](const std::string&) { return true; };  // checked when it is expanded
    return expand_group(scope, spec, *type, arguments_of(scope, spec, takes), compiled);
  }
  PlanNode plan_node;
  plan_node.name = where.node;
  plan_node.type = type;
  plan_node.node = type->make();
  plan_node.where = where;
  const auto takes = [&](const std::string& member) {
    const auto& params = plan_node.node->params();
    const auto& inputs = plan_node.node->inputs();
    return std::any_of(params.begin(), params.end(), [&](const ParamBase* p) { return p->name() == member; }) ||
           std::any_of(inputs.begin(), inputs.end(), [&](const InputDeclaration& d) { return d.name == member; });
  };
  const std::vector<Argument> arguments = arguments_of(scope, spec, takes);
  const auto* loop = dynamic_cast<const Iterate*>(plan_node.node.get());
  if (loop)
    compiled.failed |= !compile_loop(scope, arguments, plan_node);
  else
    assign(scope, arguments, plan_node, compiled);
  Hasher hasher;
  hasher.add(type->name).add(type->version);
  for (const ParamBase* param : plan_node.node->params()) param->hash(hasher);
  if (loop) loop->hash_body(hasher);
  plan_node.static_key = hasher.key();
  compiled.node = static_cast<int>(scope.plan->nodes.size());
  scope.plan->nodes.push_back(std::move(plan_node));
}

template <class Takes>
std::vector<Argument> Compiler::arguments_of(Scope& scope, const NodeSpec& spec, const Takes& takes) {
  std::vector<Argument> arguments;
  const std::string full = scope.prefix + spec.name + ".";
  for (const auto& [key, value] : spec.arguments) {
    const std::string name = key.as_string() ? *key.as_string() : key.text();
    const bool body = name == "body" && value.as_map();  // of a loop: its nodes do it themselves
    arguments.push_back({name, &key, body ? &value : substituted(scope, value, scope.prefix + spec.name)});
  }
  for (size_t i = 0; i < options_.overrides.size(); ++i) {
    const auto& [path, value] = options_.overrides[i];
    if (path.compare(0, full.size(), full) != 0 || path.find('.', full.size()) != std::string::npos) continue;
    const std::string member = path.substr(full.size());
    auto found = std::find_if(arguments.begin(), arguments.end(), [&](const Argument& a) { return a.name == member; });
    if (found == arguments.end() && !takes(member)) continue;  // reported as unused, with the nearest parameter
    Literal& replaced = substituted_.emplace_back(value);
    replaced.line = kFromCommandLine;
    if (found == arguments.end())
      arguments.push_back({member, &replaced, &replaced});
    else
      found->value = &replaced;
    used_overrides_.insert(i);
  }
  return arguments;
}

const Literal* Compiler::substituted(Scope& scope, const Literal& value, const std::string& node) {
  const auto has_parameter = [](const auto& self, const Literal& literal) -> bool {
    if (const std::string* text = literal.as_string()) return text->size() > 1 && (*text)[0] == '$';
    if (const auto* list = literal.as_list()) return std::any_of(list->begin(), list->end(), [&](const Literal& item) { return self(self, item); });
    if (const auto* map = literal.as_map()) return std::any_of(map->begin(), map->end(), [&](const auto& item) { return self(self, item.second); });
    return false;
  };
  if (!has_parameter(has_parameter, value)) return &value;
  Literal& copy = substituted_.emplace_back(value);
  const size_t errors_before = errors_.size();
  substitute(scope, copy, node);
  return errors_.size() > errors_before ? nullptr : &copy;
}

void Compiler::substitute(Scope& scope, Literal& value, const std::string& node) {
  if (const std::string* text = value.as_string(); text && text->size() > 1 && (*text)[0] == '$') {
    const std::string name = text->substr(1);
    const auto found = scope.parameters.find(name);
    if (found == scope.parameters.end()) {
      std::vector<std::string> known;
      for (const auto& [parameter, literal] : scope.parameters) known.push_back(parameter);
      fail(where_of(scope, value, node), "the graph has no parameter '" + name + "'", did_you_mean(name, known, "it has "));
      return;
    }
    value.value = found->second.value;
    if (const auto given = scope.given.find(name); given != scope.given.end()) given_[&value] = given->second;
  } else if (auto* list = std::get_if<Literal::List>(&value.value)) {
    for (Literal& item : *list) substitute(scope, item, node);
  } else if (auto* map = value.as_map()) {
    for (auto& [key, item] : *map) substitute(scope, item, node);
  }
}

void Compiler::assign(Scope& scope, const std::vector<Argument>& arguments, PlanNode& plan_node, CompiledNode& compiled) {
  Node& node = *plan_node.node;
  const auto& inputs = node.inputs();
  plan_node.inputs.resize(inputs.size());
  std::vector<bool> given(inputs.size());
  bool params_good = true;
  for (const Argument& argument : arguments) {
    const auto input = std::find_if(inputs.begin(), inputs.end(), [&](const auto& declaration) { return declaration.name == argument.name; });
    if (input == inputs.end()) {
      params_good &= argument.value && set_param(scope, node, plan_node.name, argument);
      continue;
    }
    const auto port = static_cast<size_t>(input - inputs.begin());
    given[port] = true;
    if (!argument.value) continue;
    Reference reference = connect(scope, *argument.value, {input->name, input->type ? input->type->name : nullptr, input->many}, plan_node.name);
    compiled.failed |= reference.failed;
    if (reference.sources.empty() && !reference.failed && !input->optional)
      fail(where_of(scope, *argument.value, plan_node.name, input->name), "this input must be connected",
           std::string("it takes a ") + input->type->name);
    plan_node.inputs[port] = std::move(reference.sources);
  }
  for (size_t port = 0; port < inputs.size(); ++port)
    if (!inputs[port].optional && !given[port]) {
      Where where = plan_node.where;
      where.member = inputs[port].name;
      fail(where, "this input must be connected", std::string("it takes a ") + inputs[port].type->name);
    }
  if (!params_good) return;
  try {
    node.configure();
  } catch (...) {
    take_errors(plan_node.where);
  }
}

bool Compiler::set_param(Scope& scope, Node& node, const std::string& full, const Argument& argument) {
  for (ParamBase* param : node.params()) {
    if (param->name() != argument.name) continue;
    const std::string wrong = param->assign(*argument.value);
    if (!wrong.empty()) fail(where_of(scope, *argument.value, full, argument.name), wrong);
    return wrong.empty();
  }
  std::vector<std::string> known;
  for (const InputDeclaration& input : node.inputs()) known.push_back(input.name);
  for (const ParamBase* param : node.params()) known.push_back(param->name());
  if (dynamic_cast<Iterate*>(&node)) known.insert(known.end(), {"state", "body", "next"});
  const std::string gone = node.what_became_of(argument.name);
  fail(where_of(scope, *argument.key, full, argument.name), "the node has no such input or parameter",
       gone.empty() ? did_you_mean(argument.name, known, "it takes ") : gone);
  return false;
}

void Compiler::report_unused_overrides(const Plan& plan) {
  std::vector<std::string> known;
  for (size_t i = 0; i < options_.overrides.size(); ++i) {
    const std::string& path = options_.overrides[i].first;
    const bool unknown_inside =
        std::any_of(opaque_.begin(), opaque_.end(), [&](const std::string& prefix) { return path.compare(0, prefix.size(), prefix) == 0; });
    if (used_overrides_.count(i) || unknown_inside) continue;
    if (known.empty()) {
      known = group_parameters_;
      add_parameters(plan, known);
    }
    fail({"--set", 0, 0, {}, path}, "no node has this parameter", did_you_mean(path, known));
  }
}

// Nodes with an effect that `only` does not name, by themselves or with the group they stand in.
void Compiler::leave_out_others(Plan& plan) {
  if (options_.only.empty()) return;
  std::vector<std::string> known;
  std::vector<bool> used(options_.only.size());
  for (PlanNode& node : plan.nodes) {
    if (!node.node->has_effect()) continue;
    known.push_back(node.name);
    node.left_out = true;
    for (size_t i = 0; i < used.size(); ++i) {
      const std::string& name = options_.only[i];
      if (node.name != name && !node.name.starts_with(name + ".")) continue;
      used[i] = true;
      node.left_out = false;
    }
  }
  for (size_t i = 0; i < used.size(); ++i)
    if (!used[i])
      fail({"--only", 0, 0, options_.only[i], {}}, "no node of this name writes anything", did_you_mean(options_.only[i], known, "there is "));
}

Where Compiler::where_of(const Scope& scope, const Literal& at, const std::string& node, const std::string& member) const {
  if (const auto given = given_.find(&at); given != given_.end()) return given->second;
  if (at.line == kFromCommandLine) return {"--set", 0, 0, node, member};
  return {scope.file, at.line, at.column, node, member};
}

void Compiler::take_errors(const Where& where) {
  try {
    throw;
  } catch (const GraphErrors& errors) {
    for (const Error& error : errors.errors()) errors_.push_back(error.at(where));
  } catch (...) {
    errors_.push_back(error_in_flight(where));
  }
}

std::string Compiler::did_you_mean(const std::string& wrong, const std::vector<std::string>& known, const char* otherwise) {
  const std::string near = nearest_name(wrong, known);
  if (!near.empty()) return "did you mean '" + near + "'?";
  std::string all;
  if (otherwise)
    for (const std::string& one : known) all.append(all.empty() ? otherwise : ", ").append(one);
  return all;
}

std::shared_ptr<const Plan> compile(const GraphSpec& spec, const CompileOptions& options) {
  return Compiler(options).run(spec);
}

}  // namespace knead
