#include "graph/literal.h"

#include <charconv>
#include <cmath>

namespace knead {

const Literal* Literal::find(const std::string& key) const {
  if (const Map* map = as_map())
    for (const auto& [name, item] : *map)
      if (const std::string* text = name.as_string(); text && *text == key) return &item;
  return nullptr;
}

const char* Literal::kind() const {
  constexpr const char* kinds[] = {"nothing", "true or false", "an integer", "a number", "a text", "a list", "a map"};
  return kinds[value.index()];
}

static std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') {
      out += '\\';
      out += c;
    } else if (c == '\n') {
      out += "\\n";
    } else if (c == '\t') {
      out += "\\t";
    } else if (static_cast<unsigned char>(c) < 0x20) {
      constexpr char digits[] = "0123456789abcdef";
      out += std::string("\\u00") + digits[(c >> 4) & 15] + digits[c & 15];
    } else {
      out += c;
    }
  }
  return out + '"';
}

std::string Literal::text() const {
  struct Writer {
    std::string operator()(std::monostate) const { return "null"; }
    std::string operator()(bool v) const { return v ? "true" : "false"; }
    std::string operator()(int64_t v) const { return std::to_string(v); }
    std::string operator()(double v) const {
      if (!std::isfinite(v)) return std::isnan(v) ? "\"nan\"" : v > 0 ? "\"inf\"" : "\"-inf\"";
      char digits[32];
      return std::string(digits, std::to_chars(digits, digits + sizeof digits, v).ptr);
    }
    std::string operator()(const std::string& v) const { return quoted(v); }
    std::string operator()(const List& v) const {
      std::string out = "[";
      for (const Literal& item : v) out += (out.size() > 1 ? ", " : "") + item.text();
      return out + "]";
    }
    std::string operator()(const Map& v) const {
      std::string out = "{";
      for (const auto& [key, item] : v)
        out += (out.size() > 1 ? ", " : "") + (key.as_string() ? key.text() : quoted(key.text())) + ": " + item.text();
      return out + "}";
    }
  };
  return std::visit(Writer{}, value);
}

}  // namespace knead
