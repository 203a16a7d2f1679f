// Wavefront OBJ, reading. Kept: v with colours, vt (u v), vn, n-gons, g, o, usemtl, and mtllib as text (the library itself is not opened). Left out
// with a warning: points, lines, curves, free-form surfaces, faces of two corners, lines that are no statements, and texture coordinates and normals
// that faces name and the file lacks. Silently left out: smoothing and display statements.
//
// Why not tinyobjloader (as Debian 12 ships it), which was tried first on the files that tests/io/mesh/formats_test.cpp and mesh_parse_test.cpp use:
//   - "v 1 one 0", "v nan nan nan" and "v inf 0 0" are read as zeros, without an error or a warning;
//   - relative indices that reach before the first vertex come out as index -1, indices past the end as they are, the latter with a warning only;
//   - coordinates are single precision: 1000000.131429 becomes 1000000.125, and a mesh far from the origin turns to steps;
//   - 50,000 vertices and 100,000 triangles took it 74 ms; with this reader the finished surface takes 25 ms.
#include <algorithm>
#include <cmath>
#include <unordered_map>

#include "io/mesh/raw_mesh.h"

namespace knead::mesh {

namespace {

constexpr std::string_view kKept[] = {"v", "vt", "vn", "f", "fo", "g", "o", "usemtl", "mtllib"};
constexpr std::string_view kNotFaces[] = {"p", "l", "curv", "curv2", "surf", "vp"};
constexpr std::string_view kIgnored[] = {"s",    "cstype", "deg",    "bmat",       "step",      "parm",  "trim",     "hole",
                                         "scrv", "sp",     "end",    "con",        "mg",        "bevel", "c_interp", "d_interp",
                                         "lod",  "maplib", "usemap", "shadow_obj", "trace_obj", "ctech", "stech",    "call",
                                         "csh",  "bsp",    "bzp",    "cdc",        "cdp",       "res",   "vc"};

template <size_t n>
bool is_one_of(const std::string_view (&words)[n], std::string_view word) {
  return std::any_of(words, words + n, [&](std::string_view known) { return same_word(word, known); });
}

bool begins_statement(std::string_view word) {
  return word.starts_with('#') || is_one_of(kKept, word) || is_one_of(kNotFaces, word) || is_one_of(kIgnored, word);
}

class ObjReader {
 public:
  ObjReader(std::string_view bytes, const std::string& name) : text_(bytes, name, begins_statement), bytes_(bytes.size()) {}

  RawMesh read(std::vector<std::string>& warnings) {
    mesh_.points.reserve(bytes_ / 64);
    while (text_.next_line()) {
      if (text_.line_is_over()) continue;
      const std::string_view keyword = text_.word();
      if (!statement(keyword)) uncommon(keyword);
    }
    if (mesh_.points.empty() && unknown_.count() > 0)
      text_.fail_at_line(unknown_.first_line(), shown(unknown_.first_text()) + " is no OBJ statement", "check the file's ending");
    check_forward_references();
    bad_.raise(text_.name());
    finish(warnings);
    return std::move(mesh_);
  }

 private:
  struct Names {
    std::vector<std::string> list;
    std::unordered_map<std::string, int32_t> index;
    std::vector<int32_t> faces;  // per face; filled from the first name on
    int32_t current = -1;

    void set(std::string_view name, size_t faces_so_far) {
      if (faces.empty()) faces.assign(faces_so_far, -1);
      const auto [it, added] = index.try_emplace(std::string(name), static_cast<int32_t>(list.size()));
      if (added) list.emplace_back(name);
      current = it->second;
      used = true;
    }
    void add_face() {
      if (used) faces.push_back(current);
    }
    bool used = false;
  };

  // False for what is no statement of a polygon mesh as it is written nearly everywhere.
  bool statement(std::string_view keyword) {
    if (keyword == "v") return vertex(), true;
    if (keyword == "f" || keyword == "fo") return face(), true;
    if (keyword == "vt") return texture_coordinate(), true;
    if (keyword == "vn") return normal(), true;
    if (keyword == "g") return groups_.set(text_.rest(), mesh_.topology.faces()), true;
    if (keyword == "o") return objects_.set(text_.rest(), mesh_.topology.faces()), true;
    if (keyword == "usemtl") return materials_.set(text_.rest(), mesh_.topology.faces()), true;
    if (keyword != "mtllib") return false;
    if (mesh_.attributes.material_library.empty()) mesh_.attributes.material_library = text_.rest();
    return true;
  }

  void uncommon(std::string_view keyword) {
    if (is_one_of(kNotFaces, keyword)) return not_faces_.add(text_.line());
    if (is_one_of(kIgnored, keyword)) return;
    for (const std::string_view kept : kKept)
      if (same_word(keyword, kept)) return void(statement(kept));  // in capitals
    const bool printable = std::none_of(keyword.begin(), keyword.end(), [](char c) { return c >= 0 && c < 32; });
    std::string line(keyword);
    if (printable) line += std::string(" ").append(text_.rest());
    if (!printable || may_be_geometry(line)) text_.fail(shown(keyword) + " is no OBJ statement", "mend the line, or begin it with # to leave it out");
    unknown_.add(text_.line(), line);
  }

  // A line of numbers without a statement, and numbers after a word that begins like a vertex's or a face's, may be geometry that was damaged.
  static bool may_be_geometry(const std::string& line) {
    TextReader words(line, {});
    words.next_line();
    const char first = words.peek();
    if (!std::isnan(words.number_or_nan())) return true;
    size_t numbers = 0;
    for (; !words.line_is_over(); ++numbers)
      if (std::isnan(words.number_or_nan())) return false;
    return numbers >= 3 && (first == 'v' || first == 'V' || first == 'f' || first == 'F');
  }

  void vertex() {
    Vec3d p{};
    for (int k = 0; k < 3; ++k) p[k] = text_.number("a coordinate");
    bad_.check(p, mesh_.points.size() + 1, text_.line());
    mesh_.points.push_back(p);
    if (text_.line_is_over()) return void(pad_colours());
    // One more number is the weight of rational curves; three or four are a colour.
    double more[4] = {0, 0, 0, 1};
    size_t count = 0;
    for (; !text_.line_is_over(); ++count) {
      const double value = text_.number("a colour or weight");
      if (count < 4) more[count] = value;
    }
    if (count == 2 || count > 4) extra_values_.add(text_.line());
    if (count == 3 || count == 4) {
      coloured_ = true;
      pad_colours(mesh_.points.size() - 1);
      std::array<float, 4> colour{};
      for (size_t k = 0; k < 4; ++k) {
        colour[k] = attribute_numbers_.clean(more[k]);
        largest_colour_ = std::max(largest_colour_, colour[k]);
      }
      mesh_.attributes.vertex_colours.push_back(colour);
    }
    pad_colours();
  }

  void pad_colours() {
    if (coloured_) pad_colours(mesh_.points.size());
  }
  void pad_colours(size_t size) { mesh_.attributes.vertex_colours.resize(std::max(size, mesh_.attributes.vertex_colours.size()), {1, 1, 1, 1}); }

  void texture_coordinate() {
    const double u = text_.number_or_nan();
    const double v = text_.line_is_over() ? 0 : text_.number_or_nan();
    mesh_.attributes.texture_coordinates.push_back({attribute_numbers_.clean(u), attribute_numbers_.clean(v)});
  }

  void normal() {
    double n[3];
    for (double& part : n) part = text_.number_or_nan();
    mesh_.attributes.normals.push_back({attribute_numbers_.clean(n[0]), attribute_numbers_.clean(n[1]), attribute_numbers_.clean(n[2])});
  }

  // 1 is the first so far, -1 the last so far; later ones may be named before they are there.
  int64_t vertex_reference() {
    const int64_t index = text_.integer("the number of a vertex");
    const auto count = static_cast<int64_t>(mesh_.points.size());
    if (index == 0) text_.fail("a face refers to vertex 0; OBJ counts from 1", "export the mesh again, or add 1 to every index");
    if (index < -count)
      text_.fail("a face refers to vertex " + std::to_string(index) + ", counted back from here, but there are only " + std::to_string(count) +
                 " so far");
    if (index > INT32_MAX) text_.fail("a face refers to vertex " + std::to_string(index) + ", which is more than a mesh can have");
    if (index > count) named_before_ = true;
    return index < 0 ? count + index : index - 1;
  }

  // Texture coordinates and normals are side matter: what is not there is left out when all have been read.
  static constexpr int64_t kNowhere = INT32_MAX;
  int64_t side_reference(size_t so_far) {
    const int64_t index = text_.integer("the number of a vertex");
    const auto count = static_cast<int64_t>(so_far);
    return index == 0 || index < -count || index > kNowhere ? kNowhere : index < 0 ? count + index : index - 1;
  }

  void face() {
    MeshAttributes& attributes = mesh_.attributes;
    MeshTopology& topology = mesh_.topology;
    const size_t first = topology.corners();
    while (!text_.line_is_over()) {
      const size_t corner = topology.corners();
      topology.face_vertices.push_back(static_cast<uint32_t>(vertex_reference()));
      if (text_.take('/')) {
        if (!text_.blank_or_over() && text_.peek() != '/')
          set_corner(attributes.corner_texture, corner, side_reference(attributes.texture_coordinates.size()));
        if (text_.take('/') && !text_.blank_or_over()) set_corner(attributes.corner_normal, corner, side_reference(attributes.normals.size()));
      }
      if (!text_.blank_or_over()) text_.fail("a corner of a face is written as 1, 1/2, 1//3 or 1/2/3");
    }
    if (const size_t corners = topology.corners() - first; corners < 3) {
      short_faces_.add(corners, topology.faces(), text_.line());
      topology.face_vertices.resize(first);
      for (std::vector<int32_t>* values : {&attributes.corner_texture, &attributes.corner_normal}) values->resize(std::min(values->size(), first));
      return;
    }
    if (topology.corners() > INT32_MAX) text_.fail("the mesh has more than 2,147,483,647 corners");
    mesh_.close_face();
    face_lines_.push_back(text_.line());
    groups_.add_face();
    objects_.add_face();
    materials_.add_face();
  }

  static void set_corner(std::vector<int32_t>& values, size_t corner, int64_t value) {
    if (values.capacity() <= corner) values.reserve(std::max<size_t>(64, 2 * corner));
    values.resize(corner, -1);
    values.push_back(static_cast<int32_t>(value));
  }

  void check_forward_references() const {
    const MeshTopology& topology = mesh_.topology;
    if (!named_before_) return;
    for (size_t face = 0; face < topology.faces(); ++face)
      for (uint32_t c = topology.face_offsets[face]; c < topology.face_offsets[face + 1]; ++c)
        if (topology.face_vertices[c] >= mesh_.points.size())
          text_.fail_at_line(face_lines_[face],
                             "a face refers to vertex " + std::to_string(int64_t{topology.face_vertices[c]} + 1) + ", but the file has only " +
                                 std::to_string(mesh_.points.size()),
                             unknown_.count() > 0
                                 ? "line " + std::to_string(unknown_.first_line()) + " is no OBJ statement: mend it if it was a vertex"
                                 : "the file is damaged or cut short; export it again");
  }

  // Corners that name what the file lacks name nothing. True when there were any.
  bool leave_out_missing(std::vector<int32_t>& values, size_t pool) {
    if (values.empty()) return false;
    const MeshTopology& topology = mesh_.topology;
    values.resize(topology.corners(), -1);
    bool any = false, all = true;
    for (size_t face = 0; face < topology.faces(); ++face) {
      bool here = false;
      for (uint32_t c = topology.face_offsets[face]; c < topology.face_offsets[face + 1]; ++c) {
        if (values[c] >= static_cast<int32_t>(pool)) here = true, values[c] = -1;
        all = all && values[c] < 0;
      }
      if (here) any = true, lacking_faces_.resize(topology.faces()), lacking_faces_[face] = true;
    }
    if (all) values.clear();
    return any;
  }

  void finish(std::vector<std::string>& warnings) {
    MeshAttributes& attributes = mesh_.attributes;
    const bool textures = leave_out_missing(attributes.corner_texture, attributes.texture_coordinates.size());
    const bool normals = leave_out_missing(attributes.corner_normal, attributes.normals.size());
    if (textures || normals) {
      LeftOut lacking;
      for (size_t face = 0; face < lacking_faces_.size(); ++face)
        if (lacking_faces_[face]) lacking.add(face_lines_[face]);
      const std::string kinds = textures && normals ? "texture coordinates and normals" : textures ? "texture coordinates" : "normals";
      lacking.warn(("face names " + kinds + " that are not in the file;").c_str(), ("faces name " + kinds + " that are not in the file;").c_str(),
                   warnings);
    }
    if (attributes.corner_texture.empty()) attributes.texture_coordinates.clear();
    if (attributes.corner_normal.empty()) attributes.normals.clear();
    short_faces_.warn(warnings);
    unknown_.warn("line that is no OBJ statement", "lines that are no OBJ statements", warnings);
    extra_values_.warn("vertex with values beside coordinates and colour: those are", "vertices with values beside coordinates and colour: those are",
                       warnings);
    if (largest_colour_ > 1) {
      warnings.push_back("vertex colours go beyond 1: taken as 0 to 255");
      for (auto& colour : attributes.vertex_colours)
        for (size_t k = 0; k < 3; ++k) colour[k] /= 255;
    }
    attributes.groups = std::move(groups_.list), attributes.face_group = std::move(groups_.faces);
    attributes.objects = std::move(objects_.list), attributes.face_object = std::move(objects_.faces);
    attributes.materials = std::move(materials_.list), attributes.face_material = std::move(materials_.faces);
    attribute_numbers_.warn("normals, texture coordinates and colours", warnings);
    not_faces_.warn("point, line or curve statement", "point, line and curve statements", warnings);
  }

  TextReader text_;
  size_t bytes_;
  RawMesh mesh_;
  BadVertices bad_;
  AttributeNumbers attribute_numbers_;
  Names groups_, objects_, materials_;
  std::vector<int> face_lines_;
  std::vector<bool> lacking_faces_;
  LeftOut not_faces_, unknown_, extra_values_;
  ShortFaces short_faces_;
  bool named_before_ = false;
  float largest_colour_ = 0;
  bool coloured_ = false;
};

}  // namespace

RawMesh read_obj(std::string_view bytes, const std::string& name, std::vector<std::string>& warnings) {
  return ObjReader(bytes, name).read(warnings);
}

}  // namespace knead::mesh
