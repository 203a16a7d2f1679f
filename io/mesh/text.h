// Inside io/mesh only: text in and out for the mesh formats, places of errors, numbers in double, shortest exact output.
#pragma once
#include <charconv>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <vector>

#include "kernels/port_types.h"

namespace knead::mesh {

// Text line by line or value by value, with the place of every failure. Blanks are spaces, tabs, form feeds and carriage returns; a '#' at the beginning of a
// value begins a comment, up to the line's end. A byte order mark at the beginning and a DOS end-of-file byte (0x1A) at the end are passed over.
class TextReader {
 public:
  // `begins_statement` is given where a backslash at a line's end joins the next line (OBJ): the two are not joined when the next one is a statement of its own,
  // since then the backslash belongs to a name.
  using BeginsStatement = bool (*)(std::string_view line);
  TextReader(std::string_view text, std::string name, BeginsStatement begins_statement = nullptr);

  bool next_line();       // false at the end
  bool next_full_line();  // skips blank lines and comments
  bool line_is_over() { return skip_blanks(), at_ == line_end_ || *at_ == '#'; }
  // On to the next value, on this line or a later one; false at the end of the text.
  bool more() {
    if (number_follows()) return true;
    while (line_is_over())
      if (!next_line()) return false;
    return true;
  }
  // As nearly always in a mesh: at most one blank, then what a number begins with. For speed alone: false says nothing.
  bool number_follows() {
    if (at_ < line_end_ && *at_ == ' ') ++at_;
    return at_ < line_end_ && *at_ >= '+' && *at_ <= '9';
  }
  std::string_view word();          // empty when the line is over
  std::string_view rest();          // of the line, without blanks at its ends, comments included
  double number(const char* what);  // "a coordinate"; infinities and nan are returned, not refused
  int64_t integer(const char* what);
  double number_or_nan();  // the next word as a number; nan for another word and for the line's end
  // Passes over this very word, blanks before it included; false where another one stands.
  bool take_word(std::string_view wanted) {
    skip_blanks();
    const auto left = static_cast<size_t>(line_end_ - at_);
    if (left < wanted.size() || std::memcmp(at_, wanted.data(), wanted.size()) != 0) return false;
    if (left > wanted.size() && !is_blank(at_[wanted.size()])) return false;
    at_ += wanted.size();
    return true;
  }
  bool take(char c) { return at_ < line_end_ && *at_ == c ? (++at_, true) : false; }
  bool blank_or_over() const { return at_ == line_end_ || is_blank(*at_) || *at_ == '#'; }
  char peek() const { return at_ < line_end_ ? *at_ : '\0'; }
  void back_to(const char* place) { at_ = place; }  // within the line

  int line() const { return line_; }
  size_t offset_after_line() const { return static_cast<size_t>(next_ - begin_); }
  const std::string& name() const { return name_; }
  [[noreturn]] void fail(const std::string& message, const std::string& hint = {}) const;
  [[noreturn]] void fail_at_line(int line, const std::string& message, const std::string& hint = {}) const;

 private:
  bool is_blank(char c) const { return c == ' ' || (c >= '\t' && c <= '\r' && c != '\n') || (begins_statement_ && (c == '\n' || c == '\\')); }
  void skip_blanks() {
    while (at_ < line_end_ && is_blank(*at_)) ++at_;
  }
  const char* fortran_number_at(double& value) const;
  bool ends_number(const char* after) const;
  bool joins_next(const char* last) const;
  const char* first_from_next(char c) const;
  [[noreturn]] void fail_number(const char* what, const char* kind) const;

  std::string name_;
  const char *begin_, *end_, *at_, *line_begin_, *line_end_, *next_;
  const char *newline_, *return_;  // the first \n and the first \r from next_ on, or the end
  int line_ = 0, next_line_ = 1;
  BeginsStatement begins_statement_;
};

// from_chars with what files use beside: a leading '+', and numbers too small for a double, which become zero. Null when there is no number at `at`.
const char* parse_number(const char* at, const char* end, double& value);

bool same_word(std::string_view a, std::string_view lower_case);  // whatever the case of `a`

// `bytes`, or what they say as text of single bytes in `storage` where they are UTF-16 with a byte order mark.
std::string_view single_bytes(std::string_view bytes, std::string& storage);

// Text out: numbers in their shortest exact form, or with `precision` digits.
class TextWriter {
 public:
  explicit TextWriter(int precision) : precision_(precision) {}
  TextWriter& text(std::string_view t) { return out_ += t, *this; }
  TextWriter& real(float v) { return real_as(v); }
  TextWriter& real(double v) { return real_as(v); }
  TextWriter& whole(int64_t v);
  TextWriter& point(const Surface& surface, size_t vertex);  // three numbers with blanks between: world position
  template <class F>
  TextWriter& vector(const Vec3<F>& v) {
    return real(v.x).text(" ").real(v.y).text(" ").real(v.z);
  }
  std::string take() { return std::move(out_); }
  void reserve(size_t bytes) { out_.reserve(bytes); }

 private:
  template <class F>
  TextWriter& real_as(F v) {
    char digits[64];
    const auto end = precision_ > 0 ? std::to_chars(digits, digits + sizeof digits, v, std::chars_format::general, precision_)
                                    : std::to_chars(digits, digits + sizeof digits, v);
    out_.append(digits, end.ptr);
    return *this;
  }
  std::string out_;
  int precision_;
};

std::string shown(std::string_view text);                                 // at most 40 printable characters, quoted
std::string counted(size_t n, const char* singular, const char* plural);  // "1 face", "3 faces"
std::string listed(const std::vector<std::string>& names);                // "a, b and c"

}  // namespace knead::mesh
