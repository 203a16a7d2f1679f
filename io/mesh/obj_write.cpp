// Wavefront OBJ, writing: everything that read_obj keeps, in the order of the surface's vertices and faces.
#include <cmath>

#include "io/mesh/raw_mesh.h"

namespace knead::mesh {

namespace {

// One of g, o, usemtl: a statement where the name changes from one face to the next.
class NameStatements {
 public:
  NameStatements(const char* keyword, const std::vector<std::string>& names, const std::vector<int32_t>& faces)
      : keyword_(keyword), names_(names), faces_(faces) {}
  void before_face(size_t face, TextWriter& out) {
    if (face >= faces_.size() || faces_[face] == current_ || faces_[face] < 0) return;
    current_ = faces_[face];
    out.text(keyword_).text(" ").text(names_[static_cast<size_t>(current_)]).text("\n");
  }

 private:
  const char* keyword_;
  const std::vector<std::string>& names_;
  const std::vector<int32_t>& faces_;
  int32_t current_ = -1;
};

}  // namespace

std::string write_obj(const Surface& surface, const WriteMeshOptions& options, std::vector<std::string>& notes) {
  static const MeshAttributes kNone;
  const MeshTopology& topology = *surface.topology;
  const MeshAttributes& attributes = surface.attributes ? *surface.attributes : kNone;
  const CornerNormals shading = normals_to_write(surface, options);
  const bool coloured = attributes.vertex_colours.size() == surface.vertices();
  const bool textured = attributes.corner_texture.size() == topology.corners();
  const bool shaded = shading.corner_normal.size() == topology.corners();

  TextWriter out(options.precision);
  out.reserve(64 + surface.vertices() * 40 + attributes.texture_coordinates.size() * 24 + shading.normals.size() * 40 +
              topology.corners() * (8 + 8 * (textured + shaded)) + topology.faces() * 3);
  out.text("# Written by Knead\n");
  if (!attributes.material_library.empty()) out.text("mtllib ").text(attributes.material_library).text("\n");
  bool transparent = false;
  for (size_t i = 0; i < surface.vertices(); ++i) {
    out.text("v ").point(surface, i);
    if (coloured) {
      const auto& c = attributes.vertex_colours[i];
      transparent = transparent || c[3] != 1;
      out.text(" ").vector(Vec3f{c[0], c[1], c[2]});
    }
    out.text("\n");
  }
  if (transparent) notes.push_back("OBJ has no place for the colours' alpha; left out");
  note_own_properties("OBJ", &attributes, notes);
  if (textured)
    for (const auto& t : attributes.texture_coordinates) out.text("vt ").real(t[0]).text(" ").real(t[1]).text("\n");
  if (shaded)
    for (const Vec3f& n : shading.normals) out.text("vn ").vector(n).text("\n");

  NameStatements objects("o", attributes.objects, attributes.face_object), groups("g", attributes.groups, attributes.face_group),
      materials("usemtl", attributes.materials, attributes.face_material);
  for (size_t face = 0; face < topology.faces(); ++face) {
    objects.before_face(face, out);
    groups.before_face(face, out);
    materials.before_face(face, out);
    out.text("f");
    for (uint32_t c = topology.face_offsets[face]; c < topology.face_offsets[face + 1]; ++c) {
      out.text(" ").whole(int64_t{topology.face_vertices[c]} + 1);
      const int32_t t = textured ? attributes.corner_texture[c] : -1;
      const int32_t n = shaded ? shading.corner_normal[c] : -1;
      if (t >= 0) out.text("/").whole(int64_t{t} + 1);
      if (n >= 0) out.text(t >= 0 ? "/" : "//").whole(int64_t{n} + 1);
    }
    out.text("\n");
  }
  return out.take();
}

}  // namespace knead::mesh
