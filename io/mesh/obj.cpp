// Wavefront OBJ, reading. Kept: v with colours, vt (u v), vn, n-gons, g, o, usemtl, and mtllib as text (the library itself is not opened). Left out
// with a warning: points, lines, curves and free-form surfaces. Silently left out: smoothing and display statements.
//
// Why not tinyobjloader (as Debian 12 ships it), which was tried first on the files that tests/io/mesh/formats_test.cpp and mesh_parse_test.cpp use:
//   - "v 1 one 0", "v nan nan nan" and "v inf 0 0" are read as zeros, without an error or a warning;
//   - relative indices that reach before the first vertex come out as index -1, indices past the end as they are, the latter with a warning only;
//   - coordinates are single precision: 1000000.131429 becomes 1000000.125, and a mesh far from the origin turns to steps;
//   - 50,000 vertices and 100,000 triangles took it 74 ms; with this reader the finished surface takes 25 ms.
#include <unordered_map>

#include "io/mesh/raw_mesh.h"

namespace knead::mesh {

namespace {

class ObjReader {
 public:
  ObjReader(std::string_view bytes, const std::string& name) : text_(bytes, name, true), bytes_(bytes.size()) {}

  RawMesh read(std::vector<std::string>& warnings) {
    mesh_.points.reserve(bytes_ / 64);
    while (text_.next_line()) {
      if (text_.line_is_over()) continue;
      statement(text_.word());
    }
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

  struct Reference {
    int64_t index;
    int line;
    const char* kind;
  };

  void statement(std::string_view keyword) {
    if (keyword[0] == '#') return;
    if (keyword == "v") return vertex();
    if (keyword == "f" || keyword == "fo") return face();
    if (keyword == "vt") return texture_coordinate();
    if (keyword == "vn") return normal();
    if (keyword == "g") return groups_.set(text_.rest(), mesh_.topology.faces());
    if (keyword == "o") return objects_.set(text_.rest(), mesh_.topology.faces());
    if (keyword == "usemtl") return materials_.set(text_.rest(), mesh_.topology.faces());
    if (keyword == "mtllib") {
      if (mesh_.attributes.material_library.empty()) mesh_.attributes.material_library = text_.rest();
      return;
    }
    for (const char* other : {"p", "l", "curv", "curv2", "surf", "vp"})
      if (keyword == other) return void(++not_faces_);
    for (const char* other : {"s",     "cstype", "deg",   "bmat",     "step",     "parm", "trim",   "hole",   "scrv",       "sp",        "end",
                              "con",   "mg",     "bevel", "c_interp", "d_interp", "lod",  "maplib", "usemap", "shadow_obj", "trace_obj", "ctech",
                              "stech", "call",   "csh",   "bsp",      "bzp",      "cdc",  "cdp",    "res",    "vc"})
      if (keyword == other) return;
    text_.fail(shown(keyword) + " is no OBJ statement", "mend the line, or begin it with # to leave it out");
  }

  void vertex() {
    Vec3d p{};
    for (int k = 0; k < 3; ++k) p[k] = text_.number("a coordinate");
    bad_.check(p, mesh_.points.size() + 1, text_.line());
    mesh_.points.push_back(p);
    if (text_.line_is_over()) return void(pad_colours());
    // One more number is the weight of rational curves; three or four are a colour.
    double more[4] = {0, 0, 0, 1};
    int count = 0;
    while (!text_.line_is_over()) {
      if (count == 4) text_.fail("a vertex has at most three coordinates and four colour values");
      more[count++] = text_.number("a colour or weight");
    }
    if (count == 2) text_.fail("a vertex has three coordinates and then one weight, three colour values or four, not two");
    if (count >= 3) {
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
    const double u = text_.number("a texture coordinate");
    const double v = text_.line_is_over() ? 0 : text_.number("a texture coordinate");
    mesh_.attributes.texture_coordinates.push_back({attribute_numbers_.clean(u), attribute_numbers_.clean(v)});
  }

  void normal() {
    double n[3];
    for (double& part : n) part = text_.number("a part of a normal");
    mesh_.attributes.normals.push_back({attribute_numbers_.clean(n[0]), attribute_numbers_.clean(n[1]), attribute_numbers_.clean(n[2])});
  }

  // 1 is the first so far, -1 the last so far; later ones may be named before they are there.
  int64_t reference(size_t so_far, const char* kind) {
    const int64_t index = text_.integer("the number of a vertex");
    const auto count = static_cast<int64_t>(so_far);
    if (index == 0) text_.fail(std::string("a face refers to ") + kind + " 0; OBJ counts from 1", "export the mesh again, or add 1 to every index");
    if (index < -count)
      text_.fail(std::string("a face refers to ") + kind + " " + std::to_string(index) + ", counted back from here, but there are only " +
                 std::to_string(count) + " so far");
    if (index < 0) return count + index;
    if (index > count) {
      if (index > INT32_MAX)
        text_.fail(std::string("a face refers to ") + kind + " " + std::to_string(index) + ", which is more than a mesh can have");
      forward_.push_back({index, text_.line(), kind});
    }
    return index - 1;
  }

  void face() {
    MeshAttributes& attributes = mesh_.attributes;
    const size_t first = mesh_.topology.corners();
    while (!text_.line_is_over()) {
      const size_t corner = mesh_.topology.corners();
      mesh_.topology.face_vertices.push_back(static_cast<uint32_t>(reference(mesh_.points.size(), "vertex")));
      if (text_.take('/')) {
        if (!text_.take('/')) {
          set_corner(attributes.corner_texture, corner, reference(attributes.texture_coordinates.size(), "texture coordinate"));
          if (text_.take('/') && !text_.blank_or_over()) set_corner(attributes.corner_normal, corner, reference(attributes.normals.size(), "normal"));
        } else if (!text_.blank_or_over()) {
          set_corner(attributes.corner_normal, corner, reference(attributes.normals.size(), "normal"));
        }
      }
      if (!text_.blank_or_over()) text_.fail("a corner of a face is written as 1, 1/2, 1//3 or 1/2/3");
    }
    const size_t corners = mesh_.topology.corners() - first;
    if (corners < 3) text_.fail("a face has " + counted(corners, "corner", "corners") + "; it needs at least three");
    if (mesh_.topology.corners() > INT32_MAX) text_.fail("the mesh has more than 2,147,483,647 corners");
    mesh_.close_face();
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
    for (const Reference& r : forward_) {
      const std::string kind = r.kind;
      const size_t there = kind == "vertex"   ? mesh_.points.size()
                           : kind == "normal" ? mesh_.attributes.normals.size()
                                              : mesh_.attributes.texture_coordinates.size();
      if (static_cast<size_t>(r.index) > there)
        text_.fail_at_line(r.line, "a face refers to " + kind + " " + std::to_string(r.index) + ", but the file has only " + std::to_string(there),
                           "the file is damaged or cut short; export it again");
    }
  }

  void finish(std::vector<std::string>& warnings) {
    MeshAttributes& attributes = mesh_.attributes;
    const size_t corners = mesh_.topology.corners();
    if (!attributes.corner_texture.empty()) attributes.corner_texture.resize(corners, -1);
    if (!attributes.corner_normal.empty()) attributes.corner_normal.resize(corners, -1);
    if (attributes.corner_texture.empty()) attributes.texture_coordinates.clear();
    if (attributes.corner_normal.empty()) attributes.normals.clear();
    if (largest_colour_ > 1) {
      warnings.push_back("vertex colours go beyond 1: taken as 0 to 255");
      for (auto& colour : attributes.vertex_colours)
        for (size_t k = 0; k < 3; ++k) colour[k] /= 255;
    }
    attributes.groups = std::move(groups_.list), attributes.face_group = std::move(groups_.faces);
    attributes.objects = std::move(objects_.list), attributes.face_object = std::move(objects_.faces);
    attributes.materials = std::move(materials_.list), attributes.face_material = std::move(materials_.faces);
    attribute_numbers_.warn("normals, texture coordinates and colours", warnings);
    if (not_faces_ > 0)
      warnings.push_back(counted(not_faces_, "point, line or curve statement", "point, line and curve statements") +
                         " left out: only faces make a surface");
  }

  TextReader text_;
  size_t bytes_;
  RawMesh mesh_;
  BadVertices bad_;
  AttributeNumbers attribute_numbers_;
  Names groups_, objects_, materials_;
  std::vector<Reference> forward_;
  size_t not_faces_ = 0;
  float largest_colour_ = 0;
  bool coloured_ = false;
};

}  // namespace

RawMesh read_obj(std::string_view bytes, const std::string& name, std::vector<std::string>& warnings) {
  return ObjReader(bytes, name).read(warnings);
}

}  // namespace knead::mesh
