#include <algorithm>
#include <deque>
#include <map>
#include <set>

#include "graph/iterate.h"
#include "graph/plan.h"

namespace knead {
namespace {

constexpr int kDeepestGroups = 16;

// What a node of the file has become: a node of the plan, or (a group) a list of sources per output. `failed` keeps one error from causing others.
struct Compiled {
  enum { kUntouched, kUnderWay, kDone } state = kUntouched;
  bool failed = false;
  int node = -1;
  std::vector<std::pair<std::string, std::vector<Source>>> group_outputs;
  bool is_group = false;
};

struct Reference {
  std::vector<Source> sources;
  bool failed = false;
};

struct Scope {
  const std::vector<NodeSpec>* specs = nullptr;
  std::string file;
  std::string prefix;               // "press."
  Plan* plan = nullptr;
  Scope* parent = nullptr;          // names not found here are looked up there and captured; null across a group's border
  std::map<std::string, Compiled> compiled;
  std::map<std::string, Source> states;
  bool has_states = false;
  std::map<std::string, std::vector<Source>> inputs;  // of the group
  std::set<std::string> failed_inputs;
  bool has_inputs = false;
  std::map<std::string, Literal> parameters;
  std::map<std::pair<int, int>, int> captured;        // parent's source -> external of plan
  int group_depth = 0;
};

class Compiler {
 public:
  explicit Compiler(const CompileOptions& options) : options_(options), registry_(options.registry ? *options.registry : Registry::builtin()) {}

  std::shared_ptr<const Plan> run(const GraphSpec& spec) {
    auto plan = std::make_shared<Plan>();
    plan->file = spec.file;
    plan->frames = spec.frames;
    Scope& scope = scopes_.emplace_back();
    scope.specs = &spec.nodes;
    scope.file = spec.file;
    scope.plan = plan.get();
    scope.has_inputs = !spec.inputs.empty();
    for (const GroupInputSpec& input : spec.inputs)
      if (!input.optional)
        fail({spec.file, 0, 0, {}, input.name}, "this graph is made to be used as a group: its input '" + input.name + "' has no value here");
    for (const GroupInputSpec& input : spec.inputs) scope.inputs[input.name] = {};
    for (const GroupParameterSpec& parameter : spec.parameters) scope.parameters[parameter.name] = parameter.value;
    compile_scope(scope);
    for (size_t i = 0; i < options_.overrides.size(); ++i)
      if (!used_overrides_.count(i)) {
        const std::string near = nearest_name(options_.overrides[i].first, {known_params_.begin(), known_params_.end()});
        fail({"--set", 0, 0, {}, options_.overrides[i].first}, "no node has this parameter", near.empty() ? "" : "did you mean '" + near + "'?");
      }
    if (!errors_.empty()) {
      std::stable_sort(errors_.begin(), errors_.end(), [](const Error& a, const Error& b) {
        return std::tie(a.where().file, a.where().line, a.where().column) < std::tie(b.where().file, b.where().line, b.where().column);
      });
      throw GraphErrors(std::move(errors_));
    }
    name_outputs(*plan, scope);
    mark_frames(*plan);
    return plan;
  }

 private:
  void fail(Where where, const std::string& message, const std::string& hint = {}) {
    errors_.emplace_back(ErrorCode::kGraph, std::move(where), message, hint);
  }
  static Where where_of(const Scope& scope, const Literal& at, const std::string& node, const std::string& member = {}) {
    return {scope.file, at.line, at.column, node, member};
  }
  static std::string did_you_mean(const std::string& wrong, const std::vector<std::string>& known) {
    const std::string near = nearest_name(wrong, known);
    return near.empty() ? "" : "did you mean '" + near + "'?";
  }

  void compile_scope(Scope& scope) {
    for (const NodeSpec& spec : *scope.specs) compile_node(scope, spec);
  }

  Compiled& compile_node(Scope& scope, const NodeSpec& spec) {
    Compiled& compiled = scope.compiled[spec.name];
    if (compiled.state == Compiled::kDone) return compiled;
    const Where where{scope.file, spec.line, spec.column, scope.prefix + spec.name, {}};
    if (compiled.state == Compiled::kUnderWay) {
      if (!compiled.failed) {
        std::string path;
        const auto from = std::find(stack_.begin(), stack_.end(), scope.prefix + spec.name);
        for (auto it = from; it != stack_.end(); ++it) path += *it + " -> ";
        fail(where, "a cycle: " + path + scope.prefix + spec.name, "a loop is written as a node of type iterate");
      }
      compiled.failed = true;
      return compiled;
    }
    compiled.state = Compiled::kUnderWay;
    stack_.push_back(scope.prefix + spec.name);
    const size_t errors_before = errors_.size();
    compile_arguments(scope, spec, where, compiled);
    compiled.failed |= errors_.size() > errors_before;
    stack_.pop_back();
    compiled.state = Compiled::kDone;
    return compiled;
  }

  // The arguments with group parameters put in and --set applied.
  Literal::Map arguments_of(Scope& scope, const NodeSpec& spec) {
    Literal::Map arguments = spec.arguments;
    for (auto& [name, value] : arguments)
      if (!(spec.type == "iterate" && name.as_string() && *name.as_string() == "body")) substitute(scope, value, scope.prefix + spec.name);
    const std::string full = scope.prefix + spec.name + ".";
    for (size_t i = 0; i < options_.overrides.size(); ++i) {
      const auto& [path, value] = options_.overrides[i];
      if (path.compare(0, full.size(), full) != 0 || path.find('.', full.size()) != std::string::npos) continue;
      const std::string member = path.substr(full.size());
      auto found = std::find_if(arguments.begin(), arguments.end(), [&](const auto& a) { return a.first.as_string() && *a.first.as_string() == member; });
      if (found == arguments.end()) {
        if (!takes(spec, member)) continue;  // reported as unused, with the nearest parameter
        arguments.emplace_back(member, value);
      } else {
        found->second = value;
      }
      used_overrides_.insert(i);
    }
    return arguments;
  }

  bool takes(const NodeSpec& spec, const std::string& member) {
    const NodeType* type = registry_.find(spec.type);
    if (!type) return true;
    if (spec.type == "group" || type->group) return true;  // checked when the group is expanded
    const auto node = type->make();
    const auto has = [&](const auto& list, const auto& name_of) { return std::any_of(list.begin(), list.end(), [&](const auto& item) { return name_of(item) == member; }); };
    return has(node->params(), [](const ParamBase* p) { return p->name(); }) || has(node->inputs(), [](const InputDeclaration& d) { return d.name; });
  }

  void substitute(Scope& scope, Literal& value, const std::string& node) {
    if (const std::string* text = value.as_string(); text && text->size() > 1 && (*text)[0] == '$') {
      const auto found = scope.parameters.find(text->substr(1));
      if (found == scope.parameters.end()) {
        std::vector<std::string> known;
        for (const auto& [name, literal] : scope.parameters) known.push_back(name);
        fail(where_of(scope, value, node), "the graph has no parameter '" + text->substr(1) + "'", did_you_mean(text->substr(1), known));
        return;
      }
      const int line = value.line, column = value.column;
      value = found->second;
      value.line = line;
      value.column = column;
    } else if (auto* list = std::get_if<Literal::List>(&value.value)) {
      for (Literal& item : *list) substitute(scope, item, node);
    } else if (auto* map = value.as_map()) {
      for (auto& [key, item] : *map) substitute(scope, item, node);
    }
  }

  void compile_arguments(Scope& scope, const NodeSpec& spec, const Where& where, Compiled& compiled) {
    const NodeType* type = registry_.find(spec.type);
    if (!type) {
      if (!spec.type.empty()) fail(where, "unknown node type '" + spec.type + "'", did_you_mean(spec.type, registry_.names()));
      arguments_of(scope, spec);  // marks --set values as used
      compiled.failed = true;
      return;
    }
    const Literal::Map arguments = arguments_of(scope, spec);
    if (spec.type == "group" || type->group) return expand_group(scope, spec, *type, arguments, where, compiled);
    PlanNode plan_node;
    plan_node.name = scope.prefix + spec.name;
    plan_node.type = type;
    plan_node.node = type->make();
    plan_node.where = where;
    if (spec.type == "iterate") {
      if (!compile_loop(scope, arguments, plan_node)) compiled.failed = true;
    } else {
      assign(scope, arguments, plan_node, compiled);
    }
    Hasher hasher;
    hasher.add(type->name).add(type->version);
    for (const ParamBase* param : plan_node.node->params()) param->hash(hasher);
    if (const auto* loop = dynamic_cast<const Iterate*>(plan_node.node.get())) loop->hash_body(hasher);
    plan_node.static_key = hasher.key();
    compiled.node = static_cast<int>(scope.plan->nodes.size());
    scope.plan->nodes.push_back(std::move(plan_node));
  }

  void assign(Scope& scope, const Literal::Map& arguments, PlanNode& plan_node, Compiled& compiled) {
    Node& node = *plan_node.node;
    plan_node.inputs.resize(node.inputs().size());
    std::set<std::string> given;
    bool params_good = true;
    for (const auto& [name_literal, value] : arguments) {
      const std::string name = name_literal.as_string() ? *name_literal.as_string() : name_literal.text();
      given.insert(name);
      const auto input = std::find_if(node.inputs().begin(), node.inputs().end(), [&](const auto& declaration) { return declaration.name == name; });
      if (input != node.inputs().end()) {
        Reference reference = connect(scope, value, *input, plan_node.name);
        compiled.failed |= reference.failed;
        if (reference.sources.empty() && !reference.failed && !input->optional)
          fail(where_of(scope, value, plan_node.name, name), "this input must be connected", std::string("it takes a ") + input->type->name);
        plan_node.inputs[static_cast<size_t>(input - node.inputs().begin())] = std::move(reference.sources);
      } else {
        params_good &= set_param(scope, node, plan_node.name, name, name_literal, value);
      }
    }
    for (const ParamBase* param : node.params()) known_params_.insert(plan_node.name + "." + param->name());
    for (const InputDeclaration& input : node.inputs())
      if (!input.optional && !given.count(input.name)) {
        Where where = plan_node.where;
        where.member = input.name;
        fail(where, "this input must be connected", std::string("it takes a ") + input.type->name);
      }
    if (!params_good) return;
    try {
      node.configure();
    } catch (const GraphErrors& errors) {
      for (const Error& error : errors.errors()) errors_.push_back(error.at(plan_node.where));
    } catch (const Error& error) {
      errors_.push_back(error.at(plan_node.where));
    }
  }

  bool set_param(Scope& scope, Node& node, const std::string& full, const std::string& name, const Literal& name_literal, const Literal& value) {
    for (ParamBase* param : node.params()) {
      if (param->name() != name) continue;
      const std::string wrong = param->assign(value);
      if (!wrong.empty()) fail(where_of(scope, value, full, name), wrong);
      return wrong.empty();
    }
    std::vector<std::string> known;
    for (const InputDeclaration& input : node.inputs()) known.push_back(input.name);
    for (const ParamBase* param : node.params()) known.push_back(param->name());
    if (dynamic_cast<Iterate*>(&node)) known.insert(known.end(), {"state", "body", "next"});
    std::string hint = did_you_mean(name, known);
    if (hint.empty()) {
      for (const std::string& one : known) hint += (hint.empty() ? "it takes " : ", ") + one;
    }
    fail(where_of(scope, name_literal, full, name), "the node has no such input or parameter", hint);
    return false;
  }

  // The sources behind an argument of an input port, checked against its type.
  Reference connect(Scope& scope, const Literal& value, const InputDeclaration& input, const std::string& node) {
    Reference all;
    const auto add = [&](const Literal& item) {
      Reference one = resolve(scope, item, node, input.name);
      all.failed |= one.failed;
      for (const Source source : one.sources) {
        const PortType* is = scope.plan->type_of(source);
        if (is && input.type && !same_type(*is, *input.type)) {
          fail(where_of(scope, item, node, input.name), std::string("expected a ") + input.type->name + ", but '" + item.text().substr(1, item.text().size() - 2) + "' is a " + is->name,
               outputs_of_type(scope, source, *input.type));
          all.failed = true;
        }
        all.sources.push_back(source);
      }
    };
    if (const Literal::List* list = value.as_list())
      for (const Literal& item : *list) add(item);
    else
      add(value);
    if (!input.many && all.sources.size() > 1) {
      fail(where_of(scope, value, node, input.name), "this input takes one value, and a list was given");
      all.failed = true;
    }
    return all;
  }

  static std::string outputs_of_type(const Scope& scope, Source source, const PortType& type) {
    if (source.node == Source::kExternal) return {};
    const PlanNode& from = scope.plan->nodes[static_cast<size_t>(source.node)];
    for (const OutputDeclaration& output : from.node->outputs())
      if (output.type && same_type(*output.type, type)) return "did you mean '" + from.name + "." + output.name + "'?";
    return {};
  }

  Reference resolve(Scope& scope, const Literal& value, const std::string& node, const std::string& member) {
    if (value.is_null()) return {};
    const std::string* text = value.as_string();
    if (!text) {
      fail(where_of(scope, value, node, member), std::string("expected the name of a node or of its output, found ") + value.kind(), "such as 'body' or 'tets.lattice'");
      return {{}, true};
    }
    if (*text == "none") return {};
    const size_t dot = text->find('.');
    const std::string name = text->substr(0, dot), output = dot == std::string::npos ? "" : text->substr(dot + 1);
    std::vector<std::string> known;
    for (Scope* at = &scope; at; at = at->parent) {
      std::vector<Source> sources;
      int found = 0;  // 1: found, -1: found and wrong
      if (name == "state" && at->has_states) found = find_state(*at, output, sources, known);
      else if (name == "inputs" && at->has_inputs) found = find_input(*at, output, sources, known);
      else found = find_output(*at, name, output, sources, known);
      if (found == 1) return {captured(scope, at, sources), false};
      if (found == -1) return {{}, true};
      if (found == -2) {
        fail(where_of(scope, value, node, member), "'" + name + "' has no output '" + output + "'", did_you_mean(output, known).empty() ? listed(known) : did_you_mean(output, known));
        return {{}, true};
      }
    }
    fail(where_of(scope, value, node, member), "there is no node '" + name + "'", did_you_mean(name, known));
    return {{}, true};
  }

  static std::string listed(const std::vector<std::string>& known) {
    std::string all;
    for (const std::string& one : known) all += (all.empty() ? "it has " : ", ") + one;
    return all;
  }

  // 1: found; 0: not here; -1: found but broken (already reported); -2: the node is there, the output is not, and `known` names those that are.
  int find_state(Scope& scope, const std::string& output, std::vector<Source>& sources, std::vector<std::string>& known) {
    if (const auto found = scope.states.find(output); found != scope.states.end()) return sources = {found->second}, 1;
    known.clear();
    for (const auto& [name, source] : scope.states) known.push_back(name);
    return -2;
  }
  int find_input(Scope& scope, const std::string& output, std::vector<Source>& sources, std::vector<std::string>& known) {
    if (scope.failed_inputs.count(output)) return -1;
    if (const auto found = scope.inputs.find(output); found != scope.inputs.end()) return sources = found->second, 1;
    known.clear();
    for (const auto& [name, all] : scope.inputs) known.push_back(name);
    return -2;
  }
  int find_output(Scope& scope, const std::string& name, const std::string& output, std::vector<Source>& sources, std::vector<std::string>& known) {
    const auto spec = std::find_if(scope.specs->begin(), scope.specs->end(), [&](const NodeSpec& one) { return one.name == name; });
    if (spec == scope.specs->end()) {
      for (const NodeSpec& one : *scope.specs) known.push_back(one.name);
      return 0;
    }
    const Compiled& compiled = compile_node(scope, *spec);
    if (compiled.is_group) {
      for (const auto& [group_output, group_sources] : compiled.group_outputs)
        if (output.empty() || output == group_output) return sources = group_sources, compiled.failed ? -1 : 1;
      if (compiled.failed) return -1;
      known.clear();
      for (const auto& [group_output, group_sources] : compiled.group_outputs) known.push_back(group_output);
      return -2;
    }
    if (compiled.node < 0) return -1;
    const auto& outputs = scope.plan->nodes[static_cast<size_t>(compiled.node)].node->outputs();
    for (size_t i = 0; i < outputs.size(); ++i)
      if (output.empty() || output == outputs[i].name) return sources = {{compiled.node, static_cast<int>(i)}}, 1;
    if (compiled.failed) return -1;
    known.clear();
    for (const OutputDeclaration& one : outputs) known.push_back(one.name);
    return -2;
  }

  // Sources of an outer scope as seen from an inner one: an external of every loop in between.
  std::vector<Source> captured(Scope& scope, Scope* owner, const std::vector<Source>& sources) {
    if (&scope == owner || scope.plan == owner->plan) return sources;
    std::vector<Source> inner;
    for (const Source source : captured(*scope.parent, owner, sources)) {
      const auto [entry, is_new] = scope.captured.try_emplace({source.node, source.output}, static_cast<int>(scope.plan->externals.size()));
      if (is_new) scope.plan->externals.push_back({source_name(*scope.parent->plan, source), scope.parent->plan->type_of(source)});
      inner.push_back({Source::kExternal, entry->second});
    }
    return inner;
  }
  static std::string source_name(const Plan& plan, Source source) {
    if (source.node == Source::kExternal) return plan.externals[static_cast<size_t>(source.output)].name;
    const PlanNode& node = plan.nodes[static_cast<size_t>(source.node)];
    return node.name + "." + node.node->outputs()[static_cast<size_t>(source.output)].name;
  }

  bool compile_loop(Scope& scope, const Literal::Map& arguments, PlanNode& plan_node) {
    auto& loop = static_cast<Iterate&>(*plan_node.node);
    const Literal *state = nullptr, *body = nullptr, *next = nullptr;
    bool good = true;
    for (const auto& [name_literal, value] : arguments) {
      const std::string name = name_literal.as_string() ? *name_literal.as_string() : name_literal.text();
      if (name == "state") state = &value;
      else if (name == "body") body = &value;
      else if (name == "next") next = &value;
      else good &= set_param(scope, loop, plan_node.name, name, name_literal, value);
    }
    for (const ParamBase* param : loop.params()) known_params_.insert(plan_node.name + "." + param->name());
    for (const auto& [what, literal] : {std::pair{"state", state}, {"body", body}, {"next", next}})
      if (!literal || !literal->as_map()) {
        fail(plan_node.where, std::string("a loop needs `") + what + ":` with a map", "state: {points: tets.points}, body: {...}, next: {points: stiff}");
        good = false;
      }
    if (!good) return false;

    Plan inner_plan;
    Scope& inner = scopes_.emplace_back();
    inner.file = scope.file;
    inner.prefix = plan_node.name + ".";
    inner.plan = &inner_plan;
    inner.parent = &scope;
    inner.has_states = true;
    inner.parameters = scope.parameters;
    inner.group_depth = scope.group_depth;
    inner.specs = &bodies_.emplace_back(node_specs(*body, scope.file, plan_node.name, errors_));

    std::vector<Iterate::State> states;
    for (const auto& [name_literal, value] : *state->as_map()) {
      Iterate::State one;
      one.name = name_literal.as_string() ? *name_literal.as_string() : name_literal.text();
      Reference start = connect(scope, value, {one.name, nullptr, {}, true, false}, plan_node.name);
      good &= !start.failed;
      one.type = start.sources.empty() ? nullptr : scope.plan->type_of(start.sources[0]);
      inner.states[one.name] = {Source::kExternal, static_cast<int>(states.size())};
      inner_plan.externals.push_back({"state." + one.name, one.type});
      loop.add_input({one.name, one.type, {}, true, false});
      plan_node.inputs.push_back(std::move(start.sources));
      states.push_back(std::move(one));
    }
    compile_scope(inner);
    for (const auto& [name, compiled] : inner.compiled) good &= !compiled.failed;
    good &= find_next(scope, inner, *next, states, plan_node);
    std::vector<std::pair<int, Source>> captures;
    for (const auto& [source, external] : inner.captured) captures.push_back({external, {source.first, source.second}});
    std::sort(captures.begin(), captures.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    for (const auto& [external, source] : captures) {
      loop.add_input({inner_plan.externals[static_cast<size_t>(external)].name, inner_plan.externals[static_cast<size_t>(external)].type, {}, true, false});
      plan_node.inputs.push_back({source});
    }
    for (const PlanNode& node : inner_plan.nodes)
      if (node.node->has_effect()) fail(node.where, "a node that writes files cannot stand in a loop", "put it after the loop");
    loop.set_body(std::move(inner_plan), std::move(states));
    return good;
  }

  bool find_next(Scope& scope, Scope& inner, const Literal& next, std::vector<Iterate::State>& states, const PlanNode& plan_node) {
    bool good = true;
    std::set<std::string> given;
    std::vector<std::string> names;
    for (const Iterate::State& state : states) names.push_back(state.name);
    for (const auto& [name_literal, value] : *next.as_map()) {
      const std::string name = name_literal.as_string() ? *name_literal.as_string() : name_literal.text();
      const auto state = std::find_if(states.begin(), states.end(), [&](const Iterate::State& one) { return one.name == name; });
      if (state == states.end()) {
        fail(where_of(scope, name_literal, plan_node.name, "next"), "the loop has no state '" + name + "'", did_you_mean(name, names));
        good = false;
        continue;
      }
      given.insert(name);
      Reference reference = connect(inner, value, {name, state->type, {}, true, false}, plan_node.name);
      good &= !reference.failed;
      if (reference.sources.empty()) {
        if (!reference.failed) fail(where_of(scope, value, plan_node.name, "next"), "state '" + name + "' needs a value for the next round");
        good = false;
        continue;
      }
      state->next = reference.sources[0];
      if (!state->type) state->type = inner.plan->type_of(state->next);
    }
    for (const std::string& name : names)
      if (!given.count(name)) {
        fail(where_of(scope, next, plan_node.name, "next"), "state '" + name + "' has no value for the next round", "add " + name + ": NODE to `next`");
        good = false;
      }
    return good;
  }

  void expand_group(Scope& scope, const NodeSpec& spec, const NodeType& type, const Literal::Map& arguments, const Where& where, Compiled& compiled) {
    compiled.is_group = true;
    GraphSpec loaded;
    if (scope.group_depth >= kDeepestGroups) return fail(where, "groups are nested more than " + std::to_string(kDeepestGroups) + " deep", "does a group use itself?");
    try {
      if (type.group) {
        loaded = type.group();
      } else {
        const auto path = std::find_if(arguments.begin(), arguments.end(), [](const auto& a) { return a.first.as_string() && *a.first.as_string() == "path"; });
        if (path == arguments.end() || !path->second.as_string()) return fail(where, "a group needs `path:`, the graph file it stands for");
        if (!options_.load_group) return fail(where, "groups cannot be loaded here", "set CompileOptions::load_group");
        loaded = options_.load_group(*path->second.as_string());
      }
    } catch (const GraphErrors& errors) {
      for (const Error& error : errors.errors()) errors_.push_back(error.at(where));
      return;
    } catch (const Error& error) {
      errors_.push_back(error.at(where));
      return;
    }
    const GraphSpec& group = groups_.emplace_back(std::move(loaded));
    Scope& inner = scopes_.emplace_back();
    inner.specs = &group.nodes;
    inner.file = group.file;
    inner.prefix = scope.prefix + spec.name + ".";
    inner.plan = scope.plan;
    inner.has_inputs = true;
    inner.has_states = false;
    inner.group_depth = scope.group_depth + 1;
    for (const GroupParameterSpec& parameter : group.parameters) {
      inner.parameters[parameter.name] = parameter.value;
      known_params_.insert(inner.prefix + parameter.name);
    }
    bind_group(scope, spec, group, arguments, where, inner, type.group ? "" : "path");
    const size_t errors_before = errors_.size();
    compile_scope(inner);
    compiled.failed |= errors_.size() > errors_before;
    for (const auto& [name, reference] : group.outputs) {
      Reference found = connect(inner, reference, {name, nullptr, {}, true, true}, inner.prefix + "outputs");
      compiled.failed |= found.failed;
      compiled.group_outputs.emplace_back(name, std::move(found.sources));
    }
  }

  void bind_group(Scope& scope, const NodeSpec& spec, const GraphSpec& group, const Literal::Map& arguments, const Where& where, Scope& inner,
                  const std::string& own_parameter) {
    const std::string full = scope.prefix + spec.name;
    std::vector<std::string> known;
    for (const GroupInputSpec& input : group.inputs) {
      inner.inputs[input.name] = {};
      known.push_back(input.name);
    }
    for (const GroupParameterSpec& parameter : group.parameters) known.push_back(parameter.name);
    std::set<std::string> given;
    for (const auto& [name_literal, value] : arguments) {
      const std::string name = name_literal.as_string() ? *name_literal.as_string() : name_literal.text();
      if (name == own_parameter) continue;
      given.insert(name);
      const auto input = std::find_if(group.inputs.begin(), group.inputs.end(), [&](const GroupInputSpec& one) { return one.name == name; });
      if (input != group.inputs.end()) {
        bind_input(scope, *input, value, full, inner);
      } else if (inner.parameters.count(name)) {
        inner.parameters[name] = value;
      } else {
        const std::string hint = did_you_mean(name, known);
        fail(where_of(scope, name_literal, full, name), "the node has no such input or parameter", hint.empty() ? listed(known) : hint);
      }
    }
    for (const GroupInputSpec& input : group.inputs)
      if (!input.optional && !given.count(input.name)) {
        Where at = where;
        at.member = input.name;
        fail(at, "this input must be connected", "it takes a " + input.type);
        inner.failed_inputs.insert(input.name);
      }
  }

  void bind_input(Scope& scope, const GroupInputSpec& input, const Literal& value, const std::string& full, Scope& inner) {
    Reference reference = connect(scope, value, {input.name, nullptr, {}, input.optional, input.many}, full);
    for (const Source source : reference.sources) {
      const PortType* is = scope.plan->type_of(source);
      if (is && is->name != input.type) {
        fail(where_of(scope, value, full, input.name), "expected a " + input.type + ", found a " + is->name);
        reference.failed = true;
      }
    }
    if (reference.sources.empty() && !reference.failed && !input.optional) {
      fail(where_of(scope, value, full, input.name), "this input must be connected", "it takes a " + input.type);
      reference.failed = true;
    }
    if (reference.failed) inner.failed_inputs.insert(input.name);
    inner.inputs[input.name] = std::move(reference.sources);
  }

  static void name_outputs(Plan& plan, const Scope& top) {
    for (size_t i = 0; i < plan.nodes.size(); ++i) {
      const auto& outputs = plan.nodes[i].node->outputs();
      for (size_t k = outputs.size(); k-- > 0;) {
        plan.names[plan.nodes[i].name + "." + outputs[k].name] = {static_cast<int>(i), static_cast<int>(k)};
        plan.names[plan.nodes[i].name] = {static_cast<int>(i), static_cast<int>(k)};
      }
    }
    for (const auto& [name, compiled] : top.compiled) {
      for (size_t k = compiled.group_outputs.size(); k-- > 0;) {
        if (compiled.group_outputs[k].second.empty()) continue;
        plan.names[name + "." + compiled.group_outputs[k].first] = compiled.group_outputs[k].second[0];
        plan.names[name] = compiled.group_outputs[k].second[0];
      }
    }
  }

  static void mark_frames(Plan& plan) {
    for (PlanNode& node : plan.nodes) {
      node.frame_dependent = node.node->depends_on_frame();
      for (const auto& sources : node.inputs)
        for (const Source source : sources) node.frame_dependent |= plan.nodes[static_cast<size_t>(source.node)].frame_dependent;
    }
  }

  const CompileOptions& options_;
  const Registry& registry_;
  std::deque<Scope> scopes_;
  std::deque<std::vector<NodeSpec>> bodies_;
  std::deque<GraphSpec> groups_;
  std::vector<std::string> stack_;
  std::vector<Error> errors_;
  std::set<size_t> used_overrides_;
  std::set<std::string> known_params_;
};

}  // namespace

std::shared_ptr<const Plan> compile(const GraphSpec& spec, const CompileOptions& options) { return Compiler(options).run(spec); }

}  // namespace knead
