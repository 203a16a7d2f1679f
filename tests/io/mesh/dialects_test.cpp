// One mesh in ten thousand layouts: what varies between programs and means nothing is drawn at random, and the mesh that is read stays the same.
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <charconv>
#include <functional>
#include <random>
#include <sstream>

#include "tests/io/mesh/mesh_test_tools.h"

namespace mesh_dialects_test {

namespace tools = mesh_test_tools;
using knead::Surface;

// Draws layouts.
class Dialect {
 public:
  explicit Dialect(unsigned seed) : random_(seed) {}

  size_t below(size_t n) { return random_() % n; }
  bool maybe(size_t one_in) { return below(one_in) == 0; }
  template <class T>
  T one_of(std::initializer_list<T> values) {
    return values.begin()[below(values.size())];
  }

  std::string number(float v) {
    char digits[64];
    std::string text(digits, std::to_chars(digits, digits + sizeof digits, v).ptr);
    if (v == std::round(v) && text.find('e') == std::string::npos) text += one_of({"", ".", ".0", "e0", ".000E+00", ".0D+00"});
    return (v > 0 && maybe(8) ? "+" : "") + text;
  }
  std::string word(std::string text) {
    if (capitals_)
      for (char& c : text) c = c >= 'a' && c <= 'z' ? static_cast<char>(c - 32) : c;
    return text;
  }
  // Between two values of a stream, and of a line.
  std::string gap() {
    if (!broken_) return blank();
    return one_of({" ", " ", "  ", "\t", " \n", "\n", "\n\n  ", " # 1 2 3\n"});
  }
  std::string blank() { return one_of({" ", " ", "  ", "\t", " \t "}); }
  std::string line_end() { return one_of({"\n", "\n", "\n", " \n", " # a note, 3 0 1 2\n", "\n\n", "\n# 1 2 3\n"}); }

  // Line ends of another system, a byte order mark, an end-of-file byte.
  std::string finish(std::string text, bool marks = true) {
    const std::string end = one_of({"\n", "\r\n", "\r"});
    std::string result = marks && maybe(4) ? "\xef\xbb\xbf" : "";
    for (const char c : text) c == '\n' ? result += end : result += c;
    if (maybe(4)) result += one_of<std::string>({"\x1a", "\x1a\x1a\x1a", "\x1a\n", std::string(5, '\0'), std::string("\n\0\x1a\0", 4)});
    return result;
  }

  bool capitals_ = maybe(3), broken_ = maybe(2);

 private:
  std::mt19937 random_;
};

class MeshDialects : public ::testing::Test {
 protected:
  MeshDialects() : mesh_(tools::wavy_tube(5, 2)), welded_(tools::parse(tools::format("m.stl", mesh_), "m.stl")) {}

  size_t faces() const { return mesh_.topology->faces(); }
  std::vector<uint32_t> corners(size_t face) const {
    const auto& t = *mesh_.topology;
    return {t.face_vertices.begin() + t.face_offsets[face], t.face_vertices.begin() + t.face_offsets[face + 1]};
  }

  // 2,500 layouts of each format: `write` draws one.
  void all_the_same(const char* name, const Surface& expected, const std::function<std::string(Dialect&)>& write) const {
    for (unsigned seed = 0; seed < 2500; ++seed) {
      Dialect dialect(seed);
      const std::string text = write(dialect);
      try {
        const Surface s = tools::parse(text, name);
        ASSERT_TRUE(tools::same_bits(expected, s)) << seed << "\n" << text;
        ASSERT_EQ(expected.topology->triangles, s.topology->triangles) << seed << "\n" << text;
        if (&expected == &mesh_) {
          ASSERT_EQ(expected.topology->face_vertices, s.topology->face_vertices) << seed << "\n" << text;
        }
      } catch (const knead::Error& error) {
        FAIL() << seed << ": " << error.what() << "\n" << text;
      }
    }
  }

  Surface mesh_, welded_;
};

TEST_F(MeshDialects, ObjIsTheSameMesh) {
  all_the_same("m.obj", mesh_, [&](Dialect& d) {
    std::string text;
    const auto gap = [&] { return d.broken_ && d.maybe(6) ? std::string(" \\") + d.one_of({"", "", " ", "\t"}) + "\n" + d.blank() : d.blank(); };
    const auto unused = [&] {
      text += d.one_of({"",
                        "",
                        "",
                        "g side\\\n",
                        "o a # b\n",
                        "usemtl C:\\skin\\\n",
                        "s off\n",
                        "$ made by hand\n",
                        "version 2\n",
                        "l 1 2\n",
                        "p 1\n",
                        "vn 1.D0 0 0\n",
                        "vn 1.#IND 0 0\n",
                        "vn 0 0\n",
                        "vt 0.5\n",
                        "f 1 2\n",
                        "f 3\n",
                        "# f 1 2 3 \\\n",
                        "\n",
                        "mtllib a b.mtl\n"});
    };
    const bool textured = d.maybe(2), shaded = d.maybe(2), negative = d.maybe(3), faces_first = !negative && d.maybe(6);
    const std::string extra = d.one_of({"", "", " 1", " 0.5 0.5 0.5", " 1 2", " 1 2 3 4 5 6"});
    const auto vertices = [&] {
      for (const knead::Vec3f& p : mesh_.points.host()) {
        if (text.size() > 20) unused();
        text += d.word("v") + gap() + d.number(p.x) + gap() + d.number(p.y) + gap() + d.number(p.z) + extra + d.line_end();
      }
    };
    if (!faces_first) vertices();
    const auto n = static_cast<int64_t>(mesh_.vertices());
    for (size_t f = 0; f < faces(); ++f) {
      if (!faces_first) unused();
      text += d.word("f");
      for (const uint32_t v : corners(f)) {
        text += gap() + std::to_string(negative ? int64_t{v} - n : int64_t{v} + 1);
        if (textured) text += "/" + std::string(d.one_of({"", "1", "99", "0", "-7"}));
        if (shaded) text += (textured ? "/" : "//") + std::string(d.one_of({"", "1", "99", "-1"}));
        if (textured && !shaded && d.maybe(3)) text += "/";
      }
      text += d.line_end();
    }
    if (faces_first) vertices();
    return d.finish(text);
  });
}

TEST_F(MeshDialects, OffIsTheSameMesh) {
  all_the_same("m.off", mesh_, [&](Dialect& d) {
    const bool normals = d.maybe(4), coloured = d.maybe(3), textured = d.maybe(4), divisor = d.maybe(5), short_face = d.maybe(5);
    // Where nothing ends with its line, a face's colour has the same number of values throughout.
    const size_t face_colours = d.one_of<size_t>({0, 0, 3, 4, 1});
    const bool glued = !(normals || coloured || textured || divisor) && d.maybe(3);
    std::string text = (textured ? d.one_of({"ST", "st"}) : std::string()) + (coloured ? "C" : "") + (normals ? "N" : "") + (divisor ? "4" : "") +
                       d.one_of({"OFF", "off"});
    if (!glued) text += d.broken_ ? d.gap() : d.line_end();
    text += std::to_string(mesh_.vertices()) + d.gap() + std::to_string(faces() + short_face) + d.gap() + d.one_of({"0", "27"});
    const auto end = [&] { return d.broken_ ? d.gap() : d.line_end(); };
    text += end();
    const auto add = [&](const std::string& value) { text += d.gap() + value; };
    for (const knead::Vec3f& p : mesh_.points.host()) {
      for (int k = 0; k < 3; ++k) add(d.number(p[k]));
      if (divisor) add("1");
      for (int k = 0; normals && k < 3; ++k) add("0.6");
      for (int k = 0; coloured && k < 4; ++k) add(k == 3 ? "1" : "0.25");
      for (int k = 0; textured && k < 2; ++k) add("0.75");
      text += end();
    }
    const auto face = [&](const std::vector<uint32_t>& around) {
      text += std::to_string(around.size());
      for (const uint32_t v : around) add(std::to_string(v));
      const size_t values = d.broken_ ? face_colours : d.one_of<size_t>({0, 1, 3, 4});
      for (size_t k = 0; k < values; ++k) text += (d.broken_ ? d.gap() : d.blank()) + d.one_of({"1", "0", "0.5", "255"});
      text += end();
    };
    for (size_t f = 0; f < faces(); ++f) face(corners(f));
    if (short_face) face({1, 2});
    return d.finish(text);
  });
}

// A property's type and the bytes or the word of a value.
struct PlyValues {
  Dialect& d;
  bool ascii, big;
  std::string out{};

  template <class T>
  void raw(T value) {
    auto bytes = std::bit_cast<std::array<char, sizeof(T)>>(value);
    if (big != (std::endian::native == std::endian::big)) std::reverse(bytes.begin(), bytes.end());
    out.append(bytes.data(), bytes.size());
  }
  void real(float v) { ascii ? void(out += d.number(v) + d.gap()) : raw(v); }
  void whole(int32_t v) { ascii ? void(out += std::to_string(v) + d.gap()) : raw(v); }
  void small(uint8_t v) { ascii ? void(out += std::to_string(v) + d.gap()) : raw(v); }
  void end() {
    if (ascii && !d.broken_) out += d.line_end();
  }
};

TEST_F(MeshDialects, PlyIsTheSameMesh) {
  all_the_same("m.ply", mesh_, [&](Dialect& d) {
    PlyValues values{d, d.maybe(2), d.maybe(2)};
    const bool own = d.maybe(2), flags = d.maybe(2), camera = d.maybe(4), short_face = d.maybe(4), faces_first = d.maybe(4), late_z = d.maybe(4);
    const auto note = [&] {
      return std::string(d.one_of({"", "", "comment hello world\n", "obj_info 1\n", "made by hand\n", "VCGLIB generated\n"}));
    };
    std::string header = std::string("ply\n") + note() + "format " +
                         (values.ascii ? "ascii"
                          : values.big ? "binary_big_endian"
                                       : "binary_little_endian") +
                         " 1.0\n";
    const auto vertices = [&] {
      header += "element vertex " + std::to_string(mesh_.vertices()) + "\n" + (own ? "property int id\n" : "") + note() +
                "property float x\nproperty float32 y\n";
      if (!late_z) header += "property float z\n";
      if (own) header += "property float quality\n";
      if (late_z) header += "property float z\n";
      for (const knead::Vec3f& p : mesh_.points.host()) {
        if (own) values.whole(7);
        values.real(p.x), values.real(p.y);
        if (!late_z) values.real(p.z);
        if (own) values.real(0.125f);
        if (late_z) values.real(p.z);
        values.end();
      }
    };
    const auto all_faces = [&] {
      header += "element face " + std::to_string(faces() + short_face) + "\n" + (flags ? "property uchar flags\n" : "") + "property list uchar int " +
                d.one_of({"vertex_index", "vertex_indices"}) + "\n" + note();
      for (size_t f = 0; f < faces() + short_face; ++f) {
        if (flags) values.small(static_cast<uint8_t>(f));
        const std::vector<uint32_t> around = f < faces() ? corners(f) : std::vector<uint32_t>{3, 4};
        values.small(static_cast<uint8_t>(around.size()));
        for (const uint32_t v : around) values.whole(static_cast<int32_t>(v));
        values.end();
      }
    };
    if (faces_first) all_faces();
    vertices();
    if (camera) {
      header += "element camera 1\nproperty float view\nproperty list uchar int size\n";
      values.real(0.5f), values.small(2), values.whole(640), values.whole(480), values.end();
    }
    if (!faces_first) all_faces();
    header += "end_header\n";
    if (values.ascii) return d.finish(header + values.out, false);
    return header + values.out;
  });
}

// Strips as a file may have them: led on, ended by -1, or lists of their own.
std::vector<std::vector<int32_t>> joined_strips(Dialect& d, const std::vector<std::vector<int32_t>>& strips) {
  std::vector<std::vector<int32_t>> lists(1);
  size_t run = 0;  // corners since the strip began: the next triangle turns the same way as the first where they are even
  for (const std::vector<int32_t>& strip : strips) {
    if (run > 0 && run % 2 == 0 && d.maybe(3)) {
      lists.back().insert(lists.back().end(), {lists.back().back(), strip[0]});
      run += 2;
    } else if (run > 0) {
      d.maybe(3) ? void(lists.emplace_back()) : lists.back().push_back(-1);
      run = 0;
    }
    lists.back().insert(lists.back().end(), strip.begin(), strip.end());
    run += strip.size();
  }
  return lists;
}

// Strips of the tube's quads: a, b, d, c makes the triangles a b d and d b c. They end at -1, in whatever type, or lead on over triangles without area.
TEST_F(MeshDialects, PlyStripsAreTheSameTriangles) {
  std::string faces_of_ply, vertices;
  std::vector<std::vector<int32_t>> strips;
  size_t triangles = 0;
  const auto triangle = [&](int32_t a, int32_t b, int32_t c) {
    faces_of_ply += "3 " + std::to_string(a) + " " + std::to_string(b) + " " + std::to_string(c) + "\n";
    ++triangles;
  };
  for (size_t f = 0; f < faces(); ++f) {
    const std::vector<uint32_t> v = corners(f);
    const auto at = [&](size_t k) { return static_cast<int32_t>(v[k]); };
    if (v.size() == 4) {
      strips.push_back({at(0), at(1), at(3), at(2)});
      triangle(at(0), at(1), at(3)), triangle(at(3), at(1), at(2));
    } else {
      for (size_t k = 1; k + 1 < v.size(); ++k) strips.push_back({at(0), at(k), at(k + 1)}), triangle(at(0), at(k), at(k + 1));
    }
  }
  const std::string head = "element vertex " + std::to_string(mesh_.vertices()) + "\nproperty float x\nproperty float y\nproperty float z\n";
  std::istringstream text(tools::format("m.ply", mesh_, {.ascii = true}));
  for (std::string line; std::getline(text, line) && line != "end_header";) {
  }
  for (size_t v = 0; v < mesh_.vertices(); ++v) {
    std::string line;
    std::getline(text, line);
    vertices += line + "\n";
  }
  const Surface expected = tools::parse("ply\nformat ascii 1.0\n" + head + "element face " + std::to_string(triangles) +
                                            "\nproperty list uchar int vertex_indices\nend_header\n" + vertices + faces_of_ply,
                                        "m.ply");
  all_the_same("m.ply", expected, [&](Dialect& d) {
    PlyValues values{d, d.maybe(2), d.maybe(2)};
    const std::string type = d.one_of({"char", "short", "int", "uint", "ushort"});
    const auto index = [&](int32_t v) {
      if (values.ascii)
        values.whole(v);
      else if (type == "char")
        values.raw(static_cast<int8_t>(v));
      else if (type == "short" || type == "ushort")
        values.raw(static_cast<int16_t>(v));
      else
        values.raw(v);
    };
    const std::vector<std::vector<int32_t>> lists = joined_strips(d, strips);
    for (const std::vector<int32_t>& list : lists) {
      values.whole(static_cast<int32_t>(list.size()));
      for (const int32_t v : list) index(v);
      values.end();
    }
    std::string strips_body = std::move(values.out);
    values.out.clear();
    for (const knead::Vec3f& p : mesh_.points.host()) values.real(p.x), values.real(p.y), values.real(p.z), values.end();
    const bool strips_first = d.maybe(3);
    const std::string strip_head = "element tristrips " + std::to_string(lists.size()) + "\nproperty list int " + type + " vertex_indices\n";
    const char* const format = values.ascii ? "ascii" : values.big ? "binary_big_endian" : "binary_little_endian";
    const std::string elements = strips_first ? strip_head + head : head + strip_head;
    const std::string header = std::string("ply\nformat ") + format + " 1.0\n" + elements + "end_header\n";
    const std::string body = strips_first ? strips_body + values.out : values.out + strips_body;
    return values.ascii ? d.finish(header + body, false) : header + body;
  });
}

TEST_F(MeshDialects, StlIsTheSameMesh) {
  const auto corner = [&](size_t c) { return welded_.points.host()[welded_.topology->triangles[c]]; };
  all_the_same("m.stl", welded_, [&](Dialect& d) {
    const size_t triangles = welded_.topology->triangle_count();
    if (d.maybe(4)) {
      PlyValues values{d, false, false};
      values.out = d.one_of({"solid part", "COLOR=", "made by hand"});
      values.out.resize(80, d.one_of({' ', '\0'}));
      values.whole(d.one_of({static_cast<int32_t>(triangles), 0, -1}));
      for (size_t t = 0; t < triangles; ++t) {
        for (int k = 0; k < 3; ++k) values.real(0);
        for (size_t c = 3 * t; c < 3 * t + 3; ++c) values.real(corner(c).x), values.real(corner(c).y), values.real(corner(c).z);
        values.small(0), values.small(d.one_of<uint8_t>({0, 7}));
      }
      return values.out;
    }
    std::string text = d.word("solid") + d.one_of({"", " part", " a part of two\tsolids"}) + "\n";
    const std::string ending = d.one_of({"endsolid part", "endsolid", "end solid", ""});
    for (size_t t = 0; t < triangles; ++t) {
      if (t == triangles / 2 && d.maybe(3)) text += d.word(ending) + "\n" + d.word("solid two") + "\n";
      text += d.word("facet") + d.gap() + d.one_of({"", "normal 0 0 1", "normal nan nan nan", "normal 1.#QNAN 0 0", "NORMAL 0 0"}) + d.gap();
      text += d.word("outer") + d.gap() + d.word("loop") + d.gap();
      for (size_t c = 3 * t; c < 3 * t + 3; ++c)
        text += d.word("vertex") + d.gap() + d.number(corner(c).x) + d.gap() + d.number(corner(c).y) + d.gap() + d.number(corner(c).z) + d.gap();
      text +=
          d.word(d.one_of({"endloop", "end loop"})) + d.gap() + d.word(d.one_of({"endfacet", "end facet"})) + (d.broken_ ? d.gap() : d.line_end());
      if (text.back() == '\n' && d.maybe(8)) text += "colour 1 0 0\n";
    }
    return d.finish(text + "\n" + d.word(ending) + d.one_of({"", "\n"}));
  });
}

}  // namespace mesh_dialects_test
