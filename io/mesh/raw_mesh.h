// Inside io/mesh_*.cpp only: what the formats share.
#pragma once
#include <charconv>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "io/files.h"
#include "io/mesh/mesh_io.h"
#include "kernels/port_types.h"

namespace knead::mesh {

// A file as parsed, before its place, triangles and checks.
struct RawMesh {
  std::vector<Vec3d> points;
  MeshTopology topology;
  MeshAttributes attributes;
  bool weld = false;  // the format shares no vertices

  RawMesh() { topology.face_offsets.push_back(0); }
  void close_face() { topology.face_offsets.push_back(static_cast<uint32_t>(topology.face_vertices.size())); }
};

// Vertices whose coordinates are not finite, collected so that one error names them all.
class BadVertices {
 public:
  void check(const Vec3d& p, size_t number, int line = 0);  // number from 1 in text formats of OBJ, from 0 else
  void raise(const std::string& name) const;                // throws when there are any

 private:
  size_t count_ = 0;
  int first_line_ = 0;
  std::string listed_;
};

// Text line by line, number by number, with the place of every failure. Blanks are spaces, tabs and carriage returns.
class TextReader {
 public:
  // `continued`: a backslash at the end of a line joins the next one to it (OBJ).
  TextReader(std::string_view text, std::string name, bool continued = false);

  bool next_line();       // false at the end
  bool next_full_line();  // skips blank lines and those that start with '#'
  bool line_is_over() { return skip_blanks(), at_ == line_end_; }
  std::string_view word();          // empty when the line is over
  std::string_view rest();          // of the line, without blanks at its ends
  double number(const char* what);  // "a coordinate"; infinities and nan are returned, not refused
  int64_t integer(const char* what);
  bool take(char c) { return at_ < line_end_ && *at_ == c ? (++at_, true) : false; }
  bool blank_or_over() const { return at_ == line_end_ || is_blank(*at_); }

  int line() const { return line_; }
  size_t offset() const { return static_cast<size_t>(at_ - begin_); }  // of the next character
  size_t offset_after_line() const { return static_cast<size_t>(next_ - begin_); }
  const std::string& name() const { return name_; }
  [[noreturn]] void fail(const std::string& message, const std::string& hint = {}) const;
  [[noreturn]] void fail_at_line(int line, const std::string& message, const std::string& hint = {}) const;

 private:
  bool is_blank(char c) const { return c == ' ' || c == '\t' || c == '\r' || (continued_ && (c == '\n' || c == '\\')); }
  void skip_blanks() {
    while (at_ < line_end_ && is_blank(*at_)) ++at_;
  }
  void find_newline();
  [[noreturn]] void fail_number(const char* what, const char* kind) const;

  std::string name_;
  const char *begin_, *end_, *at_, *line_begin_, *line_end_, *next_;
  const char* newline_;  // the first \n from next_ on, or the end
  int line_ = 0, next_line_ = 1;
  bool continued_;
};

// from_chars with what files use beside: a leading '+', and numbers too small for a double, which become zero. Null when there is no number at `at`.
const char* parse_number(const char* at, const char* end, double& value);

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

// Replaces attribute values that are not finite (or do not fit a float) by zero and counts them; positions are refused instead.
class AttributeNumbers {
 public:
  float clean(double v);
  void warn(const char* what, std::vector<std::string>& warnings) const;

 private:
  size_t bad_ = 0;
};

std::string shown(std::string_view text);                                 // at most 40 printable characters, quoted
std::string counted(size_t n, const char* singular, const char* plural);  // "1 face", "3 faces"

// The normals to write for `surface`: its own while they belong to its points, else recomputed. Empty vectors when it has none.
struct CornerNormals {
  std::vector<Vec3f> normals;
  std::vector<int32_t> corner_normal;
};
CornerNormals normals_to_write(const Surface& surface, const WriteMeshOptions& options);

// Per-vertex form of per-corner values, for formats that have no corners: the pool index of each vertex, or empty when some vertex has several
// different ones (a seam, a hard edge). `same(i, j)` compares pool entries.
template <class Same>
std::vector<int32_t> by_vertex(const MeshTopology& topology, const std::vector<int32_t>& corner_values, size_t vertices, Same same) {
  std::vector<int32_t> result(vertices, -1);
  for (size_t c = 0; c < topology.corners(); ++c) {
    const int32_t value = corner_values[c];
    int32_t& at_vertex = result[topology.face_vertices[c]];
    if (value < 0) return {};
    if (at_vertex >= 0 && at_vertex != value && !same(at_vertex, value)) return {};
    if (at_vertex < 0) at_vertex = value;
  }
  return result;
}

RawMesh read_obj(std::string_view bytes, const std::string& name, std::vector<std::string>& warnings);
RawMesh read_ply(std::string_view bytes, const std::string& name, std::vector<std::string>& warnings);
RawMesh read_stl(std::string_view bytes, const std::string& name, std::vector<std::string>& warnings);
RawMesh read_off(std::string_view bytes, const std::string& name, std::vector<std::string>& warnings);
std::string write_obj(const Surface& surface, const WriteMeshOptions& options, std::vector<std::string>& notes);
std::string write_ply(const Surface& surface, const WriteMeshOptions& options, std::vector<std::string>& notes);
std::string write_stl(const Surface& surface, const WriteMeshOptions& options, std::vector<std::string>& notes);

}  // namespace knead::mesh
