// The table of docs/formats.md: what each reader takes, warns of and refuses. Each row is a small cube that is read or refused here, and the table is made of
// what the readers say, so it cannot be wrong.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "tests/io/mesh/mesh_test_tools.h"
#include "tests/paths.h"

namespace mesh_formats_table_test {

namespace tools = mesh_test_tools;
using knead::Surface;

enum class Outcome { kRead, kWarned, kRefused };

struct Row {
  std::string kind, bytes;
  Outcome outcome = Outcome::kRead;
};

const std::string kPoints[] = {"-0.5 -0.5 -0.5", "0.5 -0.5 -0.5", "0.5 0.5 -0.5", "-0.5 0.5 -0.5",
                               "-0.5 -0.5 0.5",  "0.5 -0.5 0.5",  "0.5 0.5 0.5",  "-0.5 0.5 0.5"};
const std::string kFaces[] = {"0 3 2 1", "4 5 6 7", "0 1 5 4", "1 2 6 5", "2 3 7 6", "3 0 4 7"};

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  for (size_t at = 0; (at = text.find(from, at)) != std::string::npos; at += to.size()) text.replace(at, from.size(), to);
  return text;
}
std::string replaced_once(std::string text, const std::string& from, const std::string& to) {
  return text.replace(text.find(from), from.size(), to);
}

// The cube as lines: each point between `before` and `after`, then the faces; `per_corner` follows each corner's number.
std::string lines(const std::string& before, const std::string& after) {
  std::string text;
  for (const std::string& p : kPoints) text += before + p + after + "\n";
  return text;
}
std::string obj(const std::string& after_point = "", const std::string& per_corner = "", const std::string& after_face = "") {
  std::string text = lines("v ", after_point);
  for (const std::string& face : kFaces) {
    text += "f";
    for (size_t k = 0; k < face.size(); k += 2) text += " " + std::to_string(face[k] - '0' + 1) + per_corner;
    text += after_face + "\n";
  }
  return text;
}
std::string off(const std::string& head = "OFF\n8 6 12\n", const std::string& after_point = "", const std::string& after_face = "") {
  std::string text = head + lines("", after_point);
  for (const std::string& face : kFaces) text += "4 " + face + after_face + "\n";
  return text;
}
std::string ply(const std::string& vertex_properties = "", const std::string& after_point = "", const std::string& face_properties = "",
                const std::string& after_face = "") {
  std::string text = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n" + vertex_properties +
                     "element face 6\nproperty list uchar int vertex_indices\n" + face_properties + "end_header\n" + lines("", after_point);
  for (const std::string& face : kFaces) text += "4 " + face + after_face + "\n";
  return text;
}
std::string strips() {
  std::string text = replaced_once(ply(), "element face 6\nproperty list uchar", "element tristrips 1\nproperty list int");
  return text.substr(0, text.find("4 0 3 2 1\n")) + "29 0 3 1 2 -1 4 5 7 6 -1 0 1 4 5 -1 1 2 5 6 -1 2 3 6 7 -1 3 0 7 4\n";
}
std::string stl(bool ascii = true) {
  return tools::format("m.stl", tools::parse(obj(), "m.obj"), {.ascii = ascii});
}
std::string capitals(std::string text) {
  for (char& c : text) c = c >= 'a' && c <= 'z' ? static_cast<char>(c - 32) : c;
  return text;
}
std::string utf16(const std::string& text) {
  std::string wide = "\xff\xfe";
  for (const char c : text) wide += c, wide += '\0';
  return wide;
}
std::string with_count(uint32_t count) {
  std::string bytes = stl(false);
  for (size_t k = 0; k < 4; ++k) bytes[80 + k] = static_cast<char>(count >> (8 * k));
  return bytes;
}

using enum Outcome;

std::vector<Row> obj_rows() {
  const std::string mtl = "usemtl C:\\skin\\\n";
  return {{"comments after values, blank lines", obj(" # note", "", " # note\n")},
          {"lines that end in `\\r\\n` or `\\r`, a byte order mark", "\xef\xbb\xbf" + replaced(obj(), "\n", "\r")},
          {"UTF-16 with a byte order mark", utf16(obj())},
          {"a DOS end-of-file byte, zeros that fill a block", obj() + "\x1a" + std::string(9, '\0')},
          {"Fortran's exponents, `5.0D-1`; numbers of vertices with a point, `f 1.0 2.0 3.0`", replaced(obj("", ".0"), "0.5", "5.0D-1")},
          {"statements in capitals", capitals(obj())},
          {"a line that a backslash joins to the next, with blanks after it or not", replaced(obj(), "-0.5\n", "\\ \n -0.5\n")},
          {"a name that ends in a backslash", mtl + replaced_once(obj(), "f ", mtl + "f ")},
          {"a slash at the end: `1/ 2/ 3/`", obj("", "/")},
          {"numbers counted back: `f -4 -3 -1`", replaced_once(obj(), "f 1 4 3 2", "f -8 -5 -6 -7")},
          {"weights and colours after coordinates", obj(" 0.5 0.5 0.5")},
          {"smoothing, display and material statements", "mtllib a.mtl\no a\ng b\ns off\nlod 1\n" + obj()},
          {"texture coordinates and normals that are not there", obj("", "/1/1"), kWarned},
          {"texture coordinates counted from 0, or past the end", "vt 0 0\n" + obj("", "/2"), kWarned},
          {"faces of two corners or one", obj() + "f 1 7\nf 2\n", kWarned},
          {"lines that are no statements", "$ made for a test\nversion 2\n" + obj(), kWarned},
          {"points, lines, curves and free-form surfaces", obj() + "p 1\nl 1 2\n", kWarned},
          {"other values after coordinates", obj(" 1 2"), kWarned},
          {"normals and texture coordinates that are no numbers: `1.#IND`", "vn 1.#IND 0 0\n" + obj("", "//1"), kWarned},
          {"vertex 0", replaced(obj(), "f 1 4", "f 0 4"), kRefused},
          {"a vertex that is not there", replaced(obj(), "f 1 4", "f 9 4"), kRefused},
          {"a corner that is no number", replaced(obj(), "f 1 4", "f 1,4"), kRefused},
          {"a coordinate missing", replaced_once(obj(), "v -0.5 -0.5 -0.5", "v -0.5 -0.5"), kRefused},
          {"a coordinate that is a word", replaced_once(obj(), "v -0.5 -0.5 -0.5", "v -0.5 one 0"), kRefused},
          {"a coordinate that is nan or infinite", replaced_once(obj(), "v -0.5 -0.5 -0.5", "v -0.5 nan 0"), kRefused},
          {"numbers without a statement, which may be a vertex", replaced_once(obj(), "v -0.5", "-0.5"), kRefused},
          {"points without faces", lines("v ", ""), kRefused}};
}

std::vector<Row> off_rows() {
  const std::string one_line = replaced(replaced_once(off(), "OFF\n", "OFF "), "\n", " ");
  return {{"values over several lines", replaced(off(), " ", "\n")},
          {"all in one line", one_line},
          {"several elements in one line, comments between", replaced(replaced(off(), "4 4", "# note\n4 4"), "\n4 1", " 4 1")},
          {"counts in the first line, glued to it or not: `OFF8 6 0`", off("OFF8 6 0\n")},
          {"no count of edges", off("OFF\n8 6\n")},
          {"in lower case", off("off\n8 6 0\n")},
          {"lines that end in `\\r\\n` or `\\r`, a byte order mark, UTF-16", utf16(replaced(off(), "\n", "\r\n"))},
          {"a DOS end-of-file byte", off() + "\x1a"},
          {"colours of vertices: COFF", off("COFF\n8 6 0\n", " 255 0 0 255")},
          {"normals, colours and texture coordinates of vertices: STCNOFF", off("STCNOFF\n8 6 0\n", " 0 0 1 0.5 0.5 0.5 1 0.25 0.75")},
          {"homogeneous coordinates: 4OFF", off("4OFF\n8 6 0\n", " 1")},
          {"whole numbers with a point: `8.0 6.0 0`", off("OFF\n8.0 6.0 0\n")},
          {"letters that announce more than there is: NOFF without normals", off("NOFF\n8 6 0\n"), kWarned},
          {"colours of faces", off("OFF\n8 6 0\n", "", " 255 0 0"), kWarned},
          {"colours of faces where lines mean nothing", replaced(off("OFF\n8 6 0\n", "", " 255 0 0"), "\n", " "), kWarned},
          {"other values after coordinates", off("OFF\n8 6 0\n", " 7 8"), kWarned},
          {"faces of two corners or one", replaced(off(), "8 6 12", "8 7 12") + "2 0 6\n", kWarned},
          {"no OFF at the beginning", off("8 6 12\n"), kWarned},
          {"more than the counts say", off() + "4 0 3 2 1\n", kWarned},
          {"a vertex that is not there", replaced(off(), "4 0 3", "4 8 3"), kRefused},
          {"fewer vertices or faces than the counts say", replaced(off(), "8 6 12", "8 7 12"), kRefused},
          {"counts that the file cannot hold", replaced(off(), "8 6 12", "8000000 6 12"), kRefused},
          {"numbers that do not add up: a fourth count", off("OFF\n8 6 12 0\n"), kRefused},
          {"binary OFF", off("OFF BINARY\n8 6 12\n"), kRefused},
          {"other than three dimensions", off("nOFF 2\n8 6 12\n"), kRefused}};
}

std::vector<Row> ply_rows() {
  const std::string camera = "element camera 1\nproperty list uchar float view\n";
  const std::string binary = tools::format("m.ply", tools::parse(obj(), "m.obj"));
  return {
      {"text: values over several lines", replaced(ply(), "0.5 ", "0.5\n")},
      {"text: several elements in one line, comments between", replaced(replaced(ply(), "\n4 4", "\n# note\ncomment note\n4 4"), "\n4 1", " 4 1")},
      {"text: lines that end in `\\r\\n` or `\\r`, a byte order mark, UTF-16", "\xef\xbb\xbf" + replaced(ply(), "\n", "\r")},
      {"text: a DOS end-of-file byte", ply() + "\x1a"},
      {"binary: little and big endian", binary},
      {"binary: a header whose lines end in `\\r\\n` or `\\r`",
       replaced(binary.substr(0, binary.find("end_header") + 11), "\n", "\r") + binary.substr(binary.find("end_header") + 11)},
      {"strips of triangles, which end at -1", strips()},
      {"types and names in capitals, whole numbers with a point",
       replaced(replaced(replaced(ply(), "float x", "FLOAT X"), "element vertex", "element Vertex"), "4 4 5", "4.0 4.0 5.00e0")},
      {"another name for the list of corners", replaced_once(ply(), "vertex_indices", "indices"), kWarned},
      {"numbers of its own by vertex and face (quality, id, flags), which are kept for .ply",
       ply("property float quality\nproperty int id\n", " 0.5 1", "property uchar flags\n", " 3")},
      {"elements of no vertices and faces, lists of its own",
       replaced_once(ply("property list uchar int rings\n", " 1 2"), "end_header\n", camera + "end_header\n") + "1 0.5\n", kWarned},
      {"header lines of somebody's own", replaced_once(ply(), "element vertex", "Made by some program\nelement vertex"), kWarned},
      {"faces of two corners or one", replaced_once(ply(), "face 6", "face 7") + "2 0 6\n", kWarned},
      {"binary: bytes after the mesh", binary + "end", kWarned},
      {"a misspelt declaration in the header", replaced_once(ply(), "property float y", "proprety float y"), kRefused},
      {"a second `x`", replaced_once(ply(), "float y", "float x"), kRefused},
      {"an unknown type", replaced_once(ply(), "float y", "real y"), kRefused},
      {"more values than the header announces", replaced_once(ply(), "-0.5 -0.5 -0.5\n", "-0.5 -0.5 -0.5 7\n"), kRefused},
      {"fewer values than the header announces", replaced_once(ply(), "-0.5 -0.5 -0.5\n", "-0.5 -0.5\n"), kRefused},
      {"a vertex that is not there", replaced_once(ply(), "4 0 3", "4 8 3"), kRefused},
      {"a coordinate that is nan or infinite", replaced_once(ply(), "-0.5 -0.5 -0.5\n", "-0.5 -0.5 inf\n"), kRefused},
      {"a file that was cut short", binary.substr(0, binary.size() - 9), kRefused}};
}

std::vector<Row> stl_rows() {
  const std::string text = stl(), facet = text.substr(text.find("facet"), text.find("endfacet") + 9 - text.find("facet"));
  return {{"text: in capitals", capitals(text)},
          {"text: a byte order mark, UTF-16, lines that end in `\\r\\n` or `\\r`", "\xef\xbb\xbf" + replaced(text, "\n", "\r")},
          {"text: `end solid`, `end facet`, `end loop`", replaced(text, "end", "end ")},
          {"text: all in one line, values over several lines, comments", replaced(replaced(text, "\n", " "), "vertex ", "# note\nvertex\n")},
          {"text: normals that are missing or no numbers", replaced(text, "normal 0 0 -1", "normal 1.#QNAN")},
          {"text: `facet normal` in the name of a solid", replaced_once(text, "solid", "solid with a facet normal in its name")},
          {"text: several solids, a DOS end-of-file byte", replaced_once(text, "endfacet\n", "endfacet\nendsolid a b\nsolid c\n") + "\x1a"},
          {"binary that begins with `solid`", "solid" + stl(false).substr(5)},
          {"text: no `endsolid` (every facet is whole)", text.substr(0, text.find("endsolid")), kWarned},
          {"text: facets outside of a solid", text.substr(text.find("facet"), text.find("endsolid") - text.find("facet")), kWarned},
          {"text: somebody's own lines before `solid`", "# made for a test\n" + text},
          {"text: lines that are no statements", replaced_once(text, "endfacet\n", "endfacet\ncolour 1 0 0\n"), kWarned},
          {"binary: a count of 0", with_count(0), kWarned},
          {"binary: a count of -1", with_count(UINT32_MAX), kWarned},
          {"binary: bytes after the mesh", stl(false) + "end", kWarned},
          {"text: a facet that was cut short", text.substr(0, text.rfind("endloop")), kRefused},
          {"text: a facet of other than three corners", replaced_once(text, "endloop", "vertex 0 0 0\nendloop"), kRefused},
          {"text: a vertex of other than three coordinates", replaced_once(text, "vertex -0.5", "vertex 0 -0.5"), kRefused},
          {"binary: a larger count than the file holds", with_count(13), kRefused},
          {"binary: a count of 0, and a facet that was cut short", with_count(0).substr(0, 600), kRefused}};
}

struct Format {
  std::string title, name;
  std::vector<Row> rows;
};

std::vector<Format> formats() {
  return {{"OBJ", "m.obj", obj_rows()}, {"OFF", "m.off", off_rows()}, {"PLY", "m.ply", ply_rows()}, {"STL", "m.stl", stl_rows()}};
}

// What the reader does, in the table's words. The cube is whole wherever it is read.
std::string answer(const Row& row, const std::string& name) {
  std::vector<std::string> warnings;
  try {
    const Surface s = knead::parse_surface(row.bytes, name, {}, warnings);
    EXPECT_EQ(s.vertices(), 8u);
    EXPECT_EQ(s.topology->triangle_count(), 12u);
    EXPECT_NEAR(tools::volume_of(s), 1, 1e-6);
  } catch (const knead::Error& error) {
    EXPECT_EQ(row.outcome, Outcome::kRefused) << error.what();
    EXPECT_FALSE(error.hint().empty() && error.where().line == 0) << error.what();
    return "refused: " + replaced(error.message(), "|", "\\|");
  }
  EXPECT_EQ(row.outcome, warnings.empty() ? Outcome::kRead : Outcome::kWarned) << ::testing::PrintToString(warnings);
  EXPECT_LE(warnings.size(), 1u) << ::testing::PrintToString(warnings);
  return warnings.empty() ? "read" : "read, with the warning: " + warnings[0];
}

TEST(MeshFormatsTable, ReadersDoAsTheManualSays) {
  std::string table;
  for (const Format& format : formats()) {
    table += "\n## " + format.title + "\n\n| in the file | what the reader does |\n|---|---|\n";
    for (const Row& row : format.rows) {
      SCOPED_TRACE(format.name + ": " + row.kind);
      table += "| " + row.kind + " | " + answer(row, format.name) + " |\n";
    }
  }
  const std::string path = source_dir() + "/docs/formats.md";
  std::stringstream text;
  text << std::ifstream(path).rdbuf();
  const std::string begin = "<!-- made by tests/io/mesh/formats_table_test.cpp -->\n", end = "\n<!-- end -->";
  const size_t first = text.str().find(begin) + begin.size(), last = text.str().find(end);
  ASSERT_LT(first, text.str().size());
  if (text.str().substr(first, last - first) == table) return;
  const std::string made = binary_dir() + "/formats.md";
  std::ofstream(made) << text.str().substr(0, first) << table << text.str().substr(last);
  FAIL() << "docs/formats.md does not say what the readers do; " << made << " does";
}

// Every file of the shared cases, as it lies there.
TEST(MeshFormatsTable, SharedCasesAreRead) {
  const std::filesystem::path cases = std::filesystem::path(shared_data()).parent_path() / "cases";
  if (!std::filesystem::exists(cases)) GTEST_SKIP() << "no shared cases";
  size_t tried = 0;
  for (const auto& entry : std::filesystem::directory_iterator(cases))
    for (const char* ending : {"obj", "off", "ply", "stl"}) {
      const std::string file = (entry.path() / "a.").string() + ending;
      if (!entry.path().filename().string().starts_with(std::string(ending) + "_") || !std::filesystem::exists(file)) continue;
      SCOPED_TRACE(file);
      std::vector<std::string> warnings;
      const Surface s = knead::read_surface(file, warnings);
      EXPECT_NEAR(std::abs(tools::volume_of(s)), s.vertices() == 8 ? 1 : 2, 1e-6);
      ++tried;
    }
  EXPECT_GE(tried, 16u);
}

}  // namespace mesh_formats_table_test
