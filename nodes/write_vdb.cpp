#include "graph/registry.h"
#include "io/files.h"
#include "io/vdb/vdb.h"
#include "kernels/port_types.h"

namespace knead {

namespace {

const char* const kManual = R"(Writes a signed distance field as a level set, in world units, to .vdb or .nvdb by the extension.

The grid is not resampled: its place in the world, with any rotation, becomes the grid's transform. Values are distances in world units, negative inside. The
whole inside is written as active voxels and a band outside; programs that want a narrow band on both sides should rebuild it (openvdb's sdfToSdf).

A run of '#' in the file's name is the frame: out/fist.####.vdb at frame 7 is out/fist.0007.vdb. Missing folders are made. The file appears whole or not at
all: it is written under a temporary name, synced and renamed. The triangles behind a field are not written.)";

class WriteVdb : public Node {
 public:
  In<Sdf> sdf{this, "sdf", {.unit = "world", .doc = "what to write"}};
  Param<std::string> path{this, "path", "", {.doc = "the file, .vdb or .nvdb; '#'s in its name stand for the frame"}};
  Param<std::string> grid{this, "grid", "surface", {.doc = "name of the grid in the file"}};

  void configure() override {
    if (path().empty()) throw Error(ErrorCode::kGraph, Where{{}, 0, 0, {}, "path"}, "no file is named", "set path to a .vdb or .nvdb file");
  }
  bool depends_on_frame() const override { return has_frame_pattern(path()); }
  bool has_effect() const override { return true; }

  void evaluate(Context& context) const override {
    const std::string file = path_in_frame(path(), context);
    context.check_cancelled();
    write_sdf(file, context.get(sdf), grid());
  }
};

}  // namespace

KNEAD_REGISTER(write_vdb, WriteVdb, 1, kManual)

}  // namespace knead
