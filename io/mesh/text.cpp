// Text in and out for the mesh formats: places of errors, numbers in double, shortest exact output.
#include "io/mesh/text.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "graph/cancel.h"
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

// Without a DOS end-of-file byte, or zeros that fill a block, and the blanks among them.
std::string_view before_end_of_file_byte(std::string_view text) {
  size_t kept = text.size();
  for (size_t i = text.size(); i > 0; --i) {
    const char c = text[i - 1];
    if (c == '\x1a' || c == '\0') kept = i - 1;
    if (c != '\x1a' && c != '\0' && c != ' ' && c != '\t' && c != '\r' && c != '\n') break;
  }
  return text.substr(0, kept);
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

TextReader::TextReader(std::string_view text, std::string name, BeginsStatement begins_statement)
    : name_(std::move(name)), begin_(text.data()), end_(begin_ + before_end_of_file_byte(text).size()), begins_statement_(begins_statement) {
  at_ = line_begin_ = line_end_ = next_ = begin_ + (text.starts_with("\xef\xbb\xbf") ? 3 : 0);
  newline_ = first_from_next('\n');
  return_ = first_from_next('\r');
}

const char* TextReader::first_from_next(char c) const {
  const void* found = next_ == end_ ? nullptr : std::memchr(next_, c, static_cast<size_t>(end_ - next_));
  return found ? static_cast<const char*>(found) : end_;
}

bool TextReader::next_line() {
  if (next_ == end_) {
    at_ = line_begin_ = line_end_ = end_;
    return false;
  }
  if ((next_line_ & 0x3fff) == 0) check_cancelled();
  line_ = next_line_;
  at_ = line_begin_ = next_;
  for (;;) {
    // Lines end with \n, \r\n or, as old programs wrote, \r.
    if (newline_ < next_) newline_ = first_from_next('\n');
    if (return_ < next_) return_ = first_from_next('\r');
    const char* stop = newline_;
    if (stop - return_ > 1) stop = return_;
    ++next_line_;
    line_end_ = stop;
    next_ = stop == end_ ? end_ : stop + 1;
    const char* last = line_end_;
    while (last > line_begin_ && (last[-1] == '\r' || (begins_statement_ && (last[-1] == ' ' || last[-1] == '\t')))) --last;
    if (!begins_statement_ || next_ == end_ || last == line_begin_ || last[-1] != '\\' || !joins_next(last)) return true;
  }
}

// Not in a comment, and not before a statement of its own.
bool TextReader::joins_next(const char* last) const {
  for (const char* c = line_begin_; c < last; ++c)
    if (*c == '#' && (c == line_begin_ || is_blank(c[-1]))) return false;
  const char* first = next_;
  while (first < end_ && (*first == ' ' || *first == '\t')) ++first;
  const char* stop = first;
  while (stop < end_ && *stop != ' ' && *stop != '\t' && *stop != '\r' && *stop != '\n') ++stop;
  return !begins_statement_({first, static_cast<size_t>(stop - first)});
}

bool TextReader::next_full_line() {
  while (next_line())
    if (!line_is_over()) return true;
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
  if (found.empty() || found[0] == '#') fail(std::string("the line ends where ") + what + " should stand");
  const size_t comma = found.find(',');
  if (comma != std::string_view::npos && found.find_first_not_of("0123456789+-,eE") == std::string_view::npos)
    fail(shown(found) + " stands where " + what + " should: not " + kind, "numbers are written with a point, and blanks stand between them");
  fail(shown(found) + " stands where " + what + " should: not " + kind);
}

double TextReader::number(const char* what) {
  if (!number_follows()) skip_blanks();
  double value = 0;
  const char* after = parse_number(at_, line_end_, value);
  if (!after || !ends_number(after)) {
    after = fortran_number_at(value);
    if (!after) fail_number(what, "a number");
  }
  at_ = after;
  return value;
}

// Behind the number of a word with Fortran's exponent, 1.5D-3; null for other words.
const char* TextReader::fortran_number_at(double& value) const {
  std::string word(at_, std::find_if(at_, line_end_, [&](char c) { return is_blank(c); }));
  const size_t mark = word.find_first_of("dD");
  if (mark == std::string::npos) return nullptr;
  word[mark] = 'e';
  const char* after = parse_number(word.data(), word.data() + word.size(), value);
  if (!after || after <= word.data() + mark) return nullptr;
  after = at_ + (after - word.data());
  return ends_number(after) ? after : nullptr;
}

// A comment may touch a digit; in "1.#IND", which some programs write for nan, the mark belongs to the word.
bool TextReader::ends_number(const char* after) const {
  return after == line_end_ || is_blank(*after) || (*after == '#' && after[-1] != '.');
}

double TextReader::number_or_nan() {
  if (line_is_over()) return std::nan("");
  double value = 0;
  const char* after = parse_number(at_, line_end_, value);
  if (!after || !ends_number(after)) after = fortran_number_at(value);
  if (after) return at_ = after, value;
  word();
  return std::nan("");
}

int64_t TextReader::integer(const char* what) {
  if (!number_follows()) skip_blanks();
  int64_t value = 0;
  const char* at = at_;
  const char* const stop = line_end_ - at_ > 18 ? at_ + 18 : line_end_;
  for (unsigned digit = 0; at < stop && (digit = static_cast<unsigned>(*at) - '0') < 10; ++at) value = 10 * value + digit;
  if (at > at_ && (at == line_end_ || *at == ' ' || *at == '/')) return at_ = at, value;  // nearly always
  const char* first = at_ < line_end_ && *at_ == '+' ? at_ + 1 : at_;
  const auto result = std::from_chars(first, line_end_, value);
  if (result.ec != std::errc{}) fail_number(what, "a whole number");
  at_ = result.ptr;
  if (at_ < line_end_ && (*at_ == '.' || *at_ == 'e' || *at_ == 'E')) {  // 3.0, as programs write that have numbers of one type alone
    double real = 0;
    const char* after = parse_number(first, line_end_, real);
    if (!after || !(std::abs(real) < 9e15) || real != std::floor(real)) at_ = first, fail_number(what, "a whole number");
    at_ = after;
    return static_cast<int64_t>(real);
  }
  return value;
}

void TextReader::fail(const std::string& message, const std::string& hint) const {
  const bool on_line = line_ > 0 && at_ >= line_begin_;
  throw Error(ErrorCode::kFile, in_file(name_, line_, on_line ? static_cast<int>(at_ - line_begin_) + 1 : 0), message, hint);
}

void TextReader::fail_at_line(int line, const std::string& message, const std::string& hint) const {
  throw Error(ErrorCode::kFile, in_file(name_, line), message, hint);
}

bool same_word(std::string_view a, std::string_view lower_case) {
  return std::equal(a.begin(), a.end(), lower_case.begin(), lower_case.end(),
                    [](char c, char lower) { return (c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c) == lower; });
}

std::string_view single_bytes(std::string_view bytes, std::string& storage) {
  const bool little = bytes.starts_with("\xff\xfe"), big = bytes.starts_with("\xfe\xff");
  const size_t low = little ? 0 : 1;
  if (!(little || big) || bytes.size() < 4 || bytes[3 - low] != '\0') return bytes;
  storage.reserve(bytes.size() / 2);
  for (size_t i = 2; i + 1 < bytes.size(); i += 2) storage += bytes[i + 1 - low] == '\0' ? bytes[i + low] : '?';
  return storage;
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

void BadVertices::add(size_t number, int line) {
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

std::string listed(const std::vector<std::string>& names) {
  std::string text;
  for (size_t i = 0; i < names.size(); ++i) text += (i == 0 ? "" : i + 1 == names.size() ? " and " : ", ") + names[i];
  return text;
}

void LeftOut::add(int line, std::string_view text) {
  if (count_++ > 0) return;
  first_line_ = line;
  first_text_ = text;
}

void LeftOut::warn(const char* singular, const char* plural, std::vector<std::string>& warnings) const {
  if (count_ == 0) return;
  warnings.push_back(counted(count_, singular, plural) + " left out (first: line " + std::to_string(first_line_) + ")" +
                     (first_text_.empty() ? "" : ": " + shown(first_text_)));
}

void ShortFaces::add(size_t corners, size_t face, int line) {
  if (count_++ == 0) first_face_ = face, first_line_ = line;
  fewest_ = std::min(fewest_, corners);
  most_ = std::max(most_, corners);
}

void ShortFaces::warn(std::vector<std::string>& warnings) const {
  if (count_ == 0) return;
  const char* const names[] = {"no corners", "one corner", "two corners"};
  warnings.push_back(counted(count_, "face", "faces") + " of " + (fewest_ == most_ ? names[most_] : "fewer than three corners") +
                     " left out (first: " + (first_line_ > 0 ? "line " + std::to_string(first_line_) : "face " + std::to_string(first_face_)) + ")");
}

}  // namespace knead::mesh
