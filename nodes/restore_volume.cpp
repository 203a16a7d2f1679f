#include "kernels/loop/restore_volume.h"

#include "graph/registry.h"

namespace knead {

namespace {

const char* const kManual = R"(Moves every vertex of H so that its tets regain their rest volumes (paper eq. 1-3).

For vertex a of a tet, 6 V = (d - a) . Base with Base = (b - d) x (c - d): a step delta of a changes 6 V by -delta . Base. The step is the least-squares
solution over all tets of the vertex, regularised because flat neighbourhoods leave directions undetermined:

  (sum w Base Base^T + lambda (tr/3) I) delta = sum w Base (6 V - 6 V0)

`errors: relative` is w = 1/V0: a tet counts by its relative error. `plain` is w = 1, the paper's system; on an H of cells of several sizes the large tets
then drown the small ones next to them, which invert.

All vertices move at once. The four corners of a tet then correct the same error together, so only a part of the step is taken: `relaxation` below 0.5
settles, 1 diverges. `sweeps` repeats the step with parts that follow Chebyshev's polynomial: 2 keep a pressed body's volume within 1 %, 4 to 8 are for
crushes. Inverted tets have a negative volume and are turned back by the same step. No vertex moves further than `max_step` times the mean edge of H.

Volume errors of a millionth are taken for rounding, so that H at rest stays at rest to the bit. Positions are in tet space.

Source: Aldrich, Pinskiy, Hamann, "Collision-Driven Volumetric Deformation on the GPU", 3.3; weights, relaxation and regularisation are ours.)";

class RestoreVolumeNode : public Node {
 public:
  In<Points> points{this, "points", {.unit = "cells", .shape = "vertices of H", .doc = "H as the other steps left it, in tet space"}};
  In<TetMesh> tets{this, "tets", {.doc = "H at rest"}};
  Param<double> relaxation{
      this, "relaxation", RestoreVolumeSettings{}.relaxation, {.min = 0, .max = 1, .doc = "mean part of the step that is taken"}};
  Param<double> regularisation{
      this,
      "regularisation",
      RestoreVolumeSettings{}.regularisation,
      {.min = 0, .max = 10, .doc = "lambda: how much a direction that volumes do not determine is held, relative to the mean one"}};
  Param<double> max_step{
      this, "max_step", RestoreVolumeSettings{}.max_step, {.min = 0, .unit = "mean edges of H", .doc = "longest move of a vertex"}};
  Param<int> sweeps{this, "sweeps", RestoreVolumeSettings{}.sweeps, {.min = 1, .max = 64, .doc = "how often the step is made"}};
  Param<std::string> errors{this, "errors", "relative", {.choices = {"relative", "plain"}, .doc = "how the tets of a vertex are weighted"}};
  Out<Points> result{this, "points", {.unit = "cells", .shape = "vertices of H", .doc = "H with volumes nearer to rest"}};

  Runs runs() const override { return Runs::kAnyDevice; }

  void evaluate(Context& context) const override {
    RestoreVolumeSettings settings;
    settings.relaxation = relaxation();
    settings.regularisation = regularisation();
    settings.max_step = max_step();
    settings.relative = errors() == "relative";
    settings.sweeps = sweeps();
    context.set(result, Points{restore_volume(context.executor(), context.get(points).values, context.get(tets), settings)});
  }
};

}  // namespace

KNEAD_REGISTER(restore_volume, RestoreVolumeNode, 1, kManual)

}  // namespace knead
