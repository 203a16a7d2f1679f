// Text in and out for the mesh formats: places of errors, numbers in double, shortest exact output.
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "io/mesh/raw_mesh.h"

namespace knead::mesh {

namespace {

// A double that lies exactly between two floats may be the rounded image of a text that does not: the text decides which float it becomes.
void settle_midpoint(const char* at, const char* end, double& value) {
  if ((std::bit_cast<uint64_t>(value) & 0x1fffffffu) != 0x10000000u) return;
  float nearest = 0;
  if (std::from_chars(at, end, nearest).ec != std::errc{}) return;
  if (static_cast<float>(value) != nearest) value = std::nextafter(value, static_cast<double>(nearest));
}

}  // namespace

const char* parse_number(const char* at, const char* end, double& value) {
  if (at < end && *at == '+' && at + 1 < end && at[1] != '-') ++at;
  const auto result = std::from_chars(at, end, value);
  if (result.ec == std::errc::result_out_of_range) {
    long double wide = 0;
    if (std::from_chars(at, end, wide).ec == std::errc{})
      value = static_cast<double>(wide);
    else
      value = HUGE_VAL;
    return result.ptr;
  }
  if (result.ec != std::errc{}) return nullptr;
  settle_midpoint(at, end, value);
  return result.ptr;
}

TextReader::TextReader(std::string_view text, std::string name, bool continued)
    : name_(std::move(name)), begin_(text.data()), end_(begin_ + text.size()), continued_(continued) {
  at_ = line_begin_ = line_end_ = next_ = begin_ + (text.starts_with("\xef\xbb\xbf") ? 3 : 0);
  find_newline();
}

void TextReader::find_newline() {
  const void* found = next_ == end_ ? nullptr : std::memchr(next_, '\n', static_cast<size_t>(end_ - next_));
  newline_ = found ? static_cast<const char*>(found) : end_;
}

bool TextReader::next_line() {
  if (next_ == end_) {
    at_ = line_begin_ = line_end_ = end_;
    return false;
  }
  line_ = next_line_;
  at_ = line_begin_ = next_;
  for (;;) {
    // Lines end with \n, \r\n or, as old programs wrote, \r.
    if (newline_ < next_) find_newline();
    const char* stop = newline_;
    const auto* lone = static_cast<const char*>(std::memchr(next_, '\r', static_cast<size_t>(stop - next_)));
    if (lone && lone + 1 < stop) stop = lone;
    ++next_line_;
    line_end_ = stop;
    next_ = stop == end_ ? end_ : stop + 1;
    const char* last = line_end_;
    while (last > line_begin_ && last[-1] == '\r') --last;
    if (!continued_ || next_ == end_ || last == line_begin_ || last[-1] != '\\' || *line_begin_ == '#') return true;
  }
}

bool TextReader::next_full_line() {
  while (next_line())
    if (!line_is_over() && *at_ != '#') return true;
  return false;
}

std::string_view TextReader::word() {
  skip_blanks();
  const char* first = at_;
  while (at_ < line_end_ && !is_blank(*at_)) ++at_;
  return {first, static_cast<size_t>(at_ - first)};
}

std::string_view TextReader::rest() {
  skip_blanks();
  const char* first = at_;
  const char* last = line_end_;
  while (last > first && is_blank(last[-1])) --last;
  at_ = line_end_;
  return {first, static_cast<size_t>(last - first)};
}

void TextReader::fail_number(const char* what, const char* kind) const {
  const char* stop = at_;
  while (stop < line_end_ && !is_blank(*stop)) ++stop;
  const std::string_view found(at_, static_cast<size_t>(stop - at_));
  if (found.empty()) fail(std::string("the line ends where ") + what + " should stand");
  fail(shown(found) + " stands where " + what + " should: not " + kind);
}

double TextReader::number(const char* what) {
  skip_blanks();
  double value = 0;
  const char* after = parse_number(at_, line_end_, value);
  if (!after || (after < line_end_ && !is_blank(*after))) fail_number(what, "a number");
  at_ = after;
  return value;
}

int64_t TextReader::integer(const char* what) {
  skip_blanks();
  int64_t value = 0;
  const char* first = at_ < line_end_ && *at_ == '+' ? at_ + 1 : at_;
  const auto result = std::from_chars(first, line_end_, value);
  if (result.ec != std::errc{}) fail_number(what, "a whole number");
  at_ = result.ptr;
  return value;
}

void TextReader::fail(const std::string& message, const std::string& hint) const {
  const bool on_line = line_ > 0 && at_ >= line_begin_;
  throw Error(ErrorCode::kFile, in_file(name_, line_, on_line ? static_cast<int>(at_ - line_begin_) + 1 : 0), message, hint);
}

void TextReader::fail_at_line(int line, const std::string& message, const std::string& hint) const {
  throw Error(ErrorCode::kFile, in_file(name_, line), message, hint);
}

TextWriter& TextWriter::whole(int64_t v) {
  char digits[24];
  out_.append(digits, std::to_chars(digits, digits + sizeof digits, v).ptr);
  return *this;
}

TextWriter& TextWriter::point(const Surface& surface, size_t vertex) {
  const Vec3f p = surface.points.host()[vertex];
  return surface.placement.is_identity() ? vector(p) : vector(surface.placement.apply(to_double(p)));
}

void BadVertices::check(const Vec3d& p, size_t number, int line) {
  if (std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z)) return;
  ++count_;
  if (count_ == 1) first_line_ = line;
  if (count_ > 5) return;
  if (count_ > 1) listed_ += ", ";
  listed_ += "vertex " + std::to_string(number) + (line > 0 ? " (line " + std::to_string(line) + ")" : "");
}

void BadVertices::raise(const std::string& name) const {
  if (count_ == 0) return;
  throw Error(ErrorCode::kInput, in_file(name, first_line_),
              counted(count_, "vertex has", "vertices have") + " a coordinate that is no finite number (nan or infinite): " + listed_ +
                  (count_ > 5 ? " and " + std::to_string(count_ - 5) + " more" : ""),
              "repair or remove them in the program that made the mesh");
}

float AttributeNumbers::clean(double v) {
  const auto narrow = static_cast<float>(v);
  if (std::isfinite(narrow)) return narrow;
  ++bad_;
  return 0;
}

void AttributeNumbers::warn(const char* what, std::vector<std::string>& warnings) const {
  if (bad_ > 0) warnings.push_back(std::to_string(bad_) + " values in the " + what + " are no finite numbers; zero is taken instead");
}

std::string shown(std::string_view text) {
  std::string result = "'";
  for (char c : text.substr(0, 40)) result += c >= 32 && c < 127 ? c : '?';
  return result + (text.size() > 40 ? "...'" : "'");
}

std::string counted(size_t n, const char* singular, const char* plural) {
  return std::to_string(n) + " " + (n == 1 ? singular : plural);
}

}  // namespace knead::mesh
