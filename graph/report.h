// Port types without geometry.
#pragma once
#include <limits>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "graph/value.h"

namespace knead {

struct Scalar {
  double value = 0;
};

// Named figures and words about a frame, in order.
struct KNEAD_API Report {
  std::vector<std::pair<std::string, std::variant<double, std::string>>> entries;
  void set(const std::string& name, double value);
  void set(const std::string& name, const std::string& value);
  double number(const std::string& name, double otherwise = std::numeric_limits<double>::quiet_NaN()) const;
  std::string word(const std::string& name) const;  // "" when absent
};

template <>
struct KNEAD_API PortTraits<Scalar> {
  static constexpr const char* name = "Scalar";
  template <class F>
  static void each_buffer(Scalar&, F&&) {}
  static void hash(const Scalar& v, Hasher& hasher) { hasher.add(v.value); }
};
template <>
struct KNEAD_API PortTraits<Report> {
  static constexpr const char* name = "Report";
  template <class F>
  static void each_buffer(Report&, F&&) {}
  static void hash(const Report& v, Hasher& hasher);
};

}  // namespace knead
