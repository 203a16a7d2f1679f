#include "graph/report.h"

#include <algorithm>

namespace knead {
namespace {

using Entry = std::variant<double, std::string>;

const Entry* find(const Report& report, const std::string& name) {
  const auto found = std::find_if(report.entries.begin(), report.entries.end(), [&](const auto& entry) { return entry.first == name; });
  return found == report.entries.end() ? nullptr : &found->second;
}

void put(Report& report, const std::string& name, Entry value) {
  if (const Entry* known = find(report, name))
    *const_cast<Entry*>(known) = std::move(value);
  else
    report.entries.emplace_back(name, std::move(value));
}

}  // namespace

void Report::set(const std::string& name, double value) {
  put(*this, name, value);
}
void Report::set(const std::string& name, const std::string& value) {
  put(*this, name, value);
}

double Report::number(const std::string& name, double otherwise) const {
  const Entry* entry = find(*this, name);
  return entry && std::holds_alternative<double>(*entry) ? std::get<double>(*entry) : otherwise;
}

std::string Report::word(const std::string& name) const {
  const Entry* entry = find(*this, name);
  return entry && std::holds_alternative<std::string>(*entry) ? std::get<std::string>(*entry) : std::string();
}

void PortTraits<Report>::hash(const Report& report, Hasher& hasher) {
  for (const auto& [name, value] : report.entries) {
    hasher.add(name).add(value.index());
    if (const double* number = std::get_if<double>(&value))
      hasher.add(*number);
    else
      hasher.add(std::get<std::string>(value));
  }
}

}  // namespace knead
