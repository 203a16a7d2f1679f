#include "graph/error.h"

#include <algorithm>
#include <new>
#include <numeric>
#include <utility>

namespace knead {

const char* name_of(ErrorCode code) {
  switch (code) {
    case ErrorCode::kGraph: return "graph";
    case ErrorCode::kInput: return "input";
    case ErrorCode::kFile: return "file";
    case ErrorCode::kMemory: return "memory";
    case ErrorCode::kDevice: return "device";
    case ErrorCode::kCancelled: return "cancelled";
    case ErrorCode::kInternal: return "internal";
  }
  return "unknown";
}

std::string Where::text() const {
  std::string text = file;
  if (line > 0) text.append(text.empty() ? "line " : ":").append(std::to_string(line));
  if (line > 0 && column > 0) text.append(":").append(std::to_string(column));
  const auto quote = [&](const char* what, const std::string& name) {
    if (name.empty()) return;
    text.append(text.empty() ? "" : ", ").append(what).append("'").append(name).append("'");
  };
  quote("node ", node);
  quote("", member);
  return text;
}

Error::Error(ErrorCode code, Where where, std::string message, std::string hint)
    : code_(code), where_(std::move(where)), message_(std::move(message)), hint_(std::move(hint)) {
  text_ = where_.text();
  if (!text_.empty()) text_ += ": ";
  text_ += message_;
  if (!hint_.empty()) text_.append(" (").append(hint_).append(")");
}

Error::Error(ErrorCode code, std::string message, std::string hint) : Error(code, Where{}, std::move(message), std::move(hint)) {}

Error Error::at(const Where& outer) const {
  Where full = where_;
  if (full.file.empty()) {  // a data file's own place stays; the graph's place would contradict it
    full.file = outer.file;
    full.line = outer.line;
    full.column = outer.column;
  }
  if (full.node.empty()) full.node = outer.node;
  if (full.member.empty()) full.member = outer.member;
  return Error(code_, full, message_, hint_);
}

static std::string all_lines(const std::vector<Error>& errors) {
  std::string text;
  for (const Error& error : errors) text.append(text.empty() ? "" : "\n").append(error.what());
  return text;
}

GraphErrors::GraphErrors(std::vector<Error> errors) : Error(ErrorCode::kGraph, all_lines(errors)), errors_(std::move(errors)) {}

Error error_in_flight(const Where& where) {
  try {
    throw;
  } catch (const Error& error) {
    return error.at(where);
  } catch (const std::bad_alloc&) {
    return Error(ErrorCode::kMemory, where, "out of memory");
  } catch (const std::exception& error) {
    return Error(ErrorCode::kInternal, where, error.what());
  } catch (...) {
    return Error(ErrorCode::kInternal, where, "an exception of an unknown type");
  }
}

static size_t edit_distance(const std::string& a, const std::string& b) {
  std::vector<size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), size_t{0});
  for (size_t i = 1; i <= a.size(); ++i) {
    size_t diagonal = std::exchange(row[0], i);
    for (size_t j = 1; j <= b.size(); ++j) {
      const size_t substituted = diagonal + (a[i - 1] != b[j - 1]);
      diagonal = row[j];
      row[j] = std::min({substituted, row[j] + 1, row[j - 1] + 1});
    }
  }
  return row[b.size()];
}

// A whole part of a name with underscores or dots: "depth" is one of "max_depth".
static bool is_part_of(const std::string& part, const std::string& name) {
  const auto ends = [&](size_t at) { return at == name.size() || name[at] == '_' || name[at] == '.'; };
  for (size_t at = name.find(part); at != std::string::npos; at = name.find(part, at + 1))
    if ((at == 0 || ends(at - 1)) && ends(at + part.size())) return true;
  return false;
}

// The shortest name that shares a part with `wrong`, or the one that begins like it ("rotation", "rotate").
static std::string related_name(const std::string& wrong, const std::vector<std::string>& candidates) {
  constexpr size_t kLeastPart = 3, kLeastStem = 4;
  std::string best;
  size_t longest = std::max(kLeastStem, (wrong.size() + 1) / 2) - 1;
  for (const std::string& candidate : candidates)
    if (wrong.size() >= kLeastPart && candidate.size() >= kLeastPart && (is_part_of(wrong, candidate) || is_part_of(candidate, wrong)))
      if (best.empty() || candidate.size() < best.size()) best = candidate;
  if (!best.empty()) return best;
  for (const std::string& candidate : candidates) {
    const auto differ = std::mismatch(wrong.begin(), wrong.end(), candidate.begin(), candidate.end());
    const auto same = static_cast<size_t>(differ.first - wrong.begin());
    if (same > longest && 2 * same >= candidate.size()) longest = same, best = candidate;
  }
  return best;
}

std::string nearest_name(const std::string& wrong, const std::vector<std::string>& candidates) {
  std::string best;
  size_t best_distance = std::max<size_t>(2, wrong.size() / 3) + 1;
  for (const std::string& candidate : candidates) {
    const size_t distance = edit_distance(wrong, candidate);
    if (distance < best_distance) {
      best_distance = distance;
      best = candidate;
    }
  }
  return best.empty() ? related_name(wrong, candidates) : best;
}

}  // namespace knead
