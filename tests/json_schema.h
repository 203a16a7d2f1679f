// The part of JSON schema (draft 7) that the schema of stats.jsonl uses. A keyword beyond it is an error, so that nothing passes unseen.
#pragma once
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string>

namespace json_schema {

using nlohmann::json;

inline bool has_type(const json& value, const std::string& type) {
  if (type == "object") return value.is_object();
  if (type == "array") return value.is_array();
  if (type == "string") return value.is_string();
  if (type == "boolean") return value.is_boolean();
  if (type == "null") return value.is_null();
  if (type == "integer") return value.is_number_integer();
  return type == "number" && value.is_number();
}

// What is wrong with `value`, with its place; "" when it is as the schema says.
inline std::string errors_of(const json& schema, const json& value, const std::string& at = "line") {
  if (schema.is_boolean()) return schema.get<bool>() ? "" : at + " must not be there\n";
  std::string wrong;
  for (const auto& [keyword, rule] : schema.items()) {
    if (keyword == "$schema" || keyword == "title" || keyword == "description") continue;
    if (keyword == "type") {
      const json types = rule.is_array() ? rule : json::array({rule});
      if (std::none_of(types.begin(), types.end(), [&](const json& type) { return has_type(value, type); }))
        wrong += at + " is no " + rule.dump() + '\n';
    } else if (keyword == "const") {
      if (value != rule) wrong += at + " is not " + rule.dump() + '\n';
    } else if (keyword == "enum") {
      if (std::find(rule.begin(), rule.end(), value) == rule.end()) wrong += at + " is none of " + rule.dump() + '\n';
    } else if (keyword == "minimum") {
      if (value.is_number() && value.get<double>() < rule.get<double>()) wrong += at + " is below " + rule.dump() + '\n';
    } else if (keyword == "required") {
      for (const json& name : rule)
        if (value.is_object() && !value.contains(name.get<std::string>())) wrong += at + " lacks " + name.dump() + '\n';
    } else if (keyword == "properties" || keyword == "additionalProperties") {
      const json known = schema.value("properties", json::object());
      if (!value.is_object()) continue;
      for (const auto& [name, item] : value.items())
        if (known.contains(name) == (keyword == "properties"))
          wrong += errors_of(keyword == "properties" ? known[name] : rule, item, at + "." + name);
    } else if (keyword == "items") {
      if (value.is_array())
        for (size_t i = 0; i < value.size(); ++i) wrong += errors_of(rule, value[i], at + "[" + std::to_string(i) + "]");
    } else {
      wrong += "the schema uses '" + keyword + "', which this test does not know\n";
    }
  }
  return wrong;
}

}  // namespace json_schema
