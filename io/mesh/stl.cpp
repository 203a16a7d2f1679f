// STL, ascii and binary, both ways. STL holds triangles and nothing else: corners at bit-identical places are joined on reading, the facet normals
// are not looked at, and polygons are written as the triangles that Knead works with.
#include <bit>
#include <cmath>
#include <cstring>

#include "io/mesh/raw_mesh.h"

namespace knead::mesh {

namespace {

constexpr size_t kHeaderBytes = 84, kFacetBytes = 50;

template <class T>
T little(const char* at) {
  char raw[sizeof(T)];
  std::memcpy(raw, at, sizeof(T));
  if constexpr (std::endian::native == std::endian::big) std::reverse(raw, raw + sizeof(T));
  return std::bit_cast<T>(raw);
}

template <class T>
void put(std::string& out, T value) {
  char raw[sizeof(T)];
  std::memcpy(raw, &value, sizeof(T));
  if constexpr (std::endian::native == std::endian::big) std::reverse(raw, raw + sizeof(T));
  out.append(raw, sizeof(T));
}

RawMesh read_binary(std::string_view bytes, const std::string& name, std::vector<std::string>& warnings) {
  const size_t facets = little<uint32_t>(bytes.data() + 80);
  const size_t there = (bytes.size() - kHeaderBytes) / kFacetBytes;
  if (facets > there)
    throw Error(ErrorCode::kFile, in_file(name),
                "the header announces " + counted(facets, "triangle", "triangles") + ", but the file ends in triangle " + std::to_string(there) +
                    " (counted from 0)",
                "the file is damaged or cut short; export or copy it again");
  if (facets > INT32_MAX / 3) throw Error(ErrorCode::kFile, in_file(name), "has more than 715,827,882 triangles");
  if (const size_t rest = bytes.size() - kHeaderBytes - facets * kFacetBytes; rest > 0)
    warnings.push_back(counted(rest, "byte follows", "bytes follow") + " the mesh; left out");
  RawMesh mesh;
  BadVertices bad;
  mesh.points.reserve(3 * facets);
  for (size_t f = 0; f < facets; ++f) {
    const char* at = bytes.data() + kHeaderBytes + f * kFacetBytes + 12;
    for (int corner = 0; corner < 3; ++corner, at += 12) {
      const Vec3d p{little<float>(at), little<float>(at + 4), little<float>(at + 8)};
      bad.check(p, mesh.points.size());
      mesh.topology.face_vertices.push_back(static_cast<uint32_t>(mesh.points.size()));
      mesh.points.push_back(p);
    }
    mesh.close_face();
  }
  bad.raise(name);
  return mesh;
}

void expect(TextReader& text, std::string_view found, const char* wanted) {
  if (found != wanted) text.fail(shown(found) + " stands where '" + wanted + "' should", "the file is damaged or cut short");
}

RawMesh read_ascii(std::string_view bytes, const std::string& name) {
  TextReader text(bytes, name);
  RawMesh mesh;
  BadVertices bad;
  const auto next = [&](const char* wanted) {
    if (!text.next_full_line()) text.fail(std::string("the file ends where '") + wanted + "' should stand", "the file is damaged or cut short");
    expect(text, text.word(), wanted);
  };
  bool inside = false;
  while (text.next_full_line()) {
    const std::string_view keyword = text.word();
    if (keyword == "solid") {
      if (inside) text.fail("'solid' stands inside a solid");
      inside = true;
      continue;
    }
    if (keyword == "endsolid") {
      inside = false;
      continue;
    }
    if (!inside) text.fail(shown(keyword) + " stands outside of a solid");
    expect(text, keyword, "facet");
    next("outer");
    expect(text, text.word(), "loop");
    for (int corner = 0; corner < 3; ++corner) {
      next("vertex");
      Vec3d p{};
      for (int k = 0; k < 3; ++k) p[k] = text.number("a coordinate");
      if (!text.line_is_over()) text.fail("a vertex has three coordinates");
      bad.check(p, mesh.points.size(), text.line());
      mesh.topology.face_vertices.push_back(static_cast<uint32_t>(mesh.points.size()));
      mesh.points.push_back(p);
    }
    mesh.close_face();
    next("endloop");
    next("endfacet");
  }
  if (inside) text.fail("the file has no 'endsolid'", "the file is damaged or cut short");
  bad.raise(name);
  return mesh;
}

bool looks_like_text(std::string_view bytes) {
  const size_t first = bytes.find_first_not_of(" \t\r\n");
  return first != std::string_view::npos && bytes.substr(first).starts_with("solid");
}

}  // namespace

RawMesh read_stl(std::string_view bytes, const std::string& name, std::vector<std::string>& warnings) {
  if (bytes.empty()) throw Error(ErrorCode::kInput, in_file(name), "is empty", "give a mesh with faces");
  // Many binary files begin with "solid" too; their size gives them away.
  const bool exact_size = bytes.size() >= kHeaderBytes && bytes.size() == kHeaderBytes + kFacetBytes * size_t{little<uint32_t>(bytes.data() + 80)};
  const bool has_zero_byte = bytes.substr(0, kHeaderBytes).find('\0') != std::string_view::npos;
  RawMesh mesh;
  if (!exact_size && looks_like_text(bytes) && !has_zero_byte) {
    mesh = read_ascii(bytes, name);
  } else {
    if (bytes.size() < kHeaderBytes)
      throw Error(ErrorCode::kFile, in_file(name), "is no STL file: neither 'solid' at its beginning nor the 84 bytes of a binary header",
                  "check the file's ending");
    mesh = read_binary(bytes, name, warnings);
  }
  mesh.weld = true;
  return mesh;
}

std::string write_stl(const Surface& surface, const WriteMeshOptions& options, std::vector<std::string>& notes) {
  const MeshTopology& topology = *surface.topology;
  const auto points = surface.points.host();
  const bool wide = !surface.placement.is_identity();
  const MeshAttributes* attributes = surface.attributes.get();
  if (topology.triangle_count() != topology.faces())
    notes.push_back("STL holds triangles only: polygons are written as triangles, faces without area left out");
  if (attributes && (!attributes->normals.empty() || !attributes->texture_coordinates.empty() || !attributes->vertex_colours.empty() ||
                     !attributes->groups.empty() || !attributes->objects.empty() || !attributes->materials.empty()))
    notes.push_back("STL has no place for normals by vertex, texture coordinates, colours, groups, objects and materials; left out");
  if (wide && surface.placement.translation.x + surface.placement.translation.y + surface.placement.translation.z != 0 && !options.ascii)
    notes.push_back("binary STL is single precision: of a mesh far from the origin it loses digits; .ply and .obj do not");

  TextWriter text(options.precision);
  std::string out;
  if (options.ascii)
    text.text("solid knead\n");
  else
    out = "Written by Knead", out.resize(80, ' '), put(out, static_cast<uint32_t>(topology.triangle_count())),
    out.reserve(84 + 50 * topology.triangle_count());
  for (size_t t = 0; t < topology.triangle_count(); ++t) {
    const uint32_t* corner = &topology.triangles[3 * t];
    const Vec3d a = to_double(points[corner[0]]);
    Vec3d normal = cross(to_double(points[corner[1]]) - a, to_double(points[corner[2]]) - a);
    const double size = length(normal);
    normal = size > 0 ? surface.placement.rotate(normal * (1 / size)) : Vec3d{0, 0, 0};
    const Vec3f unit = to_float(normal);
    if (options.ascii) {
      text.text("facet normal ").vector(unit).text("\nouter loop\n");
      for (int k = 0; k < 3; ++k) text.text("vertex ").point(surface, corner[k]).text("\n");
      text.text("endloop\nendfacet\n");
    } else {
      put(out, unit.x), put(out, unit.y), put(out, unit.z);
      for (int k = 0; k < 3; ++k) {
        const Vec3f p = wide ? to_float(surface.placement.apply(to_double(points[corner[k]]))) : points[corner[k]];
        put(out, p.x), put(out, p.y), put(out, p.z);
      }
      put(out, uint16_t{0});
    }
  }
  return options.ascii ? text.text("endsolid knead\n").take() : out;
}

}  // namespace knead::mesh
