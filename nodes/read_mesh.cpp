// read_mesh: a surface from a file.
#include "graph/registry.h"
#include "io/files.h"
#include "io/mesh/mesh_io.h"
#include "kernels/port_types.h"

namespace knead {

namespace {

const char* const kManual = R"(Reads a surface from .obj, .ply (text or binary), .stl (text or binary) or .off.

A run of '#' in the file's name is the frame: head.####.obj at frame 7 is head.0007.obj. Relative paths count
from the graph file's folder. Polygons keep their corners, vertices their order; normals, texture coordinates,
colours, groups, objects and materials go along to write_mesh.

Coordinates are read in double. A mesh that lies far from the origin (more than 8 diagonals) is stored about a
round number near its centre, so that an offset of 1e6 costs no precision; the surface's placement undoes it.
Units are your own: nothing assumes a size.

Refused, with file, line and what to do: damaged and cut files, indices out of range, coordinates that are not
finite, meshes without faces or area. Read with a warning that says what is assumed: open, non-manifold,
inside-out and inconsistently oriented surfaces, several pieces, faces without area, unused and duplicate
vertices. What else a file holds is kept, or left out with a warning (docs/formats.md lists both). STL shares no
vertices, so its corners are always welded where they are bit-identical.

.glb, .gltf, .fbx, .dae and .3ds are read too where Knead was built with Assimp: polygons alone, welded. They are
for colliders and quick trials; a warning says when the order and count of the vertices are not the file's.)";

class ReadMesh : public Node {
 public:
  Param<std::string> path{this, "path", "", {.doc = "the file; '#'s in its name stand for the frame"}};
  Param<bool> weld{this, "weld", false, {.doc = "join vertices that lie at exactly the same place"}};
  Out<Surface> surface{
      this, "surface", {.unit = "the file's", .shape = "vertices", .doc = "the surface, with polygons and attributes as in the file"}};

  void configure() override {
    if (path().empty()) throw Error(ErrorCode::kGraph, Where{{}, 0, 0, {}, "path"}, "no file is named", "set path to a mesh file");
    check_readable_mesh_name(path());
  }
  bool depends_on_frame() const override { return has_frame_pattern(path()); }
  void add_to_key(Hasher& hasher, int frame) const override { hasher.add(file_content_key(frame_path(path(), frame))); }

  void evaluate(Context& context) const override {
    const std::string file = path_in_frame(path(), context);
    std::vector<std::string> warnings;
    Surface read = read_surface(file, {.weld = weld()}, warnings);
    context.check_cancelled();
    for (std::string& problem : describe_problems(read)) warnings.push_back(std::move(problem));
    for (const std::string& warning : warnings) context.warn(file + ": " + warning);
    context.set(surface, std::move(read));
  }
};

}  // namespace

KNEAD_REGISTER(read_mesh, ReadMesh, 2, kManual)

}  // namespace knead
