#include "app/strict.h"

#include <fmt/format.h>

#include <cmath>
#include <map>

#include "app/common.h"

namespace knead::app {
namespace {

// Short words for the figures that most people mean.
std::string figure_of(const std::string& word) {
  static const std::map<std::string, std::string> known{
      {"penetration", "penetration_max_relative"}, {"volume", "volume_error"}, {"inverted", "inverted_tets"}, {"stretch", "stretch_max"}};
  const auto found = known.find(word);
  return found == known.end() ? word : found->second;
}

std::vector<std::string> parts_of(const std::string& text) {
  std::vector<std::string> parts;
  for (size_t start = 0; start <= text.size();) {
    const size_t end = std::min(text.find(',', start), text.size());
    parts.push_back(text.substr(start, end - start));
    start = end + 1;
  }
  return parts;
}

// A node's own `measure` says what the result is like; other reports tell what was found on the way.
std::vector<std::pair<const NodeFigures*, double>> told(const std::vector<NodeFigures>& nodes, const std::string& figure) {
  std::vector<std::pair<const NodeFigures*, double>> all, measured;
  for (const NodeFigures& node : nodes) {
    const size_t own = figure.starts_with(node.name + ".") ? node.name.size() + 1 : 0;
    const double value = node.report.number(figure.substr(own));
    if (std::isnan(value)) continue;
    all.emplace_back(&node, value);
    if (own == 0 && node.type == "measure") measured.emplace_back(&node, value);
  }
  return measured.empty() ? all : measured;
}

}  // namespace

bool is_strictness(const std::string& word) {
  for (const std::string& part : parts_of(word))
    if (part != "rest" && part != "warnings" && part.find('=') == std::string::npos) return false;
  return true;
}

Strict::Strict(const std::string& text) {
  if (text.empty()) return;
  for (const std::string& part : parts_of(text)) {
    const size_t equals = part.find('=');
    if (part == "rest") {
      rest_ = true;
    } else if (part == "warnings") {
      warnings_ = true;
    } else {
      char* end = nullptr;
      const std::string number = equals == std::string::npos ? "" : part.substr(equals + 1);
      const double most = std::strtod(number.c_str(), &end);
      if (equals == 0 || number.empty() || *end != '\0' || !(most >= 0))
        throw UsageError(fmt::format("--strict {}: expected rest, warnings or FIGURE=LIMIT, such as rest,penetration=1e-3", text));
      limits_.push_back({figure_of(part.substr(0, equals)), most});
    }
  }
}

std::vector<std::string> Strict::objections(const Verdict& verdict) {
  std::vector<std::string> all;
  if (rest_)
    for (const std::string& node : verdict.restless) all.push_back(fmt::format("node '{}' did not come to rest", node));
  if (warnings_)
    for (const NodeFigures& node : verdict.nodes)
      for (const std::string& warning : node.warnings) all.push_back(fmt::format("node '{}' warns: {}", node.name, warning));
  for (Limit& limit : limits_)
    for (const auto& [node, value] : told(verdict.nodes, limit.figure)) {
      limit.told = true;
      if (!(std::abs(value) <= limit.most))
        all.push_back(fmt::format("node '{}': {} is {:.4g}, beyond the limit of {:.4g}", node->name, limit.figure, value, limit.most));
    }
  return all;
}

std::vector<std::string> Strict::unknown_figures() const {
  std::vector<std::string> unknown;
  for (const Limit& limit : limits_)
    if (!limit.told) unknown.push_back(limit.figure);
  return unknown;
}

}  // namespace knead::app
