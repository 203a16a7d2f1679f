// STL, ascii and binary, both ways. STL holds triangles and nothing else: corners at bit-identical places are joined on reading, the facet normals
// are not looked at, and polygons are written as the triangles that Knead works with.
#include <algorithm>
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

// What a binary file's count says. Programs that write without knowing how many triangles come leave 0 or -1: then the file's length says it.
size_t facets_of(std::string_view bytes, const std::string& name, std::vector<std::string>& warnings) {
  const size_t facets = little<uint32_t>(bytes.data() + 80);
  const size_t there = (bytes.size() - kHeaderBytes) / kFacetBytes, rest = (bytes.size() - kHeaderBytes) % kFacetBytes;
  if ((facets == 0 || facets == UINT32_MAX) && there > 0 && rest == 0) {
    warnings.push_back("the count says " + std::string(facets == 0 ? "0" : "-1") + ", the file holds " +
                       counted(there, "whole facet", "whole facets"));
    return there;
  }
  if (facets > there)
    throw Error(ErrorCode::kFile, in_file(name),
                "the header announces " + counted(facets, "triangle", "triangles") + ", but the file ends in triangle " + std::to_string(there) +
                    " (counted from 0)",
                "the file is damaged or cut short; export or copy it again");
  if (facets == 0 && there > 0)
    throw Error(ErrorCode::kFile, in_file(name),
                "the header announces no triangles, and what follows is no whole number of them: the file ends in triangle " + std::to_string(there) +
                    " (counted from 0)",
                "the file is damaged or cut short; export or copy it again");
  if (const size_t left = bytes.size() - kHeaderBytes - facets * kFacetBytes; left > 0)
    warnings.push_back(counted(left, "byte follows", "bytes follow") + " the mesh; left out");
  return facets;
}

RawMesh read_binary(std::string_view bytes, const std::string& name, std::vector<std::string>& warnings) {
  const size_t facets = facets_of(bytes, name, warnings);
  if (facets > INT32_MAX / 3) throw Error(ErrorCode::kFile, in_file(name), "has more than 715,827,882 triangles");
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

constexpr std::string_view kKeywords[] = {"outer", "loop", "outerloop", "vertex", "endloop", "endfacet", "facet", "solid", "endsolid", "end"};

bool is_keyword(std::string_view word) {
  if (word.empty() || word[0] < 'A') return false;  // a number
  return std::any_of(std::begin(kKeywords), std::end(kKeywords), [&](std::string_view keyword) { return same_word(word, keyword); });
}

// Text: a stream of words in either case. Lines matter to the names of solids alone, which may be of several words.
class AsciiStl {
 public:
  AsciiStl(std::string_view bytes, const std::string& name) : text_(bytes, name) {}

  RawMesh read(std::vector<std::string>& warnings) {
    bool inside = false;
    while (text_.more()) {
      const bool is_facet = text_.take_word("facet");
      const std::string_view word = is_facet ? "facet" : text_.word();
      if (is_facet || same_word(word, "facet")) {
        if (!inside) outside_.add(text_.line());
        facet();
      } else if (same_word(word, "solid")) {
        if (inside) unended_.add(text_.line());
        inside = true;
        pass_name();
      } else if (same_word(word, "endsolid") || (same_word(word, "end") && text_.more() && same_word(text_.word(), "solid"))) {
        inside = pass_name();
      } else if (is_keyword(word)) {
        text_.fail(shown(word) + " stands where 'facet' should", "the file is damaged or cut short");
      } else {
        unknown_.add(text_.line(), std::string(word) + " " + std::string(text_.rest()));
      }
    }
    if (inside) unended_.add(text_.line());
    if (unended_.count() > 0) warnings.push_back("the file has no 'endsolid'; every facet is whole");
    if (outside_.count() > 0)
      warnings.push_back(counted(outside_.count(), "facet stands", "facets stand") + " outside of a solid (first: line " +
                         std::to_string(outside_.first_line()) + "); every facet is whole");
    unknown_.warn("line that is no STL statement", "lines that are no STL statements", warnings);
    bad_.raise(text_.name());
    return std::move(mesh_);
  }

 private:
  // To the end of the line, or to the first facet in it; true when another solid begins before that.
  bool pass_name() {
    for (bool solid = false;;) {
      if (text_.line_is_over()) return text_.rest(), solid;
      const std::string_view word = text_.word();
      if (same_word(word, "facet") && !text_.line_is_over()) {
        const std::string_view next = text_.word();
        const bool begins = same_word(next, "normal") ? numbers_or_loop_follow() : same_word(next, "outer") || same_word(next, "outerloop");
        text_.back_to(begins ? word.data() : next.data());
        if (begins) return true;
      }
      solid = solid || same_word(word, "solid");
    }
  }

  // After "facet normal" in a line with a solid's name, which may hold these words too.
  bool numbers_or_loop_follow() {
    if (text_.line_is_over()) return false;
    const std::string_view word = text_.word();
    return same_word(word, "outer") || same_word(word, "outerloop") || (word[0] >= '+' && word[0] <= '9') || same_word(word.substr(0, 3), "nan");
  }

  void keyword(const char* wanted) {
    if (!text_.more() || !text_.take_word(wanted)) expect(next(wanted), wanted);
  }
  std::string_view next(const char* wanted) {
    if (!text_.more()) text_.fail(std::string("the file ends where '") + wanted + "' should stand", "the file is damaged or cut short");
    return text_.word();
  }
  void expect(std::string_view found, const char* wanted) {
    if (found != wanted && !same_word(found, wanted))
      text_.fail(shown(found) + " stands where '" + wanted + "' should", "the file is damaged or cut short");
  }
  void expect_end(const char* glued, const char* what) {
    if (text_.more() && text_.take_word(glued)) return;
    const std::string_view word = next(glued);
    if (same_word(word, "end"))
      expect(next(what), what);
    else
      expect(word, glued);
  }

  void facet() {
    std::string_view word = next("outer");
    if (same_word(word, "normal")) {  // which is not looked at, and may be of any numbers and of none
      const std::string_view rest = text_.rest();
      if (rest.find_first_of("oO") != std::string_view::npos) text_.back_to(rest.data());  // "outer" stands in the same line
      for (int parts = 0; parts < 4 && !is_keyword(word = next("outer"));) ++parts;
    }
    if (!same_word(word, "outerloop")) {
      expect(word, "outer");
      keyword("loop");
    }
    for (int corner = 0; corner < 3; ++corner) vertex();
    mesh_.close_face();
    expect_end("endloop", "loop");
    expect_end("endfacet", "facet");
  }

  void vertex() {
    keyword("vertex");
    Vec3d p{};
    for (int k = 0; k < 3; ++k) {
      if (!text_.more()) text_.fail("the file ends where a coordinate should stand", "the file is damaged or cut short");
      p[k] = text_.number("a coordinate");
    }
    if (!text_.line_is_over())
      if (const char c = text_.peek(); (c >= '0' && c <= '9') || c == '-' || c == '+' || c == '.') text_.fail("a vertex has three coordinates");
    bad_.check(p, mesh_.points.size(), text_.line());
    mesh_.topology.face_vertices.push_back(static_cast<uint32_t>(mesh_.points.size()));
    mesh_.points.push_back(p);
  }

  TextReader text_;
  RawMesh mesh_;
  BadVertices bad_;
  LeftOut unended_, outside_, unknown_;
};

bool looks_like_text(std::string_view bytes) {
  if (bytes.starts_with("\xef\xbb\xbf")) bytes.remove_prefix(3);
  const size_t first = bytes.find_first_not_of(" \t\r\n");
  if (first == std::string_view::npos) return false;
  if (same_word(bytes.substr(first, 5), "solid") || same_word(bytes.substr(first, 5), "facet")) return true;
  // Somebody's own lines come first.
  std::string head(bytes.substr(0, 4096));
  if (std::any_of(head.begin(), head.end(), [](char c) { return c < ' ' && c >= 0 && c != '\t' && c != '\r' && c != '\n'; })) return false;
  for (char& c : head) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  const size_t facet = head.find("facet");
  return facet != std::string::npos && head.find("vertex", facet) != std::string::npos;
}

}  // namespace

RawMesh read_stl(std::string_view bytes, const std::string& name, std::vector<std::string>& warnings) {
  if (bytes.empty()) throw Error(ErrorCode::kInput, in_file(name), "is empty", "give a mesh with faces");
  // Many binary files begin with "solid" too; their size gives them away, and zeros among their first triangles.
  const bool exact_size = bytes.size() >= kHeaderBytes && bytes.size() == kHeaderBytes + kFacetBytes * size_t{little<uint32_t>(bytes.data() + 80)};
  const size_t zero = bytes.substr(0, kHeaderBytes + 16 * kFacetBytes).find('\0');
  const bool binary = zero != std::string_view::npos && bytes.find_first_not_of(std::string_view("\0\x1a \r\n", 5), zero) != std::string_view::npos;
  RawMesh mesh;
  if (!exact_size && looks_like_text(bytes) && !binary) {
    mesh = AsciiStl(bytes, name).read(warnings);
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
  note_own_properties("STL", attributes, notes);
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
