// write_mesh: a surface to a file.
#include "graph/registry.h"
#include "io/files.h"
#include "io/mesh/mesh_io.h"
#include "kernels/port_types.h"

namespace knead {

namespace {

const char* const kManual = R"(Writes a surface to .obj, .ply (binary unless ascii is set) or .stl (likewise), in world coordinates.

A run of '#' in the file's name is the frame: out/head.####.obj at frame 7 is out/head.0007.obj. Without one,
each frame overwrites the last. Missing folders are made. The file appears whole or not at all: it is written
under a temporary name, synced and renamed.

What was read with the mesh is written with it, as far as the format has a place for it: .obj takes all but the
colours' alpha and a .ply file's own properties; .ply takes no groups, objects, materials, or normals with sharp
edges; .stl takes triangles only. What is left out is said in a warning. Normals are written as they were read while the surface has its
rest shape; once it has deformed they are recomputed, area-weighted, with hard edges kept.

Numbers are written with as many digits as it takes to read the same number back; precision asks for fewer.)";

class WriteMesh : public Node {
 public:
  In<Surface> surface{this, "surface", {.unit = "local", .shape = "vertices", .doc = "what to write"}};
  Param<std::string> path{this, "path", "", {.doc = "the file; '#'s in its name stand for the frame"}};
  Param<bool> ascii{this, "ascii", false, {.doc = "write .ply and .stl as text"}};
  Param<int> precision{this, "precision", 0, {.min = 0, .max = 17, .unit = "digits", .doc = "significant digits in text; 0: exact"}};

  void configure() override {
    if (path().empty()) throw Error(ErrorCode::kGraph, Where{{}, 0, 0, {}, "path"}, "no file is named", "set path to the mesh file to write");
    check_writable_mesh_name(path());
  }
  bool depends_on_frame() const override { return has_frame_pattern(path()); }
  bool has_effect() const override { return true; }

  void evaluate(Context& context) const override {
    const std::string file = path_in_frame(path(), context);
    context.check_cancelled();
    for (const std::string& note :
         write_surface(file, context.get(surface), {.ascii = ascii(), .precision = precision(), .recompute_normals = false}))
      context.warn(file + ": " + note);
  }
};

}  // namespace

KNEAD_REGISTER(write_mesh, WriteMesh, 1, kManual)

}  // namespace knead
