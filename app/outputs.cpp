#include "app/outputs.h"

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "io/files.h"
#ifdef KNEAD_PICTURES
#include "io/picture/picture.h"
#endif

namespace knead::app {
namespace {

// "out/head.####.png" to "out/head_sheet.png"
[[maybe_unused]] std::string sheet_path(const std::string& pattern) {
  const std::filesystem::path path(pattern);
  std::string stem = path.stem().string();
  std::erase(stem, '#');
  while (!stem.empty() && (stem.back() == '.' || stem.back() == '_' || stem.back() == '-')) stem.pop_back();
  return (path.parent_path() / (stem + (stem.empty() ? "sheet" : "_sheet") + path.extension().string())).string();
}

}  // namespace

std::string path_of(const Node& node) {
  for (const ParamBase* param : node.params())
    if (const Literal value = param->show(); param->name() == "path" && value.as_string()) return *value.as_string();
  return {};
}

std::vector<std::string> files_of(const Plan& plan, int frame) {
  std::vector<std::string> files;
  for (const int sink : plan.sinks())
    if (const std::string path = path_of(*plan.nodes[static_cast<size_t>(sink)].node); !path.empty()) files.push_back(frame_path(path, frame));
  return files;
}

bool is_complete(const Evaluator& evaluator, const std::vector<std::string>& outputs, const FrameRecord& record) {
  if (!record.ok || record.key.empty()) return false;
  try {
    if (record.key != evaluator.frame_key(record.frame, outputs, true).text()) return false;
    std::vector<std::string> expected = files_of(evaluator.plan(), record.frame);
    if (expected.size() != record.files.size()) return false;
    for (const WrittenFile& file : record.files) {
      const auto found = std::find(expected.begin(), expected.end(), file.path);
      if (found == expected.end()) return false;
      expected.erase(found);
      std::error_code missing;
      if (std::filesystem::file_size(file.path, missing) != file.bytes || missing) return false;
      if (file_content_key(file.path).text() != file.hash) return false;
    }
    return true;
  } catch (const Error&) {
    return false;  // something is missing; making the frame will say what
  }
}

std::vector<std::string> write_sheets([[maybe_unused]] const Plan& plan, [[maybe_unused]] const std::vector<int>& frames) {
  std::vector<std::string> sheets;
#ifdef KNEAD_PICTURES
  for (const int sink : plan.sinks()) {
    const PlanNode& node = plan.nodes[static_cast<size_t>(sink)];
    const std::string path = path_of(*node.node);
    if (node.type->name != "write_picture" || !has_frame_pattern(path)) continue;
    std::vector<std::string> pictures;
    for (const int frame : frames) pictures.push_back(frame_path(path, frame));
    const int columns = std::clamp(static_cast<int>(std::ceil(std::sqrt(static_cast<double>(pictures.size())))), 1, 8);
    sheets.push_back(sheet_path(path));
    write_contact_sheet(sheets.back(), pictures, columns);
  }
#endif
  return sheets;
}

}  // namespace knead::app
