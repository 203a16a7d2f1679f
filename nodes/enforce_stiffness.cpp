#include "kernels/loop/enforce_stiffness.h"

#include "graph/registry.h"

namespace knead {

namespace {

const char* const kManual = R"(Brings H's edges nearer to their rest lengths (paper eq. 4, mended).

Each neighbour x_i of a vertex x0 wants it at the edge's rest length e_i, on the line between them; the vertex goes the part s of the way to the mean of
these places:

  x0' = (1 - s) x0 + s (1/n) sum_i [ x_i + e_i (x0 - x_i) / |x0 - x_i| ]

(As printed, the 1/n stands inside with the direction reversed, which is wrong twice; see the project's notes on the method.) `mode: stretched_only` leaves
edges alone that are no longer than at rest: the paper speaks of "the stretched portion" of H; `both` also pushes compressed edges apart.

`stiffness` is s, 0 (putty) to 1. Soft: the deformation stays where the collider is. Stiff: the whole body takes its part. `weights`, one per vertex of H,
0 to 1, multiply s, so that bone and flesh can share a body. Edges of no length ask for nothing. No vertex moves further than `max_step` times the mean edge
of H. Length errors of a millionth are taken for rounding, so that H at rest stays at rest to the bit. Positions are in tet space.

Source: Aldrich, Pinskiy, Hamann, "Collision-Driven Volumetric Deformation on the GPU", 3.3.)";

class EnforceStiffnessNode : public Node {
 public:
  In<Points> points{this, "points", {.unit = "cells", .shape = "vertices of H", .doc = "H as the other steps left it, in tet space"}};
  In<TetMesh> tets{this, "tets", {.doc = "H at rest"}};
  OptionalIn<Weights> weights{this, "weights", {.shape = "vertices of H", .doc = "of the stiffness, 0 to 1; all 1 when left out"}};
  Param<double> stiffness{this, "stiffness", EnforceStiffnessSettings{}.stiffness, {.min = 0, .max = 1, .doc = "s: 0 soft, 1 stiff"}};
  Param<std::string> mode{this, "mode", "both", {.choices = {"both", "stretched_only"}, .doc = "which edges are corrected"}};
  Param<double> max_step{
      this, "max_step", EnforceStiffnessSettings{}.max_step, {.min = 0, .unit = "mean edges of H", .doc = "longest move of a vertex"}};
  Out<Points> result{this, "points", {.unit = "cells", .shape = "vertices of H", .doc = "H with edges nearer to their rest lengths"}};

  Runs runs() const override { return Runs::kAnyDevice; }

  void evaluate(Context& context) const override {
    EnforceStiffnessSettings settings{.stiffness = stiffness(), .stretched_only = mode() == "stretched_only", .max_step = max_step()};
    if (const Weights* painted = context.get(weights)) settings.weights = &painted->values;
    context.set(result, Points{enforce_stiffness(context.executor(), context.get(points).values, context.get(tets), settings)});
  }
};

}  // namespace

KNEAD_REGISTER(enforce_stiffness, EnforceStiffnessNode, 1, kManual)

}  // namespace knead
