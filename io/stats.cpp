#include "io/stats.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "graph/report.h"
#include "io/files.h"

namespace knead {
namespace {

using Json = nlohmann::ordered_json;

Json json_of(double value) {
  constexpr double kExact = 9007199254740992.0;  // integers up to here are written without a fraction
  if (!std::isfinite(value)) return nullptr;
  if (value == std::floor(value) && std::abs(value) < kExact && !(value == 0 && std::signbit(value))) return static_cast<int64_t>(value);
  return value;
}

std::string node_of(const std::string& reference) {
  return reference.substr(0, reference.rfind('.'));
}

void merge_reports(Json& line, const FrameResult& result, const std::vector<ReportOutput>& outputs) {
  struct Givers {
    int all = 0, summaries = 0;
  };
  std::map<std::string, Givers> givers;
  for (const char* own : {"frame", "ok", "seconds", "error", "error_kind", "times", "warnings", "key", "files"}) givers[own] = {2, 2};
  std::vector<std::pair<const ReportOutput*, const Report*>> reports;
  for (const ReportOutput& output : outputs)
    if (const auto found = result.values.find(output.reference); found != result.values.end())
      if (const Report* report = found->second.get_if<Report>()) {
        reports.emplace_back(&output, report);
        std::set<std::string> names;
        for (const auto& [name, value] : report->entries)
          if (names.insert(name).second) ++givers[name].all, givers[name].summaries += output.is_summary;
      }
  for (const auto& [output, report] : reports)
    for (const auto& [name, value] : report->entries) {
      const bool plain = givers[name].all == 1 || (output->is_summary && givers[name].summaries == 1);
      Json& at = line[plain ? name : node_of(output->reference) + "." + name];
      if (const double* number = std::get_if<double>(&value))
        at = json_of(*number);
      else
        at = std::get<std::string>(value);
    }
}

std::string line_of(const Json& json) {
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

[[noreturn]] void fail(const std::string& path, const char* doing, int error) {
  throw Error(ErrorCode::kFile, in_file(path), std::string("the figures cannot be ") + doing + ": " + std::strerror(error),
              "name another file with --stats");
}

}  // namespace

WrittenFile written_file(const std::string& path) {
  const std::string hash = file_content_key(path).text();
  std::error_code failed;
  const uintmax_t bytes = std::filesystem::file_size(path, failed);
  return {path, failed ? 0 : static_cast<uint64_t>(bytes), hash};
}

std::string stats_line(const FrameResult& result, const std::vector<ReportOutput>& reports, const std::string& key,
                       const std::vector<WrittenFile>& files) {
  Json line;
  line["frame"] = result.frame;
  line["ok"] = !result.error.has_value();
  if (result.error) {
    line["error"] = result.error->what();
    line["error_kind"] = name_of(result.error->code());
  }
  line["seconds"] = json_of(result.seconds);
  merge_reports(line, result, reports);
  Json& times = line["times"] = Json::object();
  for (const NodeTime& time : result.times)
    if (!time.cached) times[time.name] = json_of(time.seconds);
  line["warnings"] = result.warnings;
  if (!key.empty()) line["key"] = key;
  Json& written = line["files"] = Json::array();
  for (const WrittenFile& file : files) written.push_back({{"path", file.path}, {"bytes", file.bytes}, {"hash", file.hash}});
  return line_of(line);
}

bool read_stats_line(const std::string& line, FrameRecord& record) {
  const Json json = Json::parse(line, nullptr, false);
  if (!json.is_object() || !json.contains("frame") || !json["frame"].is_number_integer() || !json.contains("ok") || !json["ok"].is_boolean())
    return false;
  record = {};
  record.frame = json["frame"].get<int>();
  record.ok = json["ok"].get<bool>();
  if (json.contains("key") && json["key"].is_string()) record.key = json["key"].get<std::string>();
  if (!json.contains("files") || !json["files"].is_array()) return true;
  for (const Json& file : json["files"]) {
    if (!file.is_object() || !file.contains("path") || !file["path"].is_string() || !file.contains("bytes") || !file["bytes"].is_number_unsigned() ||
        !file.contains("hash") || !file["hash"].is_string())
      return false;
    record.files.push_back({file["path"].get<std::string>(), file["bytes"].get<uint64_t>(), file["hash"].get<std::string>()});
  }
  return true;
}

StatsFile::StatsFile(std::string path, bool keep) : path_(std::move(path)) {
  namespace fs = std::filesystem;
  std::error_code failed;
  const fs::path folder = fs::path(path_).parent_path();
  if (!folder.empty()) fs::create_directories(folder, failed);
  if (failed) fail(path_, "written", failed.value());
  bool cut_short = false;
  if (keep && fs::is_regular_file(path_, failed)) {
    const std::string text = read_whole_file(path_);
    cut_short = !text.empty() && text.back() != '\n';
    std::istringstream in(text);
    for (std::string line; std::getline(in, line);)
      if (FrameRecord record; read_stats_line(line, record)) {
        lines_[record.frame] = line;
        earlier_[record.frame] = record;
      }
  }
  file_ = ::open(path_.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC | (keep ? 0 : O_TRUNC), 0666);
  if (file_ < 0) fail(path_, "written", errno);
  struct stat status {};
  is_regular_ = ::fstat(file_, &status) == 0 && S_ISREG(status.st_mode);
  if (cut_short && ::write(file_, "\n", 1) != 1) fail(path_, "written", errno);  // must not join the next line
}

StatsFile::~StatsFile() {
  if (file_ >= 0) ::close(file_);
}

const FrameRecord* StatsFile::earlier(int frame) const {
  const auto found = earlier_.find(frame);
  return found == earlier_.end() ? nullptr : &found->second;
}

void StatsFile::add(int frame, const std::string& line) {
  const std::string whole = line + '\n';
  lines_[frame] = line;
  const off_t before = is_regular_ ? ::lseek(file_, 0, SEEK_END) : 0;
  ssize_t written;
  do written = ::write(file_, whole.data(), whole.size());
  while (written < 0 && errno == EINTR);
  if (written == static_cast<ssize_t>(whole.size())) return;
  const int error = written < 0 ? errno : ENOSPC;
  if (is_regular_ && ::ftruncate(file_, before) != 0) fail(path_, "shortened", errno);
  fail(path_, "written", error);
}

void StatsFile::finish() {
  if (!is_regular_) return;
  std::string all;
  for (const auto& [frame, line] : lines_) all += line + '\n';
  write_whole_file(path_, all);
}

}  // namespace knead
