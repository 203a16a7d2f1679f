// Inside io/mesh/ply.cpp only: the values of a PLY file's body one after the other, whatever the encoding. In text, lines do not matter.
#pragma once
#include <algorithm>
#include <bit>
#include <cstring>
#include <type_traits>

#include "io/mesh/ply.h"

namespace knead::mesh::ply {

inline int64_t whole(double v) {
  return v > -9e15 && v < 9e15 ? static_cast<int64_t>(v) : -1;
}

class AsciiValues {
 public:
  static constexpr bool kInRows = false;
  explicit AsciiValues(TextReader& text) : text_(text) {}

  void begin(const Element& element, size_t index) {
    element_ = &element, index_ = index;
    need();
    shares_line_ = text_.line() == shared_line_;
    began_ = text_.line();
  }
  void end() {
    const int line = text_.line();
    const bool over = text_.line_is_over();
    if (line != began_ && regular_ && (shares_line_ || !over)) misfit_ = began_, misfit_is_short_ = !shares_line_;
    regular_ = regular_ && line == began_;
    if (!over) shared_line_ = line;
  }
  void finish() {
    if (more()) fail_too_many(text_.line(), "the file is damaged");
  }
  // Lines do not matter while all goes well. Where it does not, and every element had a line to itself up to one that has too few values or too many (but not
  // as many as two), that line is the likely cause, and the failure that was found later the less likely one.
  void explain(const Error& later) const {
    if (misfit_ == 0 || later.code() != ErrorCode::kFile) return;
    const std::string hint = "the file is damaged; or, if lines mean nothing in it: " + later.message();
    if (misfit_is_short_) text_.fail_at_line(misfit_, "the line ends where a value should stand", hint);
    fail_too_many(misfit_, hint);
  }

  double number(Type) { return need(), text_.number("a value"); }
  template <class F>
  void integers(Type type, size_t n, const F& take) {
    for (; n > 0; --n) take(integer(type));
  }
  int64_t integer(Type type) {
    need();
    if (type != Type::kFloat && type != Type::kDouble) return text_.integer("a whole number");
    return whole(text_.number("a whole number"));
  }
  void skip(Type) { number(Type::kDouble); }
  size_t left() const { return SIZE_MAX; }
  static size_t least_bytes(Type) { return 2; }
  int line() const { return text_.line(); }
  [[noreturn]] void fail(const std::string& message) const { text_.fail(message, "the file is damaged"); }

 private:
  [[noreturn]] void fail_too_many(int line, const std::string& hint) const {
    text_.fail_at_line(line, "the line has more values than the header announces", hint);
  }
  // On to the next line with a value, over lines that some programs put between the elements.
  bool more() {
    while (text_.more()) {
      if (text_.peek() != 'c' && text_.peek() != 'o') return true;
      const std::string_view word = text_.word();
      if (word != "comment" && word != "obj_info") return text_.back_to(word.data()), true;
      text_.rest();
    }
    return false;
  }
  void need() {
    if (!text_.number_follows()) find_value();
  }
  [[gnu::noinline]] void find_value() {
    if (text_.line_is_over() && !more())
      text_.fail("the file ends at " + element_->name + " " + std::to_string(index_) + " of " + std::to_string(element_->count),
                 "the file is damaged or cut short");
  }

  TextReader& text_;
  const Element* element_ = nullptr;
  size_t index_ = 0;
  int began_ = 0, shared_line_ = 0, misfit_ = 0;
  bool shares_line_ = false, regular_ = true, misfit_is_short_ = false;
};

// Elements without lists, which lie in a binary file as rows of one size.
struct Rows {
  const char* first = nullptr;  // null: there are none
  size_t bytes = 0;             // of one
  size_t count = 0;
};

template <bool kSwap>
class BinaryValues {
 public:
  static constexpr bool kInRows = true;
  BinaryValues(std::string_view bytes, const std::string& name) : at_(bytes.data()), end_(at_ + bytes.size()), name_(name) {}
  void begin(const Element& element, size_t index) { element_ = &element, index_ = index; }
  void end() {}
  void finish() {}
  double number(Type type) {
    return with_type(type, [&](auto zero) { return static_cast<double>(take<decltype(zero)>()); });
  }
  int64_t integer(Type type) {
    return with_type(type, [&](auto zero) { return as_whole(take<decltype(zero)>()); });
  }
  // take(v) for each of the next n values, whose bytes are there.
  template <class F>
  void integers(Type type, size_t n, const F& take_value) {
    with_type(type, [&](auto zero) {
      for (; n > 0; --n) take_value(as_whole(take<decltype(zero)>()));
    });
  }
  void skip(Type type) {
    const size_t bytes = kTypeBytes[static_cast<size_t>(type)];
    if (left() < bytes) fail_short();
    at_ += bytes;
  }

  // All of the element, and on past it; none where it has lists or the file is too short, which the values one by one will say.
  Rows rows(const Element& element) {
    Rows rows{at_, 0, element.count};
    for (const Property& p : element.properties) {
      if (p.list) return {};
      rows.bytes += kTypeBytes[static_cast<size_t>(p.type)];
    }
    if (rows.bytes == 0 || element.count > left() / rows.bytes) return {};
    at_ += rows.bytes * element.count;
    return rows;
  }
  // take(i, v) for the value of each row that stands `offset` bytes behind its beginning.
  template <class F>
  static void column(const Rows& rows, size_t offset, Type type, const F& take_value) {
    with_type(type, [&](auto zero) {
      const char* at = rows.first + offset;
      for (size_t i = 0; i < rows.count; ++i, at += rows.bytes) take_value(i, static_cast<double>(value_at<decltype(zero)>(at)));
    });
  }
  size_t left() const { return static_cast<size_t>(end_ - at_); }
  static size_t least_bytes(Type type) { return kTypeBytes[static_cast<size_t>(type)]; }
  int line() const { return 0; }
  void explain(const Error&) const {}
  [[noreturn]] void fail(const std::string& message) const {
    throw Error(ErrorCode::kFile, in_file(name_), place() + message, "the file is damaged or its header does not fit its data");
  }

 private:
  std::string place() const {
    return element_ ? element_->name + " " + std::to_string(index_) + " of " + std::to_string(element_->count) + ": " : "";
  }
  [[noreturn]] void fail_short() const {
    throw Error(ErrorCode::kFile, in_file(name_), place() + "the file ends here", "the file is damaged or cut short; export or copy it again");
  }
  // f(a zero of that type)
  template <class F>
  static auto with_type(Type type, const F& f) {
    switch (type) {
      case Type::kInt8: return f(int8_t{});
      case Type::kUint8: return f(uint8_t{});
      case Type::kInt16: return f(int16_t{});
      case Type::kUint16: return f(uint16_t{});
      case Type::kInt32: return f(int32_t{});
      case Type::kUint32: return f(uint32_t{});
      case Type::kFloat: return f(float{});
      case Type::kDouble: break;
    }
    return f(double{});
  }
  template <class T>
  static int64_t as_whole(T v) {
    if constexpr (std::is_floating_point_v<T>)
      return whole(v);
    else
      return v;
  }
  template <class T>
  static T value_at(const char* at) {
    char raw[sizeof(T)];
    std::memcpy(raw, at, sizeof(T));
    if constexpr (kSwap) std::reverse(raw, raw + sizeof(T));
    return std::bit_cast<T>(raw);
  }
  template <class T>
  T take() {
    if (left() < sizeof(T)) fail_short();
    const T value = value_at<T>(at_);
    at_ += sizeof(T);
    return value;
  }

  const char *at_, *end_;
  std::string name_;
  const Element* element_ = nullptr;
  size_t index_ = 0;
};

}  // namespace knead::mesh::ply
