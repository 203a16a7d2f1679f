// OFF, reading: vertices, faces, and the vertex colours of COFF. Face colours are left out.
#include "io/mesh/raw_mesh.h"

namespace knead::mesh {

namespace {

std::array<float, 4> read_colour(TextReader& text, AttributeNumbers& numbers) {
  std::array<float, 4> colour{1, 1, 1, 1};
  for (size_t k = 0; k < 4 && !text.line_is_over(); ++k) colour[k] = numbers.clean(text.number("a colour value"));
  return colour;
}

}  // namespace

RawMesh read_off(std::string_view bytes, const std::string& name, std::vector<std::string>& warnings) {
  TextReader text(bytes, name);
  if (!text.next_full_line()) throw Error(ErrorCode::kInput, in_file(name), "is empty", "give a mesh with faces");
  const std::string_view kind = text.word();
  if (kind != "OFF" && kind != "COFF")
    text.fail(shown(kind) + " stands where 'OFF' should", "Knead reads OFF and COFF; use .obj or .ply for the others");
  if (text.line_is_over() && !text.next_full_line()) text.fail("the file ends before its counts");
  const int64_t vertices = text.integer("the number of vertices"), faces = text.integer("the number of faces");
  if (vertices < 0 || faces < 0) text.fail("a negative count");
  if (static_cast<uint64_t>(vertices) > bytes.size() / 2 || static_cast<uint64_t>(faces) > bytes.size() / 2)
    text.fail("the counts are larger than the file", "the file is damaged or cut short");
  RawMesh mesh;
  BadVertices bad;
  AttributeNumbers numbers;
  for (int64_t i = 0; i < vertices; ++i) {
    if (!text.next_full_line())
      text.fail("the file ends at vertex " + std::to_string(i) + " of " + std::to_string(vertices), "the file is damaged or cut short");
    Vec3d p{};
    for (int k = 0; k < 3; ++k) p[k] = text.number("a coordinate");
    bad.check(p, static_cast<size_t>(i), text.line());
    mesh.points.push_back(p);
    if (kind == "COFF") mesh.attributes.vertex_colours.push_back(read_colour(text, numbers));
  }
  for (int64_t f = 0; f < faces; ++f) {
    if (!text.next_full_line())
      text.fail("the file ends at face " + std::to_string(f) + " of " + std::to_string(faces), "the file is damaged or cut short");
    const int64_t corners = text.integer("the number of corners");
    if (corners < 3) text.fail("a face has " + std::to_string(corners) + " corners; it needs at least three");
    for (int64_t k = 0; k < corners; ++k) {
      const int64_t v = text.integer("the number of a vertex");
      if (v < 0 || v >= vertices)
        text.fail("face " + std::to_string(f) + " refers to vertex " + std::to_string(v) + ", but the file has only " + std::to_string(vertices) +
                  " (counted from 0)");
      mesh.topology.face_vertices.push_back(static_cast<uint32_t>(v));
    }
    mesh.close_face();
  }
  bad.raise(name);
  float largest = 0;
  for (const auto& colour : mesh.attributes.vertex_colours) largest = std::max({largest, colour[0], colour[1], colour[2]});
  if (largest > 1)
    for (auto& colour : mesh.attributes.vertex_colours)
      colour = {colour[0] / 255, colour[1] / 255, colour[2] / 255, colour[3] > 1 ? colour[3] / 255 : colour[3]};
  numbers.warn("colours", warnings);
  return mesh;
}

}  // namespace knead::mesh
