// A tree of plain values as written in a graph file or in C++ calls: what YAML and JSON can say, with the place it came from.
#pragma once
#include <cstdint>
#include <initializer_list>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "graph/api.h"

namespace knead {

struct KNEAD_API Literal {
  using List = std::vector<Literal>;
  using Map = std::vector<std::pair<Literal, Literal>>;  // in the order of the file; keys may be numbers

  std::variant<std::monostate, bool, int64_t, double, std::string, List, Map> value;
  int line = 0;
  int column = 0;

  Literal() = default;
  Literal(bool v) : value(v) {}
  Literal(int v) : value(static_cast<int64_t>(v)) {}
  Literal(int64_t v) : value(v) {}
  Literal(double v) : value(v) {}
  Literal(float v) : value(static_cast<double>(v)) {}
  Literal(const char* v) : value(std::string(v)) {}
  Literal(std::string v) : value(std::move(v)) {}
  Literal(List v) : value(std::move(v)) {}
  Literal(Map v) : value(std::move(v)) {}

  bool is_null() const { return std::holds_alternative<std::monostate>(value); }
  bool is_number() const { return std::holds_alternative<int64_t>(value) || std::holds_alternative<double>(value); }
  double number() const { return std::holds_alternative<int64_t>(value) ? static_cast<double>(std::get<int64_t>(value)) : std::get<double>(value); }
  const bool* as_bool() const { return std::get_if<bool>(&value); }
  const int64_t* as_int() const { return std::get_if<int64_t>(&value); }
  const std::string* as_string() const { return std::get_if<std::string>(&value); }
  const List* as_list() const { return std::get_if<List>(&value); }
  const Map* as_map() const { return std::get_if<Map>(&value); }
  Map* as_map() { return std::get_if<Map>(&value); }
  const Literal* find(const std::string& key) const;  // in a map, by string key; null when absent or not a map
  const char* kind() const;                           // "a number", "a list", ... for messages
  std::string text() const;                           // one line of JSON
};

}  // namespace knead
