#include "graph/param.h"

#include <cmath>
#include <limits>

namespace knead {

static std::string expected(const char* what, const Literal& literal) {
  return std::string("expected ") + what + ", found " + literal.kind();
}

std::string ParamTraits<bool>::parse(const Literal& literal, bool& out) {
  if (const bool* v = literal.as_bool()) return out = *v, "";
  return expected("true or false", literal);
}
std::string ParamTraits<int>::parse(const Literal& literal, int& out) {
  const int64_t* v = literal.as_int();
  if (!v) return expected("an integer", literal);
  if (*v < std::numeric_limits<int>::min() || *v > std::numeric_limits<int>::max()) return "the integer is too large";
  out = static_cast<int>(*v);
  return "";
}
std::string ParamTraits<double>::parse(const Literal& literal, double& out) {
  if (!literal.is_number()) return expected("a number", literal);
  if (!std::isfinite(literal.number())) return "expected a finite number";
  out = literal.number();
  return "";
}
std::string ParamTraits<std::string>::parse(const Literal& literal, std::string& out) {
  if (const std::string* v = literal.as_string()) return out = *v, "";
  return expected("a text", literal);
}
std::string ParamTraits<Triple>::parse(const Literal& literal, Triple& out) {
  const Literal::List* list = literal.as_list();
  if (!list) return expected("three numbers [x, y, z]", literal);
  if (list->size() != 3) return "expected three numbers [x, y, z], found " + std::to_string(list->size());
  Triple parsed{};
  for (size_t k = 0; k < 3; ++k)
    if (std::string wrong = ParamTraits<double>::parse((*list)[k], parsed[k]); !wrong.empty()) return "three numbers [x, y, z]: " + wrong;
  out = parsed;
  return "";
}
Literal ParamTraits<Triple>::schema() {
  return Literal::Map{{"type", "array"}, {"items", Literal::Map{{"type", "number"}}}, {"minItems", 3}, {"maxItems", 3}};
}
std::string ParamTraits<Literal>::parse(const Literal& literal, Literal& out) {
  return out = literal, "";
}

}  // namespace knead
