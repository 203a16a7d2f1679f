// Inside io/mesh_*.cpp only: what the formats share.
#pragma once
#include <cmath>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "graph/api.h"
#include "io/files.h"
#include "io/mesh/mesh_io.h"
#include "io/mesh/text.h"
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
class KNEAD_API BadVertices {  // used by libknead_assimp too
 public:
  void check(const Vec3d& p, size_t number, int line = 0) {  // number from 1 in text formats of OBJ, from 0 else
    if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z)) add(number, line);
  }
  void raise(const std::string& name) const;  // throws when there are any

 private:
  void add(size_t number, int line);
  size_t count_ = 0;
  int first_line_ = 0;
  std::string listed_;
};

// Replaces attribute values that are not finite (or do not fit a float) by zero and counts them; positions are refused instead.
class AttributeNumbers {
 public:
  float clean(double v) {
    const auto narrow = static_cast<float>(v);
    return std::isfinite(narrow) ? narrow : (++bad_, 0.0f);
  }
  void warn(const char* what, std::vector<std::string>& warnings) const;

 private:
  size_t bad_ = 0;
};

// Side matter that a reader passes by so that the geometry can be had: one warning says how much of it and where it began.
class LeftOut {
 public:
  void add(int line, std::string_view text = {});
  size_t count() const { return count_; }
  int first_line() const { return first_line_; }
  const std::string& first_text() const { return first_text_; }
  // "2 lines that are no OBJ statements left out (first: line 1): 'version 2'"
  void warn(const char* singular, const char* plural, std::vector<std::string>& warnings) const;

 private:
  size_t count_ = 0;
  int first_line_ = 0;
  std::string first_text_;
};

// Faces of fewer than three corners: edges and points, left out of the surface.
class KNEAD_API ShortFaces {  // used by libknead_assimp too
 public:
  void add(size_t corners, size_t face, int line);  // line 0: the file has no lines
  void warn(std::vector<std::string>& warnings) const;

 private:
  size_t count_ = 0, first_face_ = 0, fewest_ = 3, most_ = 0;
  int first_line_ = 0;
};

// The normals to write for `surface`: its own while they belong to its points, else recomputed. Empty vectors when it has none.
struct CornerNormals {
  std::vector<Vec3f> normals;
  std::vector<int32_t> corner_normal;
};
CornerNormals normals_to_write(const Surface& surface, const WriteMeshOptions& options);

// Says which of PLY's own properties another format loses.
void note_own_properties(const char* format, const MeshAttributes* attributes, std::vector<std::string>& notes);

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
