#include "io/stats.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>

#include "graph/iterate.h"
#include "io/files.h"

namespace knead {
namespace {

using Json = nlohmann::ordered_json;

constexpr int kVersion = 1;
const std::vector<std::string> kErrorKinds = {"graph", "input", "file", "memory", "device", "cancelled", "internal"};

Json json_of(double value) {
  constexpr double kExact = 9007199254740992.0;  // integers up to here are written without a fraction
  if (!std::isfinite(value)) return nullptr;
  if (value == std::floor(value) && std::abs(value) < kExact && !(value == 0 && std::signbit(value))) return static_cast<int64_t>(value);
  return value;
}

Json json_of(const Report& report) {
  Json figures = Json::object();
  for (const auto& [name, value] : report.entries) {
    if (const double* number = std::get_if<double>(&value))
      figures[name] = json_of(*number);
    else
      figures[name] = std::get<std::string>(value);
  }
  return figures;
}

void append_nodes(const Plan& plan, const std::vector<char>* wanted, std::vector<StatsNode>& nodes) {
  for (size_t i = 0; i < plan.nodes.size(); ++i) {
    if (wanted && !(*wanted)[i]) continue;
    const PlanNode& node = plan.nodes[i];
    StatsNode entry{node.name, node.type->name, ""};
    for (const OutputDeclaration& output : node.node->outputs())
      if (wanted && output.type && same_type(*output.type, port_type<Report>())) entry.report = node.name + "." + output.name;
    nodes.push_back(std::move(entry));
    if (const auto* loop = dynamic_cast<const Iterate*>(node.node.get())) append_nodes(loop->body(), nullptr, nodes);
  }
}

// The node's name and the message of "node 'tets': open surface ...".
std::pair<std::string, std::string> split_warning(const std::string& warning) {
  const std::string before = "node '", after = "': ";
  const size_t end = warning.find(after);
  if (!warning.starts_with(before) || end == std::string::npos) return {"", warning};
  return {warning.substr(before.size(), end - before.size()), warning.substr(end + after.size())};
}

// Times, reports and warnings by node. A node that the frame did not come to, because it failed before, is left out.
Json nodes_of(const FrameResult& result, const std::vector<StatsNode>& nodes) {
  std::map<std::string, const NodeTime*> times;
  for (const NodeTime& time : result.times) times[time.name] = &time;
  std::map<std::string, Json> warnings;
  for (const std::string& warning : result.warnings) {
    auto [name, message] = split_warning(warning);
    warnings[name].push_back(std::move(message));
  }
  Json all = Json::object();
  for (const StatsNode& node : nodes) {
    const auto time = times.find(node.name);
    const auto warned = warnings.find(node.name);
    const auto value = node.report.empty() ? result.values.end() : result.values.find(node.report);
    if (result.error && time == times.end() && warned == warnings.end()) continue;
    Json& entry = all[node.name] = {{"type", node.type}};
    entry["seconds"] = time == times.end() ? Json(0) : json_of(time->second->seconds);
    entry["cached"] = time == times.end() || time->second->cached;
    if (time != times.end() && time->second->set_up > 0) entry["set_up_seconds"] = json_of(time->second->set_up);
    if (value != result.values.end())
      if (const Report* report = value->second.get_if<Report>()) entry["report"] = json_of(*report);
    if (warned != warnings.end()) entry["warnings"] = warned->second;
  }
  return all;
}

// What is read back of a member; false when it is there and of another type.
template <class T>
bool read(const Json& json, const char* name, bool (Json::*is)() const noexcept, T& value) {
  const auto found = json.find(name);
  if (found == json.end()) return true;
  if (!((*found).*is)()) return false;
  value = found->get<T>();
  return true;
}

}  // namespace

WrittenFile written_file(const std::string& path) {
  const std::string hash = file_content_key(path).text();
  std::error_code failed;
  const uintmax_t bytes = std::filesystem::file_size(path, failed);
  return {path, failed ? 0 : static_cast<uint64_t>(bytes), hash};
}

std::vector<StatsNode> stats_nodes(const Plan& plan, const std::vector<Source>& targets) {
  const std::vector<char> reached = plan.reached_from(targets);
  std::vector<StatsNode> nodes;
  append_nodes(plan, &reached, nodes);
  return nodes;
}

std::string stats_line(const FrameResult& result, const std::vector<StatsNode>& nodes, const FrameRecord& made) {
  Json line = {{"version", kVersion}, {"frame", result.frame}, {"ok", !result.error.has_value()}};
  if (!made.graph.empty()) line["graph"] = made.graph;
  if (!made.only.empty()) line["only"] = made.only;
  if (result.error) {
    line["error"] = result.error->what();
    line["error_kind"] = name_of(result.error->code());
  }
  line["seconds"] = json_of(result.seconds);
  line["nodes"] = nodes_of(result, nodes);
  Json& files = line["files"] = Json::array();
  for (const WrittenFile& file : made.files) files.push_back({{"path", file.path}, {"bytes", file.bytes}, {"hash", file.hash}});
  if (!made.key.empty()) line["key"] = made.key;
  return line.dump(-1, ' ', false, Json::error_handler_t::replace);
}

bool read_stats_line(const std::string& line, FrameRecord& record) {
  const Json json = Json::parse(line, nullptr, false);
  record = {};
  record.line = line;
  if (!json.is_object() || !json.contains("frame") || !json.contains("ok")) return false;
  if (!read(json, "frame", &Json::is_number_integer, record.frame) || !read(json, "ok", &Json::is_boolean, record.ok) ||
      !read(json, "version", &Json::is_number_integer, record.version) || !read(json, "graph", &Json::is_string, record.graph) ||
      !read(json, "key", &Json::is_string, record.key))
    return false;
  if (json.contains("only"))
    for (const Json& name : json["only"])
      if (name.is_string()) record.only.push_back(name.get<std::string>());
  if (!json.contains("files") || !json["files"].is_array()) return true;
  for (const Json& file : json["files"]) {
    WrittenFile written;
    if (!file.is_object() || !file.contains("path") || !file.contains("bytes") || !file.contains("hash") ||
        !read(file, "path", &Json::is_string, written.path) || !read(file, "bytes", &Json::is_number_unsigned, written.bytes) ||
        !read(file, "hash", &Json::is_string, written.hash))
      return false;
    record.files.push_back(std::move(written));
  }
  return true;
}

std::vector<NodeFigures> read_node_figures(const std::string& line) {
  std::vector<NodeFigures> nodes;
  const Json json = Json::parse(line, nullptr, false);
  if (!json.is_object() || !json.contains("nodes")) return nodes;
  for (const auto& [name, entry] : json["nodes"].items()) {
    NodeFigures node;
    node.name = name;
    if (!entry.is_object() || !read(entry, "type", &Json::is_string, node.type)) continue;
    if (const auto report = entry.find("report"); report != entry.end())
      for (const auto& [figure, value] : report->items()) {
        if (value.is_string()) node.report.set(figure, value.get<std::string>());
        if (value.is_number()) node.report.set(figure, value.get<double>());
      }
    if (const auto warnings = entry.find("warnings"); warnings != entry.end())
      for (const Json& warning : *warnings)
        if (warning.is_string()) node.warnings.push_back(warning.get<std::string>());
    nodes.push_back(std::move(node));
  }
  return nodes;
}

std::string stats_schema() {
  const auto text = [](const char* doc) { return Json{{"description", doc}, {"type", "string"}}; };
  const auto seconds = [](const char* doc) { return Json{{"description", doc}, {"type", "number"}, {"minimum", 0}}; };
  const auto list = [](const char* doc, Json items) { return Json{{"description", doc}, {"type", "array"}, {"items", std::move(items)}}; };
  const auto object = [](const char* doc, Json properties, Json required) {
    return Json{{"description", doc},
                {"type", "object"},
                {"required", std::move(required)},
                {"properties", std::move(properties)},
                {"additionalProperties", false}};
  };
  const Json report = {{"description", "the node's figures: numbers and words; null for what is no finite number"},
                       {"type", "object"},
                       {"additionalProperties", {{"type", {"number", "string", "null"}}}}};
  const Json node = object("a node that the frame stands on",
                           {{"type", text("the node type")},
                            {"seconds", seconds("spent in this frame; 0 for what was there already")},
                            {"cached", {{"description", "the result was there already"}, {"type", "boolean"}}},
                            {"set_up_seconds", seconds("spent once, for all frames of the run")},
                            {"report", report},
                            {"warnings", list("what the node warned of", {{"type", "string"}})}},
                           {"type", "seconds", "cached"});
  const Json file = object("a file that the frame wrote",
                           {{"path", text("as it was written to")},
                            {"bytes", {{"description", "its size"}, {"type", "integer"}, {"minimum", 0}}},
                            {"hash", text("of its contents")}},
                           {"path", "bytes", "hash"});
  Json line =
      object("A line of stats.jsonl: what is known of a frame.",
             {{"version", {{"description", "of this format"}, {"const", kVersion}}},
              {"frame", {{"description", "the frame"}, {"type", "integer"}}},
              {"ok", {{"description", "false for a frame that failed"}, {"type", "boolean"}}},
              {"graph", text("the graph file, as the run named it")},
              {"only", list("the writers that ran alone (--only)", {{"type", "string"}})},
              {"error", text("why the frame failed")},
              {"error_kind", {{"description", "the kind of the error"}, {"enum", kErrorKinds}}},
              {"seconds", seconds("wall clock of the frame, without the set-up of the run")},
              {"nodes", {{"description", "by name, with the groups and loops they stand in"}, {"type", "object"}, {"additionalProperties", node}}},
              {"files", list("the files that the frame wrote", file)},
              {"key", text("changes with everything that the frame depends on")}},
             {"version", "frame", "ok", "seconds", "nodes", "files"});
  const Json schema = {{"$schema", "http://json-schema.org/draft-07/schema#"}, {"title", "Knead figures"}};
  line.insert(schema.begin(), schema.end());
  return line.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace knead
