// Meshes in and out. The format follows the name's ending: .obj, .ply, .stl, and .off for reading.
//
// Points are parsed in double. Where a mesh lies far from the origin (its box centre further than 8 diagonals) a round number near the centre is
// taken off in double and becomes placement.translation, so that the float32 points keep their precision; elsewhere the placement is the identity and
// the points are the floats nearest to the text. Writing applies the placement in double and prints the shortest text that reads back to the same
// number: a rest shape that is written and read again has the same bits.
//
// What a format holds of polygons, normals, texture coordinates, colours, groups, objects and materials survives the round trip; see the top of
// mesh_*.cpp.
#pragma once
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "kernels/port_types.h"

namespace knead {

struct ReadMeshOptions {
  bool weld = false;  // join vertices at exactly the same place; .stl, which has no shared vertices, is always welded
};

struct WriteMeshOptions {
  bool ascii = false;              // .ply and .stl as text
  int precision = 0;               // significant digits in text; 0: as many as it takes to read the same number back
  bool recompute_normals = false;  // even where the points are those that the normals were read with
};

// Throws Error(kFile) for what is not the format (naming file, line and column, or the element of a binary file) and Error(kInput) for what is no
// usable surface: no faces, no area, coordinates that are no finite numbers. What was doubtful but could be kept is told in `warnings`.
KNEAD_API Surface read_surface(const std::string& path, std::vector<std::string>& warnings);
KNEAD_API Surface read_surface(const std::string& path, const ReadMeshOptions& options, std::vector<std::string>& warnings);
// The same from memory; `name` gives the format by its ending, and the place in errors.
KNEAD_API Surface parse_surface(std::string_view bytes, const std::string& name, const ReadMeshOptions& options, std::vector<std::string>& warnings);

// Written whole or not at all (io/files.h). Normals that the surface carries are written as they are while its points are those they were made for,
// and recomputed (area-weighted, hard edges kept) once it has deformed. Returns what the format had no room for, one sentence each.
KNEAD_API std::vector<std::string> write_surface(const std::string& path, const Surface& surface, const WriteMeshOptions& options = {});
KNEAD_API std::string format_surface(const std::string& name, const Surface& surface, const WriteMeshOptions& options,
                                     std::vector<std::string>& notes);

// A surface from world positions in double and polygons: chooses the placement, triangulates, finds the box, checks. `name` is the place in errors.
KNEAD_API Surface make_surface(std::span<const Vec3d> points_world, MeshTopology polygons, MeshAttributes attributes, const ReadMeshOptions& options,
                               const std::string& name, std::vector<std::string>& warnings);

// What is unusual about the surface as the border of a solid, each with its count and with what Knead assumes: open, non-manifold, duplicate
// vertices, disagreeing or inverted orientation, self-intersections, several pieces. Empty for a clean closed surface.
KNEAD_API std::vector<std::string> describe_problems(const Surface& surface);

// Throws a clear Error when `name` has no ending that can be read (written).
KNEAD_API void check_readable_mesh_name(const std::string& name);
KNEAD_API void check_writable_mesh_name(const std::string& name);

}  // namespace knead
