// Internal to io/tets.
#pragma once
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cstring>
#include <span>
#include <string_view>

#include "io/files.h"
#include "io/tets/tet_file.h"

namespace knead::tets {

// What a reader found, before it is checked.
struct Found {
  TetFile mesh;
  size_t curved = 0, other = 0;  // tets with more than four vertices; cells with a volume that are no tets
  size_t flat = 0;               // triangles and the like
};

Found read_vtu(const std::string& bytes, const std::string& path);
Found read_vtk(const std::string& bytes, const std::string& path);
Found read_msh(const std::string& bytes, const std::string& path);
Found read_tetgen(const std::string& path);  // either of its two files

std::string vtu_text(const TetFile& mesh, const std::vector<TetField>& fields);
std::string vtk_text(const TetFile& mesh, const std::vector<TetField>& fields);
std::string msh_text(const TetFile& mesh, const std::vector<TetField>& fields);

[[noreturn]] inline void fail(const std::string& path, const std::string& message, const std::string& hint = "write it again") {
  throw Error(ErrorCode::kFile, in_file(path), message, hint);
}

// VTK's numbers of its cells; of all other cells only whether they have a volume matters.
void take_vtk_cell(int type, std::span<const uint64_t> vertices, const std::string& path, Found& to);

// Text and binary numbers from front to back.
class Scanner {
 public:
  Scanner(std::string_view bytes, std::string path) : bytes_(bytes), path_(std::move(path)) {}

  bool over() { return skip(), at_ == bytes_.size(); }
  std::string_view word() {
    skip();
    const size_t begin = at_;
    while (at_ < bytes_.size() && !is_blank(bytes_[at_])) ++at_;
    return bytes_.substr(begin, at_ - begin);
  }
  std::string_view line() {  // what is left of it
    const size_t begin = at_, end = std::min(bytes_.find('\n', at_), bytes_.size());
    at_ = std::min(end + 1, bytes_.size());
    std::string_view text = bytes_.substr(begin, end - begin);
    if (text.ends_with('\r')) text.remove_suffix(1);
    return text;
  }
  template <class T = double>
  T number() {
    const std::string_view text = word();
    T value{};
    const char* first = text.data() + (text.starts_with('+') ? 1 : 0);
    const auto [end, error] = std::from_chars(first, text.data() + text.size(), value);
    if (error != std::errc{} || end != text.data() + text.size()) fail_here(fmt::format("'{}' is not a number", text.substr(0, 40)));
    return value;
  }
  template <class T>
  T raw(bool swapped = false) {
    T value;
    if (bytes_.size() - at_ < sizeof value) fail_here("the file ends too soon");
    std::array<char, sizeof(T)> from;
    std::copy_n(bytes_.data() + at_, sizeof(T), from.begin());
    if (swapped) std::reverse(from.begin(), from.end());
    std::memcpy(&value, from.data(), sizeof value);
    at_ += sizeof value;
    return value;
  }
  // A count of things that take at least so many bytes each.
  size_t count(uint64_t n, size_t least_bytes = 1) {
    if (n > (bytes_.size() - at_) / least_bytes) fail_here(fmt::format("{} entries do not fit into the file", n));
    return static_cast<size_t>(n);
  }
  void skip_comments(char mark) { comment_ = mark; }
  size_t at() const { return at_; }
  void go_to(size_t at) { at_ = at; }
  [[noreturn]] void fail_here(const std::string& message) const {
    const auto line = 1 + std::count(bytes_.begin(), bytes_.begin() + static_cast<ptrdiff_t>(at_), '\n');
    throw Error(ErrorCode::kFile, in_file(path_, static_cast<int>(line)), message, "write it again");
  }

 private:
  static bool is_blank(char c) { return c == ' ' || c == '\n' || c == '\r' || c == '\t'; }
  void skip() {
    for (;;) {
      while (at_ < bytes_.size() && is_blank(bytes_[at_])) ++at_;
      if (comment_ == 0 || at_ == bytes_.size() || bytes_[at_] != comment_) return;
      line();
    }
  }
  std::string_view bytes_;
  std::string path_;
  size_t at_ = 0;
  char comment_ = 0;
};

}  // namespace knead::tets
