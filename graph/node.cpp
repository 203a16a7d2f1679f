#include "graph/node.h"

#include <algorithm>

#include "graph/registry.h"

namespace knead {

ParamBase::ParamBase(Node* owner, const char* name, ParamSpec spec) : name_(name), spec_(std::move(spec)) {
  owner->params_.push_back(this);
}

std::string ParamBase::assign(const Literal& literal) {
  std::string wrong = parse(literal);
  if (wrong.empty()) {
    set_ = true;
    written_ = literal;
  }
  return wrong;
}

std::string ParamBase::check_number(double value) const {
  if ((spec_.min && value < *spec_.min) || (spec_.max && value > *spec_.max)) {
    std::string range = spec_.min ? "at least " + Literal(*spec_.min).text() : "";
    if (spec_.max) range += (range.empty() ? "at most " : " and at most ") + Literal(*spec_.max).text();
    return Literal(value).text() + " is out of range: expected " + range;
  }
  return {};
}

std::string ParamBase::check_choice(const std::string& value) const {
  if (spec_.choices.empty() || std::count(spec_.choices.begin(), spec_.choices.end(), value)) return {};
  std::string all;
  for (const std::string& choice : spec_.choices) all += (all.empty() ? "" : ", ") + choice;
  const std::string near = nearest_name(value, spec_.choices);
  return "'" + value + "' is not one of: " + all + (near.empty() ? "" : "; did you mean '" + near + "'?");
}

Literal ParamBase::decorated(Literal schema) const {
  Literal::Map& map = *schema.as_map();
  const Literal value = show();
  if (!value.is_null()) map.emplace_back("default", value);
  if (spec_.min) map.emplace_back("minimum", *spec_.min);
  if (spec_.max) map.emplace_back("maximum", *spec_.max);
  if (!spec_.choices.empty()) map.emplace_back("enum", Literal::List(spec_.choices.begin(), spec_.choices.end()));
  std::string doc = spec_.doc;
  if (*spec_.unit) doc += std::string(" [") + spec_.unit + "]";
  map.emplace_back("description", doc);
  return schema;
}

InBase::InBase(Node* owner, const char* name, const PortType& type, PortSpec spec, bool optional, bool many)
    : index(static_cast<int>(owner->inputs_.size())) {
  owner->inputs_.push_back({name, &type, spec, optional, many});
}
OutBase::OutBase(Node* owner, const char* name, const PortType& type, PortSpec spec) : index(static_cast<int>(owner->outputs_.size())) {
  owner->outputs_.push_back({name, &type, spec});
}

Buffer<std::byte> Context::host_copy(const Buffer<std::byte>& buffer) {
  throw Error(ErrorCode::kDevice, "a buffer on " + buffer.device().text() + " is needed on the host, where nothing here can bring it");
}

void Context::check_cancelled() const {
  if (cancelled()) throw Error(ErrorCode::kCancelled, "cancelled");
}

void Registry::add(NodeType type) {
  const std::string name = type.name;
  if (!types_.emplace(name, std::move(type)).second) throw Error(ErrorCode::kInternal, "node type '" + name + "' is registered twice");
}
const NodeType* Registry::find(const std::string& name) const {
  const auto found = types_.find(name);
  return found == types_.end() ? nullptr : &found->second;
}
std::vector<std::string> Registry::names() const {
  std::vector<std::string> names;
  for (const auto& [name, type] : types_) names.push_back(name);
  return names;
}
const Registry& Registry::builtin() {
  static const Registry registry = [] {
    Registry all;
    register_iterate(all);
    register_group(all);
    register_all_nodes(all);
    return all;
  }();
  return registry;
}

}  // namespace knead
