#include "graph/registry.h"
#include "io/files.h"
#include "io/vdb/vdb.h"
#include "kernels/port_types.h"

namespace knead {

namespace {

const char* const kManual =
    R"(Reads a level set, negative inside, from .vdb (OpenVDB up to 13) or .nvdb (every NanoVDB 32, plain or packed).

`grid` names the grid; 'tool[1]' is the second one called 'tool'. Without it the first level set that is not empty is taken, and where none is marked as a level
set, the first grid with values of both signs; where there are several, a warning names them. Float, double, half and NanoVDB's quantised grids are
read; a grid of an unknown type, or a damaged one, is stepped over with a warning and does not refuse its file.

The grid's transform, translation, rotation and uniform voxel size, becomes the field's place in the world; values are distances in the same units. Voxels that
are not cubes, shear, mirrors and frusta are errors, since distances would have no meaning, and so are fog volumes, distances without a sign, and grids
that are negative outside. A grid that is not marked as a level set, or whose values do not change by one per unit of length, gets a warning. Distances in a
full box over a background of 0 are taken as a level set, and a band over zeros gets its inside and outside back from its signs, with a warning.

Most level sets know only a narrow band of about three voxels. Inside, a body can go deeper than that, so what the band does not hold is completed: the grid's
own surface is contoured and the inside gets true distances to it, at every depth. The outside band is the file's, up to 12 voxels.

A run of '#' in the file's name is the frame: smoke.####.vdb at frame 7 is smoke.0007.vdb.)";

class ReadVdb : public Node {
 public:
  Param<std::string> path{this, "path", "", {.doc = "the file; '#'s in its name stand for the frame"}};
  Param<std::string> grid{this, "grid", "", {.doc = "name of the grid; empty: the first level set that is not empty"}};
  Param<int> memory_limit{this, "memory_limit", 2048, {.min = 1, .unit = "MiB", .doc = "what the field may take"}};
  Out<Sdf> sdf{this, "sdf", {.unit = "world", .doc = "signed distance, negative inside"}};

  void configure() override {
    if (path().empty()) throw Error(ErrorCode::kGraph, Where{{}, 0, 0, {}, "path"}, "no file is named", "set path to a .vdb or .nvdb file");
  }
  bool depends_on_frame() const override { return has_frame_pattern(path()); }
  void add_to_key(Hasher& hasher, int frame) const override { hasher.add(file_content_key(frame_path(path(), frame))); }

  void evaluate(Context& context) const override {
    const std::string file = path_in_frame(path(), context);
    ReadSdf read = read_sdf(file, grid(), context.executor(), static_cast<uint64_t>(memory_limit()) << 20);
    for (const std::string& warning : read.warnings) context.warn(file + ": " + warning);
    context.set(sdf, std::move(read.sdf));
  }
};

}  // namespace

KNEAD_REGISTER(read_vdb, ReadVdb, 1, kManual)

}  // namespace knead
