#include "io/schema.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <vector>

namespace knead {
namespace {

using Json = nlohmann::ordered_json;

Json json_of(const Literal& literal) {
  struct Maker {
    Json operator()(std::monostate) const { return nullptr; }
    Json operator()(bool v) const { return v; }
    Json operator()(int64_t v) const { return v; }
    Json operator()(double v) const { return v; }
    Json operator()(const std::string& v) const { return v; }
    Json operator()(const Literal::List& v) const {
      Json list = Json::array();
      for (const Literal& item : v) list.push_back(json_of(item));
      return list;
    }
    Json operator()(const Literal::Map& v) const {
      Json map = Json::object();
      for (const auto& [key, item] : v) map[key.as_string() ? *key.as_string() : key.text()] = json_of(item);
      return map;
    }
  };
  return std::visit(Maker{}, literal.value);
}

// What a node type takes and gives, whether it is a class or a built-in group.
struct Entry {
  std::string name, type, kind, doc, unit;  // kind: "", "optional", "many", or a group's default in words
  Json schema;
  bool required = false;
};
struct Declaration {
  std::vector<Entry> inputs, params, outputs;
};

Json reference_schema(const std::string& description, bool many) {
  const Json one = {{"type", "string"}, {"pattern", "^[A-Za-z_$][A-Za-z0-9_.]*$"}};
  Json schema;
  if (many)
    schema = {{"anyOf", {one, {{"type", "array"}, {"items", one}}, {{"type", "null"}}}}};
  else
    schema = {{"type", {"string", "null"}}, {"pattern", one["pattern"]}};
  schema["description"] = description;
  return schema;
}

Entry input_entry(const std::string& name, const std::string& type, bool optional, bool many, const std::string& unit, const std::string& doc) {
  Entry entry{name, type, many ? "many" : optional ? "optional" : "", doc, unit, {}, !optional};
  entry.schema = reference_schema(fmt::format("{}{}: {}{}", type,
                                              many       ? ", one or a list"
                                              : optional ? ", optional"
                                                         : "",
                                              doc, unit.empty() ? "" : " [" + unit + "]"),
                                  many);
  return entry;
}

std::string words_of(const ParamBase& param) {
  const ParamSpec& spec = param.spec();
  const Literal value = param.show();
  std::string words = value.is_null() ? "no default" : "default " + value.text();
  if (spec.min && spec.max)
    words += ", " + Literal(*spec.min).text() + " to " + Literal(*spec.max).text();
  else if (spec.min)
    words += ", at least " + Literal(*spec.min).text();
  else if (spec.max)
    words += ", at most " + Literal(*spec.max).text();
  if (!spec.choices.empty()) {
    words += ", one of:";
    for (const std::string& choice : spec.choices) words += " " + choice;
  }
  return words;
}

// A group's parameter may stand wherever a value does.
Json or_parameter(Json schema) {
  const std::string description = schema.value("description", "");
  schema.erase("description");
  if (schema.contains("type") && schema["type"] == "string" && !schema.contains("enum")) {
    schema["description"] = description;
    return schema;
  }
  Json both = {{"description", description}};
  if (schema.contains("default")) {
    both["default"] = schema["default"];
    schema.erase("default");
  }
  both["anyOf"] = {schema, {{"type", "string"}, {"pattern", "^\\$[A-Za-z_][A-Za-z0-9_]*$"}}};
  return both;
}

Declaration declaration_of_group(const GraphSpec& group) {
  Declaration all;
  for (const GroupInputSpec& input : group.inputs)
    all.inputs.push_back(input_entry(input.name, input.type, input.optional, input.many, "", input.doc));
  for (const GroupParameterSpec& parameter : group.parameters) {
    Json schema = {{"description", parameter.doc}, {"default", json_of(parameter.value)}};
    if (parameter.value.as_bool())
      schema["type"] = "boolean";
    else if (parameter.value.is_number())
      schema["type"] = "number";
    else if (parameter.value.as_string())
      schema["type"] = "string";
    all.params.push_back({parameter.name, "", "default " + parameter.value.text(), parameter.doc, "", or_parameter(std::move(schema)), false});
  }
  for (const auto& [name, reference] : group.outputs) all.outputs.push_back({name, "", "", "", "", {}, false});
  return all;
}

Declaration declaration_of(const NodeType& type) {
  if (type.group) return declaration_of_group(type.group());
  Declaration all;
  const auto node = type.make();
  for (const InputDeclaration& input : node->inputs())
    all.inputs.push_back(input_entry(input.name, input.type ? input.type->name : "any", input.optional, input.many, input.spec.unit, input.spec.doc));
  for (const ParamBase* param : node->params())
    all.params.push_back({param->name(), "", words_of(*param), param->spec().doc, param->spec().unit, or_parameter(json_of(param->schema())), false});
  for (const OutputDeclaration& output : node->outputs())
    all.outputs.push_back({output.name, output.type ? output.type->name : "any", "", output.spec.doc, output.spec.unit, {}, false});
  return all;
}

Json node_schema(const NodeType& type) {
  const Declaration declared = declaration_of(type);
  Json properties = {{"type", {{"const", type.name}, {"description", node_title(type)}}}};
  Json required = Json::array({"type"});
  for (const Entry& input : declared.inputs) {
    properties[input.name] = input.schema;
    if (input.required) required.push_back(input.name);
  }
  for (const Entry& param : declared.params) properties[param.name] = param.schema;
  if (type.name == "iterate") {
    const Json references = {{"type", "object"}, {"additionalProperties", {{"type", {"string", "null"}}}}};
    properties["state"] = references;
    properties["state"]["description"] = "what goes round, and where it starts";
    properties["body"] = {{"$ref", "#/definitions/nodes"}, {"description", "nodes of one round; they read the state as state.NAME"}};
    properties["next"] = references;
    properties["next"]["description"] = "what each state is in the next round";
    for (const char* name : {"state", "body", "next"}) required.push_back(name);
  }
  if (type.name == "group") required.push_back("path");
  return {{"description", type.manual}, {"properties", properties}, {"required", required}, {"additionalProperties", type.name == "group"}};
}

Json frames_schema() {
  const Json one = {{"anyOf", {{{"type", "integer"}}, {{"type", "string"}, {"pattern", "^[-0-9x, ]+$"}}}}};
  return {{"description", "the frames that are made when --frames does not say otherwise: 12, 1-48, 1-48x2 or a list of these"},
          {"anyOf", {one["anyOf"][0], one["anyOf"][1], {{"type", "array"}, {"items", one}}}}};
}

// Text cut into lines of at most `width`, each after `indent` spaces.
std::string wrapped(const std::string& text, size_t indent, size_t width = 100) {
  std::string out, line;
  const auto flush = [&] {
    if (!line.empty()) out += std::string(indent, ' ') + line + '\n';
    line.clear();
  };
  for (size_t at = 0; at < text.size();) {
    const size_t end = std::min(text.find_first_of(" \n", at), text.size());
    const std::string word = text.substr(at, end - at);
    if (!line.empty() && indent + line.size() + 1 + word.size() > width) flush();
    if (!word.empty()) line += (line.empty() ? "" : " ") + word;
    at = end + 1;
  }
  flush();
  return out;
}

void append_entries(std::string& page, const char* heading, const std::vector<Entry>& entries) {
  if (entries.empty()) return;
  page += fmt::format("\n{}\n", heading);
  for (const Entry& entry : entries) {
    std::string head = entry.type;
    if (!entry.kind.empty()) head += (head.empty() ? "" : ", ") + entry.kind;
    if (!entry.unit.empty()) head += fmt::format(" [{}]", entry.unit);
    page += fmt::format("  {:<20} {}\n", entry.name, head);
    page += wrapped(entry.doc, 23);
  }
}

std::string joined(const std::vector<Entry>& entries) {
  std::string all;
  for (const Entry& entry : entries)
    all += fmt::format("{}`{}`{}", all.empty() ? "" : ", ", entry.name, entry.kind == "many" ? "..." : entry.kind == "optional" ? "?" : "");
  return all;
}

}  // namespace

std::string graph_schema(const Registry& registry) {
  Json definitions, choices = Json::array(), names = Json::array();
  for (const std::string& name : registry.names()) {
    names.push_back(name);
    definitions["node_" + name] = node_schema(*registry.find(name));
    choices.push_back({{"if", {{"properties", {{"type", {{"const", name}}}}}, {"required", Json::array({"type"})}}},
                       {"then", {{"$ref", "#/definitions/node_" + name}}}});
  }
  definitions["node"] = {{"type", "object"},
                         {"required", Json::array({"type"})},
                         {"properties", {{"type", {{"description", "the node type"}, {"enum", names}}}}},
                         {"allOf", choices}};
  definitions["nodes"] = {{"type", "object"},
                          {"propertyNames", {{"pattern", "^[A-Za-z_][A-Za-z0-9_]*$"}, {"not", {{"enum", {"state", "inputs", "none"}}}}}},
                          {"additionalProperties", {{"$ref", "#/definitions/node"}}}};
  const Json input = {
      {"anyOf",
       {{{"type", "string"}},
        {{"type", "object"},
         {"required", Json::array({"type"})},
         {"properties",
          {{"type", {{"type", "string"}}}, {"optional", {{"type", "boolean"}}}, {"many", {{"type", "boolean"}}}, {"doc", {{"type", "string"}}}}},
         {"additionalProperties", false}}}}};
  const Json schema = {
      {"$schema", "http://json-schema.org/draft-07/schema#"},
      {"title", "Knead graph"},
      {"type", "object"},
      {"required", Json::array({"knead", "nodes"})},
      {"additionalProperties", false},
      {"properties",
       {{"$schema", {{"description", "this schema, for an editor"}, {"type", "string"}}},
        {"knead", {{"description", "version of the graph file's format"}, {"const", 1}}},
        {"description", {{"type", "string"}}},
        {"frames", frames_schema()},
        {"nodes", {{"$ref", "#/definitions/nodes"}}},
        {"inputs", {{"description", "what the graph takes when it is used as a group"}, {"type", "object"}, {"additionalProperties", input}}},
        {"parameters", {{"description", "the group's parameters and their defaults; nodes read them as $NAME"}, {"type", "object"}}},
        {"outputs",
         {{"description", "what the graph gives when it is used as a group"}, {"type", "object"}, {"additionalProperties", {{"type", "string"}}}}}}},
      {"definitions", definitions}};
  return schema.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

std::string node_title(const NodeType& type) {
  std::string title = type.manual.substr(0, type.manual.find("\n\n"));
  std::replace(title.begin(), title.end(), '\n', ' ');
  // The first sentence; "eq. 4" does not end one.
  for (size_t stop = title.find(". "); stop != std::string::npos; stop = title.find(". ", stop + 1))
    if (stop + 2 == title.size() || !std::isdigit(static_cast<unsigned char>(title[stop + 2]))) {
      title.resize(stop);
      break;
    }
  while (!title.empty() && (title.back() == '.' || title.back() == ' ')) title.pop_back();
  return title;
}

std::string manual_page(const NodeType& type) {
  const Declaration declared = declaration_of(type);
  std::string page = fmt::format("{}\n\n{}\n", type.name, type.manual);
  append_entries(page, "Inputs", declared.inputs);
  append_entries(page, "Parameters", declared.params);
  append_entries(page, "Outputs", declared.outputs);
  return page;
}

std::string node_list(const Registry& registry) {
  std::string list;
  for (const std::string& name : registry.names()) list += fmt::format("{:<18} {}\n", name, node_title(*registry.find(name)));
  return list;
}

std::string nodes_markdown(const Registry& registry) {
  std::string table =
      "# Nodes\n\nMade by `knead nodes --markdown` from the declarations. `knead nodes NAME` prints one node's page.\n\n| node | what it does | "
      "inputs | outputs |\n|---|---|---|---|\n";
  for (const std::string& name : registry.names()) {
    const Declaration declared = declaration_of(*registry.find(name));
    std::string inputs = joined(declared.inputs), outputs = joined(declared.outputs), title = node_title(*registry.find(name));
    if (name == "iterate") inputs = "`state`, `body`, `next`", outputs = "its states, `report`";
    if (name == "group") inputs = "the file's inputs", outputs = "the file's outputs";
    for (size_t at = title.find('|'); at != std::string::npos; at = title.find('|', at + 2)) title.insert(at, "\\");
    table += fmt::format("| [`{0}`](#{0}) | {1} | {2} | {3} |\n", name, title, inputs, outputs);
  }
  for (const std::string& name : registry.names()) {
    const std::string page = manual_page(*registry.find(name));
    table += fmt::format("\n## {}\n\n```\n{}\n```\n", name, page.substr(page.find("\n\n") + 2, page.find_last_not_of('\n') - page.find("\n\n") - 1));
  }
  return table;
}

}  // namespace knead
