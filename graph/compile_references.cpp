#include <algorithm>
#include <cctype>
#include <cstring>

#include "graph/compiler.h"

namespace knead {
namespace {

std::string source_name(const Plan& plan, Source source) {
  if (source.node == Source::kExternal) return plan.externals[static_cast<size_t>(source.output)].name;
  const PlanNode& node = plan.nodes[static_cast<size_t>(source.node)];
  return node.name + "." + node.node->outputs()[static_cast<size_t>(source.output)].name;
}

bool is_type(const PortType* type, const char* name) {
  return type && std::strcmp(type->name, name) == 0;
}

// "put mesh_to_sdf between: {type: mesh_to_sdf, mesh: motion}", where a node type makes what was wanted of nothing but what was given.
std::string node_between(const Registry& registry, const std::string& written, const char* given, const char* wanted) {
  for (const std::string& name : registry.names()) {
    const NodeType& type = *registry.find(name);
    if (!type.make) continue;
    const auto node = type.make();
    const InputDeclaration* needed = nullptr;
    size_t count = 0;
    for (const InputDeclaration& input : node->inputs())
      if (!input.optional) needed = &input, ++count;
    if (count == 1 && is_type(needed->type, given) && !node->outputs().empty() && is_type(node->outputs()[0].type, wanted))
      return "put " + name + " between: {type: " + name + ", " + needed->name + ": " + written + "}";
  }
  return {};
}

}  // namespace

// What to write instead of `written`, which names `source`, to get a `type`: another output of the node, or a node between. "" when nothing is known.
std::string Compiler::way_to_type(const Plan& plan, Source source, const std::string& written, const char* type) const {
  if (source.node != Source::kExternal)
    for (const OutputDeclaration& output : plan.nodes[static_cast<size_t>(source.node)].node->outputs())
      if (is_type(output.type, type)) return "did you mean '" + written.substr(0, written.find('.')) + "." + output.name + "'?";
  return node_between(registry_, written, plan.type_of(source)->name, type);
}

// "an Sdf is made by ...", for a word that names a port's type where a node's is wanted. "" when it names none.
std::string Compiler::makers_of(const std::string& word) const {
  const auto same_word = [&](const std::string& type) {
    return std::equal(word.begin(), word.end(), type.begin(), type.end(),
                      [](unsigned char a, unsigned char b) { return std::tolower(a) == std::tolower(b); });
  };
  std::string makers;
  for (const std::string& name : registry_.names()) {
    const NodeType& type = *registry_.find(name);
    if (!type.make) continue;
    const auto node = type.make();
    if (node->outputs().empty() || !node->outputs()[0].type || !same_word(node->outputs()[0].type->name)) continue;
    if (makers.empty()) makers = with_article(node->outputs()[0].type->name) + " is made by ";
    makers += (makers.back() == ' ' ? "" : ", ") + name;
  }
  return makers;
}

// The sources behind an argument of an input, checked against its type.
Reference Compiler::connect(Scope& scope, const Literal& value, const Wanted& wanted, const std::string& node) {
  Reference all;
  const auto add = [&](const Literal& item) {
    Reference one = resolve(scope, item, node, wanted.name);
    all.failed |= one.failed;
    for (const Source source : one.sources) {
      const PortType* is = scope.plan->type_of(source);
      if (is && wanted.type && std::strcmp(is->name, wanted.type) != 0) {
        const std::string& written = *item.as_string();
        fail(where_of(scope, item, node, wanted.name),
             "expected " + with_article(wanted.type) + ", but '" + written + "' is " + with_article(is->name),
             way_to_type(*scope.plan, source, written, wanted.type));
        all.failed = true;
      }
      all.sources.push_back(source);
    }
  };
  if (const Literal::List* list = value.as_list())
    for (const Literal& item : *list) add(item);
  else
    add(value);
  if (!wanted.many && all.sources.size() > 1) {
    fail(where_of(scope, value, node, wanted.name), "this input takes one value, and a list was given");
    all.failed = true;
  }
  return all;
}

// "node" or "node.output", "state.NAME", "inputs.NAME", looked for from the inside out; "none" is nothing at all.
Reference Compiler::resolve(Scope& scope, const Literal& value, const std::string& node, const std::string& member) {
  if (value.is_null()) return {};
  const std::string* text = value.as_string();
  if (!text) {
    fail(where_of(scope, value, node, member), std::string("expected the name of a node or of its output, found ") + value.kind(),
         "such as 'body' or 'tets.lattice'");
    return {{}, true};
  }
  if (*text == "none") return {};
  const size_t dot = text->find('.');
  const std::string name = text->substr(0, dot), output = dot == std::string::npos ? "" : text->substr(dot + 1);
  for (Scope* at = &scope; at; at = at->parent) {
    Found found = find(*at, name, output);
    if (found.result == Lookup::kNowhere) continue;
    if (found.result == Lookup::kHere) return {captured(scope, *at, std::move(found.sources)), false};
    if (found.result == Lookup::kNoSuchOutput) {
      const std::string message = found.outputs.empty() ? "'" + name + "' has no outputs"
                                  : output.empty()      ? "which of '" + name + "'?"
                                                        : "'" + name + "' has no output '" + output + "'";
      fail(where_of(scope, value, node, member), message, did_you_mean(output, found.outputs, "it has "));
    }
    return {{}, true};
  }
  const Where where = where_of(scope, value, node, member);
  std::vector<std::string> states, nodes;
  for (const Scope* at = &scope; at; at = at->parent) {
    if (at->states)
      for (const auto& [state, source] : *at->states) states.push_back(state);
    for (const NodeSpec& spec : *at->specs) nodes.push_back(spec.name);
  }
  if (name != "state")
    fail(where, "there is no node '" + name + "'", did_you_mean(name, nodes));
  else if (states.empty())
    fail(where, "there is no state here", "only the body of a loop has states");
  else
    fail(where, output.empty() ? "which state?" : "there is no state '" + output + "'", did_you_mean(output, states, "there is "));
  return {{}, true};
}

Compiler::Found Compiler::find(Scope& scope, const std::string& name, const std::string& output) {
  if (name == "state") {
    if (!scope.states || !scope.states->count(output)) return {};
    return {Lookup::kHere, {scope.states->at(output)}, {}};
  }
  std::vector<std::string> outputs;
  if (name == "inputs" && scope.inputs) {
    if (const auto input = scope.inputs->find(output); input != scope.inputs->end())
      return {input->second.failed ? Lookup::kBroken : Lookup::kHere, input->second.sources, {}};
    for (const auto& [input, reference] : *scope.inputs) outputs.push_back(input);
    return {Lookup::kNoSuchOutput, {}, std::move(outputs)};
  }
  const auto at = scope.by_name.find(name);
  if (at == scope.by_name.end()) return {};
  const CompiledNode& compiled = compile_node(scope, at->second);
  if (compiled.is_group) {
    for (const auto& [group_output, sources] : compiled.group_outputs) {
      if (output.empty() || output == group_output) return {compiled.failed ? Lookup::kBroken : Lookup::kHere, sources, {}};
      outputs.push_back(group_output);
    }
  } else if (compiled.node >= 0) {
    const auto& declared = scope.plan->nodes[static_cast<size_t>(compiled.node)].node->outputs();
    for (size_t i = 0; i < declared.size(); ++i) {
      if (output.empty() || output == declared[i].name) return {Lookup::kHere, {{compiled.node, static_cast<int>(i)}}, {}};
      outputs.push_back(declared[i].name);
    }
  }
  if (compiled.failed && outputs.empty()) return {Lookup::kBroken, {}, {}};  // nobody knows what it would have had
  return {Lookup::kNoSuchOutput, {}, std::move(outputs)};
}

// Sources of an outer scope as seen from an inner one: an external of every loop in between.
std::vector<Source> Compiler::captured(Scope& scope, const Scope& owner, std::vector<Source> sources) {
  if (scope.plan == owner.plan) return sources;
  sources = captured(*scope.parent, owner, std::move(sources));
  const Plan& outer = *scope.parent->plan;
  for (Source& source : sources) {
    const auto [entry, is_new] = scope.captured.try_emplace({source.node, source.output}, static_cast<int>(scope.plan->externals.size()));
    if (is_new) scope.plan->externals.push_back({source_name(outer, source), outer.type_of(source)});
    source = {Source::kExternal, entry->second};
  }
  return sources;
}

}  // namespace knead
