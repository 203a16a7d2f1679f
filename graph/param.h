// How a parameter type is read from a literal, shown, hashed and described in the JSON schema. Specialise ParamTraits<T> for a type of your own.
#pragma once
#include <array>
#include <optional>
#include <string>
#include <vector>

#include "graph/hash.h"
#include "graph/literal.h"

namespace knead {

struct ParamLimits {
  std::optional<double> min, max;    // inclusive, for numbers
  std::vector<std::string> choices;  // for strings; empty: anything
};

// parse: returns "" and fills `out`, or says what was expected ("a number").
template <class T>
struct ParamTraits;

template <>
struct KNEAD_API ParamTraits<bool> {
  static std::string parse(const Literal& literal, bool& out);
  static Literal show(bool v) { return v; }
  static void hash(Hasher& h, bool v) { h.add(v); }
  static Literal schema() { return Literal::Map{{"type", "boolean"}}; }
};
template <>
struct KNEAD_API ParamTraits<int> {
  static std::string parse(const Literal& literal, int& out);
  static Literal show(int v) { return v; }
  static void hash(Hasher& h, int v) { h.add(v); }
  static Literal schema() { return Literal::Map{{"type", "integer"}}; }
};
template <>
struct KNEAD_API ParamTraits<double> {
  static std::string parse(const Literal& literal, double& out);
  static Literal show(double v) { return v; }
  static void hash(Hasher& h, double v) { h.add(v); }
  static Literal schema() { return Literal::Map{{"type", "number"}}; }
};
template <>
struct KNEAD_API ParamTraits<std::string> {
  static std::string parse(const Literal& literal, std::string& out);
  static Literal show(const std::string& v) { return v; }
  static void hash(Hasher& h, const std::string& v) { h.add(v); }
  static Literal schema() { return Literal::Map{{"type", "string"}}; }
};
using Triple = std::array<double, 3>;  // [x, y, z]
template <>
struct KNEAD_API ParamTraits<Triple> {
  static std::string parse(const Literal& literal, Triple& out);
  static Literal show(const Triple& v) { return Literal::List{v[0], v[1], v[2]}; }
  static void hash(Hasher& h, const Triple& v) { h.add(v[0]).add(v[1]).add(v[2]); }
  static Literal schema();
};
// Any tree, kept as written: for parameters with a structure of their own, which the node checks in `configure`.
template <>
struct KNEAD_API ParamTraits<Literal> {
  static std::string parse(const Literal& literal, Literal& out);
  static Literal show(const Literal& v) { return v; }
  static void hash(Hasher& h, const Literal& v) { h.add(v.text()); }
  static Literal schema() { return Literal::Map{}; }
};

}  // namespace knead
