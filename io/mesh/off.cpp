// OFF, reading: vertices, faces, and by the letters before the word OFF (in any order and case) normals (N), colours (C) and texture coordinates (ST) of
// vertices, and the divisor of homogeneous coordinates (4). Face colours are left out with a warning.
//
// OFF is a stream of numbers, but how many belong to a face or, in files that are not quite OFF, to a vertex is often told by the line's end alone: three
// numbers after a triangle's corners are a colour there, and the next face where faces share lines. A file says its counts first, so the layouts are tried
// one after the other, and the first that uses up every number of the file exactly is the right one.
#include <algorithm>
#include <cmath>
#include <optional>

#include "io/mesh/raw_mesh.h"

namespace knead::mesh {

namespace {

struct Layout {
  bool exact = true;         // every number of the file must have its place
  bool vertex_lines = true;  // a vertex ends with its line: colours and what else follows its own numbers
  bool face_lines = true;    // likewise a face
  int colours = 4;           // where vertices do not end with their lines: numbers of a vertex's colour
  int face_colours = 0;      // where faces do not
  bool late_edges = false;   // the third count stands on a later line than the second
  bool bare = false;         // vertices are coordinates alone, whatever the letters before OFF say
};

// Layouts by how common they are. The last one, which is not exact, gives the errors.
std::vector<Layout> layouts(bool coloured, bool lettered) {
  std::vector<Layout> result{{}};
  for (const bool late : {false, true}) {
    if (late) result.push_back({.late_edges = true});
    for (const int colours : {4, 3})
      for (const bool vertex_lines : {false, true}) {
        if (!vertex_lines) result.push_back({.vertex_lines = false, .colours = colours, .late_edges = late});
        for (const int face_colours : {0, 4, 3, 1}) result.push_back({true, vertex_lines, false, colours, face_colours, late});
        if (!coloured && vertex_lines) break;
      }
  }
  if (lettered)
    for (const bool face_lines : {true, false}) result.push_back({.face_lines = face_lines, .bare = true});
  result.push_back({.exact = false});
  return result;
}

struct Kind {
  bool normals = false, colours = false, texture = false, divisor = false, dimension = false;
  bool has_letters() const { return normals || colours || texture || divisor; }
};

class OffReader {
 public:
  OffReader(std::string_view bytes, const std::string& name) : bytes_(bytes), name_(name), start_(bytes, name) { header(); }

  RawMesh read(std::vector<std::string>& warnings) {
    const Kind written = kind_;
    for (const Layout& layout : layouts(written.colours, written.has_letters())) {
      kind_ = layout.bare ? Kind{} : written;
      begin(layout);
      if (layout.late_edges && edges_known_) continue;
      try {
        vertices();
        faces();
        if (text_->more()) {
          if (layout.exact) continue;
          rest_.add(text_->line());
        }
        // Where no layout uses up the whole file, an element that does not begin a line might be made of another one's numbers.
        if (!layout.exact && shared_.count() > 0)
          text_->fail_at_line(shared_.first_line(), "the numbers of the file do not add up: elements share this line, which is too long or too short",
                              "the file is damaged, or its counts are");
      } catch (const Error&) {
        if (!layout.exact) throw;
        continue;
      }
      bad_.raise(name_);
      finish(warnings);
      break;
    }
    return std::move(mesh_);
  }

 private:
  // The letters before OFF, and how many characters of the word they and OFF take.
  static size_t kind_of(std::string_view word, Kind& kind) {
    size_t at = 0;
    const auto next_is = [&](std::string_view part) {
      if (!same_word(word.substr(at, part.size()), part)) return false;
      at += part.size();
      return true;
    };
    while (!next_is("off")) {
      if (word.substr(at).starts_with("nOFF"))
        kind.dimension = true, ++at;
      else if (next_is("st"))
        kind.texture = true;
      else if (next_is("c"))
        kind.colours = true;
      else if (next_is("n"))
        kind.normals = true;
      else if (next_is("4"))
        kind.divisor = true;
      else
        return kind = {}, 0;
    }
    return at;
  }

  void header() {
    if (!start_.more()) throw Error(ErrorCode::kInput, in_file(name_), "is empty", "give a mesh with faces");
    const std::string_view word = start_.word();
    const size_t taken = kind_of(word, kind_);
    const bool counts_follow = word.size() > taken && word[taken] >= '0' && word[taken] <= '9';
    if (word.size() > taken && !counts_follow)
      start_.fail(shown(word) + " stands where 'OFF' should", "Knead reads OFF, COFF, NOFF, STOFF and 4OFF; use .obj or .ply for the others");
    headless_ = taken == 0;
    start_.back_to(word.data() + taken);
    if (start_.more() && start_.peek() == 'B') start_.fail("is a binary OFF", "write it as text, or use .ply");
    if (kind_.dimension)
      if (const int64_t dimension = start_.integer("the number of dimensions"); dimension != 3)
        start_.fail("has " + std::to_string(dimension) + " dimensions", "give a mesh in three dimensions");
  }

  int64_t count(const char* what) {
    if (!text_->more()) text_->fail("the file ends before its counts");
    const int64_t n = text_->integer(what);
    if (n < 0) text_->fail("a negative count");
    if (static_cast<uint64_t>(n) > bytes_.size() / 2) text_->fail("the counts are larger than the file", "the file is damaged or cut short");
    return n;
  }

  void begin(const Layout& layout) {
    layout_ = layout;
    text_ = start_;
    mesh_ = {}, bad_ = {}, numbers_ = {}, short_faces_ = {}, face_colours_ = {}, beside_ = {}, rest_ = {}, shared_ = {};
    vertices_ = count("the number of vertices");
    faces_ = count("the number of faces");
    edges_known_ = !text_->line_is_over();
    if (edges_known_ || layout.late_edges) {
      if (text_->more()) text_->number_or_nan();  // nobody needs the number of edges
    }
  }

  double value(const char* what) {
    if (!text_->more()) text_->fail(std::string("the file ends where ") + what + " should stand", "the file is damaged or cut short");
    return text_->number(what);
  }

  [[noreturn]] void fail_short(const char* element, int64_t index, int64_t count) {
    text_->fail(std::string("the file ends at ") + element + " " + std::to_string(index) + " of " + std::to_string(count),
                "the file is damaged or cut short");
  }

  // What a line holds after the numbers of its element.
  void to_line_end(std::vector<double>& values) {
    values.clear();
    while (!text_->line_is_over()) values.push_back(text_->number_or_nan());
  }

  // An element that shares its line with others, or is spread over several and followed by more, is laid out by another rule than the lines'.
  void must_fit(bool fits) const {
    if (layout_.exact && !fits) throw Error(ErrorCode::kFile, in_file(name_, text_->line()), "another layout");
  }

  void vertices() {
    std::vector<double> more;
    std::optional<size_t> usual;
    MeshAttributes& attributes = mesh_.attributes;
    for (int64_t i = 0; i < vertices_; ++i) {
      const int line_before = text_->line();
      if (!text_->more()) fail_short("vertex", i, vertices_);
      const int began = text_->line();
      if (began == line_before) shared_.add(began);
      Vec3d p{};
      for (int k = 0; k < 3; ++k) p[k] = value("a coordinate");
      if (kind_.divisor) {
        const double divisor = value("a divisor");
        for (int k = 0; k < 3; ++k) p[k] /= divisor;
      }
      bad_.check(p, static_cast<size_t>(i), text_->line());
      mesh_.points.push_back(p);
      if (kind_.normals) {
        Vec3f n{};
        for (int k = 0; k < 3; ++k) n[k] = numbers_.clean(value("a part of a normal"));
        attributes.normals.push_back(n);
      }
      if (layout_.vertex_lines) {
        to_line_end(more);
        must_fit(more.size() == usual.value_or(more.size()) && (more.empty() || began == text_->line()));
        usual = more.size();
      } else {
        more.resize((kind_.colours ? static_cast<size_t>(layout_.colours) : 0) + (kind_.texture ? 2 : 0));
        for (double& v : more) v = value("a colour value");
      }
      keep(more);
    }
  }

  // Colour and texture coordinates of the latest vertex, out of the numbers that follow its coordinates.
  void keep(const std::vector<double>& more) {
    size_t used = 0;
    const size_t texture = kind_.texture && more.size() >= 2 ? 2 : 0;
    if (kind_.colours) {
      std::array<float, 4> colour{1, 1, 1, 1};
      for (; used < 4 && used + texture < more.size(); ++used) colour[used] = numbers_.clean(more[used]);
      mesh_.attributes.vertex_colours.push_back(colour);
    }
    if (texture > 0) {
      mesh_.attributes.texture_coordinates.push_back({numbers_.clean(more[used]), numbers_.clean(more[used + 1])});
      used += 2;
    }
    if (used < more.size()) beside_.add(text_->line());
  }

  void faces() {
    std::vector<double> more;
    MeshTopology& topology = mesh_.topology;
    for (int64_t f = 0; f < faces_; ++f) {
      const int line_before = text_->line();
      if (!text_->more()) fail_short("face", f, faces_);
      const int began = text_->line();
      if (began == line_before) shared_.add(began);
      const size_t first = topology.corners();
      const int64_t corners = text_->integer("the number of corners");
      if (corners < 0) text_->fail("a face has " + std::to_string(corners) + " corners; it needs at least three");
      for (int64_t k = 0; k < corners; ++k) {
        if (!text_->more()) fail_short("face", f, faces_);
        const int64_t v = text_->integer("the number of a vertex");
        if (v < 0 || v >= vertices_)
          text_->fail("face " + std::to_string(f) + " refers to vertex " + std::to_string(v) + ", but the file has only " +
                      std::to_string(vertices_) + " (counted from 0)");
        topology.face_vertices.push_back(static_cast<uint32_t>(v));
      }
      if (layout_.face_lines) {
        to_line_end(more);
        must_fit(more.empty() || (began == text_->line() && more.size() <= 4));
      } else {
        more.resize(static_cast<size_t>(layout_.face_colours));
        for (double& v : more) v = value("a colour value");
      }
      if (!more.empty()) face_colours_.add(text_->line());
      if (corners < 3) {
        short_faces_.add(static_cast<size_t>(corners), static_cast<size_t>(f), text_->line());
        topology.face_vertices.resize(first);
      } else {
        mesh_.close_face();
      }
    }
  }

  void finish(std::vector<std::string>& warnings) {
    MeshAttributes& attributes = mesh_.attributes;
    float largest = 0;
    for (const auto& colour : attributes.vertex_colours) largest = std::max({largest, colour[0], colour[1], colour[2]});
    if (largest > 1)
      for (auto& colour : attributes.vertex_colours)
        colour = {colour[0] / 255, colour[1] / 255, colour[2] / 255, colour[3] > 1 ? colour[3] / 255 : colour[3]};
    const auto& corners = mesh_.topology.face_vertices;
    if (kind_.normals) attributes.corner_normal.assign(corners.begin(), corners.end());
    if (attributes.texture_coordinates.size() == mesh_.points.size() && kind_.texture)
      attributes.corner_texture.assign(corners.begin(), corners.end());
    if (attributes.corner_texture.empty()) attributes.texture_coordinates.clear();
    numbers_.warn(kind_.normals || kind_.texture ? "normals, texture coordinates and colours" : "colours", warnings);
    if (layout_.bare) warnings.push_back("the letters before 'OFF' announce more of each vertex than the file holds");
    if (headless_) warnings.push_back("the file does not begin with 'OFF'; taken for OFF, since its counts fit");
    short_faces_.warn(warnings);
    beside_.warn("vertex with values that its kind of OFF has no place for: those are",
                 "vertices with values that their kind of OFF has no place for: those are", warnings);
    face_colours_.warn("face colour", "face colours", warnings);
    if (rest_.count() > 0) warnings.push_back("what follows the last face is left out (from line " + std::to_string(rest_.first_line()) + " on)");
  }

  std::string_view bytes_;
  const std::string& name_;
  TextReader start_;  // at the counts
  std::optional<TextReader> text_;
  Kind kind_;
  Layout layout_;
  int64_t vertices_ = 0, faces_ = 0;
  bool headless_ = false, edges_known_ = false;
  RawMesh mesh_;
  BadVertices bad_;
  AttributeNumbers numbers_;
  ShortFaces short_faces_;
  LeftOut face_colours_, beside_, rest_, shared_;
};

}  // namespace

RawMesh read_off(std::string_view bytes, const std::string& name, std::vector<std::string>& warnings) {
  return OffReader(bytes, name).read(warnings);
}

}  // namespace knead::mesh
