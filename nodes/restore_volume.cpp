#include "graph/registry.h"
#include "kernels/restore_volume.h"

namespace knead {

namespace {

const char* const kManual = R"(Moves every vertex of H so that its tets regain their rest volumes (paper eq. 1-3).

For vertex a of a tet, 6 V = (d - a) . Base with Base = (b - d) x (c - d): a step delta of a changes 6 V by -delta . Base. The step is the least-squares
solution over all tets of the vertex, regularised because flat neighbourhoods leave directions undetermined:

  (sum Base Base^T + lambda (tr/3) I) delta = sum Base (6 V - 6 V0)

All vertices move at once. The four corners of a tet then correct the same error together, so only a part of the step is taken: `relaxation` 0.25 to 0.4
settles, 1 diverges. Inverted tets have a negative volume and are turned back by the same step. No vertex moves further than `max_step` times the mean edge
of H. `sweeps` repeats the step, for more volume and less stretch per iteration of the loop.

Volume errors of a millionth are taken for rounding, so that H at rest stays at rest to the bit. Positions are in tet space.

Source: Aldrich, Pinskiy, Hamann, "Collision-Driven Volumetric Deformation on the GPU", 3.3; relaxation and regularisation are ours.)";

class RestoreVolumeNode : public Node {
 public:
  In<Points> points{this, "points", {.unit = "cells", .shape = "vertices of H", .doc = "H as the other steps left it, in tet space"}};
  In<TetMesh> tets{this, "tets", {.doc = "H at rest"}};
  Param<double> relaxation{this, "relaxation", RestoreVolumeSettings{}.relaxation, {.min = 0, .max = 1, .doc = "part of the step that is taken"}};
  Param<double> regularisation{this, "regularisation", RestoreVolumeSettings{}.regularisation,
                               {.min = 0, .max = 10, .doc = "lambda: how much a direction that volumes do not determine is held, relative to the mean one"}};
  Param<double> max_step{this, "max_step", RestoreVolumeSettings{}.max_step, {.min = 0, .unit = "mean edges of H", .doc = "longest move of a vertex"}};
  Param<int> sweeps{this, "sweeps", 1, {.min = 1, .max = 100, .doc = "how often the step is made"}};
  Out<Points> result{this, "points", {.unit = "cells", .shape = "vertices of H", .doc = "H with volumes nearer to rest"}};

  Runs runs() const override { return Runs::kAnyDevice; }

  void evaluate(Context& context) const override {
    const RestoreVolumeSettings settings{.relaxation = relaxation(), .regularisation = regularisation(), .max_step = max_step()};
    Buffer<Vec3f> x = context.get(points).values;
    for (int sweep = 0; sweep < sweeps(); ++sweep) {
      context.check_cancelled();
      x = restore_volume(context.executor(), x, context.get(tets), settings);
    }
    context.set(result, Points{std::move(x)});
  }
};

}  // namespace

KNEAD_REGISTER(restore_volume, RestoreVolumeNode, 1, kManual)

}  // namespace knead
