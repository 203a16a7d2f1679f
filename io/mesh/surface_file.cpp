// From a parsed file to a Surface, and the choice of format.
#include <algorithm>
#include <array>
#include <cmath>

#include "graph/cancel.h"
#include "graph/hash.h"
#include "io/mesh/assimp.h"
#include "io/mesh/raw_mesh.h"
#include "io/mesh/triangulate.h"
#include "kernels/surface/weld.h"

namespace knead {

using namespace mesh;

namespace {

enum class Format { kObj, kPly, kStl, kOff, kAssimp, kUnknown };

Format format_of(const std::string& name) {
  const size_t dot = name.rfind('.');
  std::string ending = dot == std::string::npos || name.find('/', dot) != std::string::npos ? "" : name.substr(dot);
  for (char& c : ending) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return ending == ".obj"           ? Format::kObj
         : ending == ".ply"         ? Format::kPly
         : ending == ".stl"         ? Format::kStl
         : ending == ".off"         ? Format::kOff
         : is_assimp_ending(ending) ? Format::kAssimp
                                    : Format::kUnknown;
}

struct Box {
  Vec3d lower{HUGE_VAL, HUGE_VAL, HUGE_VAL}, upper{-HUGE_VAL, -HUGE_VAL, -HUGE_VAL};
  void add(const Vec3d& p) {
    for (int k = 0; k < 3; ++k) lower[k] = std::min(lower[k], p[k]), upper[k] = std::max(upper[k], p[k]);
  }
  double diagonal() const { return length(upper - lower); }
  Vec3d centre() const { return 0.5 * lower + 0.5 * upper; }
};

constexpr double kFarInDiagonals = 8;

// What to take off the points: nothing, or the centre rounded to about a quarter of the diagonal. A round number, since then the sum of it and of a
// float point is exact in double, and small changes of the points do not change it.
Vec3d offset_for(const Box& box) {
  const double diagonal = box.diagonal();
  const Vec3d centre = box.centre();
  if (!(diagonal > 0) || !(length(centre) > kFarInDiagonals * diagonal)) return {0, 0, 0};
  const double grain = std::exp2(std::floor(std::log2(diagonal)) - 2);
  return {std::round(centre.x / grain) * grain, std::round(centre.y / grain) * grain, std::round(centre.z / grain) * grain};
}

// The offset that reading the written points again would choose as well. Rounding to float moves the box by parts in 10^7, so one step nearly always
// settles it.
Vec3d stable_offset(std::span<const Vec3d> points, const std::vector<uint8_t>& used) {
  Box box;
  for (size_t i = 0; i < points.size(); ++i)
    if (used[i]) box.add(points[i]);
  Vec3d offset = offset_for(box);
  for (int round = 0; round < 4; ++round) {
    Box written;
    for (size_t i = 0; i < points.size(); ++i)
      if (used[i]) written.add(to_double(to_float(points[i] - offset)) + offset);
    const Vec3d again = offset_for(written);
    if (again.x == offset.x && again.y == offset.y && again.z == offset.z) break;
    offset = again;
  }
  return offset;
}

// Joins vertices at the same place; the first of them stays, so the order of the rest does too.
void weld_vertices(std::vector<Vec3f>& points, RawMesh& raw) {
  std::vector<uint32_t> renumbered = first_at_same_place(std::span<const Vec3f>(points));
  std::vector<std::array<float, 4>>& colours = raw.attributes.vertex_colours;
  uint32_t kept = 0;
  for (size_t i = 0; i < points.size(); ++i) {
    if (renumbered[i] != i) {
      renumbered[i] = renumbered[renumbered[i]];
      continue;
    }
    points[kept] = points[i];
    if (!colours.empty()) colours[kept] = colours[i];
    for (MeshProperty& property : raw.attributes.vertex_properties) property.values[kept] = property.values[i];
    renumbered[i] = kept++;
  }
  points.resize(kept);
  if (!colours.empty()) colours.resize(kept);
  for (MeshProperty& property : raw.attributes.vertex_properties) property.values.resize(kept);
  for (uint32_t& v : raw.topology.face_vertices) v = renumbered[v];
}

void check_polygons(const MeshTopology& topology, size_t vertices, const std::string& name) {
  if (vertices == 0) throw Error(ErrorCode::kInput, in_file(name), "holds no vertices", "give a mesh with faces");
  if (topology.faces() == 0)
    throw Error(ErrorCode::kInput, in_file(name), "holds " + counted(vertices, "vertex", "vertices") + " but no faces",
                "give a mesh with faces, not a point cloud");
  for (size_t f = 0; f < topology.faces(); ++f)
    for (uint32_t c = topology.face_offsets[f]; c < topology.face_offsets[f + 1]; ++c)
      if (topology.face_vertices[c] >= vertices)
        throw Error(ErrorCode::kInput, in_file(name),
                    "face " + std::to_string(f) + " refers to vertex " + std::to_string(topology.face_vertices[c]) + ", but there are only " +
                        counted(vertices, "vertex", "vertices"));
}

void warn_of_triangulation(const TriangulationNotes& notes, std::vector<std::string>& warnings) {
  if (notes.degenerate_faces > 0)
    warnings.push_back(counted(notes.degenerate_faces, "face has", "faces have") + " no area" +
                       (notes.repeated_corners ? " (" + std::to_string(notes.repeated_corners) + " of them with a repeated corner)" : "") +
                       "; kept in the polygons, left out of contact, volume and inside tests");
  if (notes.tangled_faces > 0)
    warnings.push_back(counted(notes.tangled_faces, "polygon is", "polygons are") +
                       " self-crossing or strongly bent; cut into triangles as well as can be");
}

Surface surface_from(RawMesh raw, const ReadMeshOptions& options, const std::string& name, std::vector<std::string>& warnings) {
  check_polygons(raw.topology, raw.points.size(), name);
  std::vector<uint8_t> used(raw.points.size(), 0);
  for (uint32_t v : raw.topology.face_vertices) used[v] = 1;
  const auto unused = static_cast<size_t>(std::count(used.begin(), used.end(), uint8_t{0}));
  if (unused > 0) warnings.push_back(counted(unused, "vertex belongs", "vertices belong") + " to no face; kept, and carried along without an effect");

  Surface surface;
  surface.placement.translation = stable_offset(raw.points, used);
  check_cancelled();
  std::vector<Vec3f> points(raw.points.size());
  BadVertices bad;
  for (size_t i = 0; i < points.size(); ++i) {
    points[i] = to_float(raw.points[i] - surface.placement.translation);
    bad.check(to_double(points[i]), i);
  }
  bad.raise(name);
  raw.points = {};
  if (options.weld || raw.weld) weld_vertices(points, raw);
  check_cancelled();

  warn_of_triangulation(triangulate(points, raw.topology), warnings);
  check_cancelled();
  if (raw.topology.triangles.empty())
    throw Error(ErrorCode::kInput, in_file(name), "none of its " + counted(raw.topology.faces(), "face", "faces") + " has any area",
                "check the vertex positions");
  Box box;
  for (uint32_t v : raw.topology.face_vertices) box.add(to_double(points[v]));
  surface.lower = to_float(box.lower);
  surface.upper = to_float(box.upper);
  if (!raw.attributes.normals.empty()) raw.attributes.normals_of = Hasher().bytes(points.data(), points.size() * sizeof(Vec3f)).key();
  surface.points = Buffer<Vec3f>(points);
  surface.topology = std::make_shared<const MeshTopology>(std::move(raw.topology));
  surface.attributes = std::make_shared<const MeshAttributes>(std::move(raw.attributes));
  return surface;
}

Surface surface_of_scene(std::string_view file, const ReadMeshOptions& options, const std::string& name, std::vector<std::string>& warnings) {
  RawMesh raw = read_assimp(file, name, warnings);
  const size_t before = raw.points.size();
  Surface surface = surface_from(std::move(raw), options, name, warnings);
  if (surface.vertices() != before)
    warnings.push_back("the format splits vertices where faces differ in more than place: " + std::to_string(before) + " of them are joined to " +
                       std::to_string(surface.vertices()) +
                       ", so their order and count are not the file's; good for a collider, for a soft body use .obj or .ply");
  return surface;
}

void check_before_writing(const std::string& name, const Surface& surface) {
  if (!surface.topology || surface.vertices() == 0) throw Error(ErrorCode::kInput, in_file(name), "cannot be written: the surface is empty");
  BadVertices bad;
  const auto points = surface.points.host();
  for (size_t i = 0; i < points.size(); ++i) bad.check(to_double(points[i]), i);
  bad.raise(name);
}

}  // namespace

void mesh::note_own_properties(const char* format, const MeshAttributes* attributes, std::vector<std::string>& notes) {
  if (!attributes) return;
  std::vector<std::string> names;
  for (const auto* properties : {&attributes->vertex_properties, &attributes->face_properties})
    for (const MeshProperty& property : *properties) names.push_back("'" + property.name + "'");
  if (!names.empty()) notes.push_back(std::string(format) + " has no place for a PLY file's own numbers: " + listed(names) + " left out");
}

Surface make_surface(std::span<const Vec3d> points_world, MeshTopology polygons, MeshAttributes attributes, const ReadMeshOptions& options,
                     const std::string& name, std::vector<std::string>& warnings) {
  RawMesh raw;
  raw.points.assign(points_world.begin(), points_world.end());
  raw.topology = std::move(polygons);
  raw.attributes = std::move(attributes);
  BadVertices bad;
  for (size_t i = 0; i < raw.points.size(); ++i) bad.check(raw.points[i], i);
  bad.raise(name);
  return surface_from(std::move(raw), options, name, warnings);
}

void check_readable_mesh_name(const std::string& name) {
  if (format_of(name) == Format::kUnknown)
    throw Error(ErrorCode::kFile, in_file(name), "is no mesh format that can be read, by its ending", "use .obj, .ply, .stl or .off");
  if (format_of(name) == Format::kAssimp && !assimp_is_built_in()) {
    std::vector<std::string> ignored;
    read_assimp({}, name, ignored);  // says what is missing
  }
}

void check_writable_mesh_name(const std::string& name) {
  if (const Format format = format_of(name); format == Format::kUnknown || format == Format::kOff || format == Format::kAssimp)
    throw Error(ErrorCode::kFile, in_file(name), "is no mesh format that can be written, by its ending", "use .obj, .ply or .stl");
}

Surface parse_surface(std::string_view file, const std::string& name, const ReadMeshOptions& options, std::vector<std::string>& warnings) {
  check_readable_mesh_name(name);
  std::string storage;
  const std::string_view bytes = single_bytes(file, storage);
  switch (format_of(name)) {
    case Format::kObj: return surface_from(read_obj(bytes, name, warnings), options, name, warnings);
    case Format::kPly: return surface_from(read_ply(bytes, name, warnings), options, name, warnings);
    case Format::kStl: return surface_from(read_stl(bytes, name, warnings), options, name, warnings);
    case Format::kAssimp: return surface_of_scene(file, options, name, warnings);
    default: return surface_from(read_off(bytes, name, warnings), options, name, warnings);
  }
}

Surface read_surface(const std::string& path, const ReadMeshOptions& options, std::vector<std::string>& warnings) {
  check_readable_mesh_name(path);
  return parse_surface(read_whole_file(path), path, options, warnings);
}

Surface read_surface(const std::string& path, std::vector<std::string>& warnings) {
  return read_surface(path, {}, warnings);
}

std::string format_surface(const std::string& name, const Surface& surface, const WriteMeshOptions& options, std::vector<std::string>& notes) {
  check_writable_mesh_name(name);
  check_before_writing(name, surface);
  switch (format_of(name)) {
    case Format::kObj: return write_obj(surface, options, notes);
    case Format::kPly: return write_ply(surface, options, notes);
    default: return write_stl(surface, options, notes);
  }
}

std::vector<std::string> write_surface(const std::string& path, const Surface& surface, const WriteMeshOptions& options) {
  std::vector<std::string> notes;
  const std::string bytes = format_surface(path, surface, options, notes);
  write_whole_file(path, bytes);
  return notes;
}

}  // namespace knead
