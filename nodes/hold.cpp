#include "kernels/loop/hold.h"

#include "graph/registry.h"

namespace knead {

namespace {

const char* const kManual = R"(Keeps the body in its place: pins, a pull to rest, and removal of the net rigid motion.

Nothing else in the paper's loop holds a body: pressed long enough it is simply moved aside, undeformed. Put `hold` after the other steps on H. In order:

  1. remove_rigid  the rotation and translation that fit H at rest to H now best, each vertex weighted by its volume, are undone. The collider then meets the
                   body as a whole that floats but does not drift. It is left out when any vertex is pinned: the pins hold the frame.
  2. strength      every vertex goes this part of the way back to rest, in every iteration: x += strength * weight * (x_rest - x). Small numbers go far,
                   since the pull is repeated: 0.001 is felt, 0.1 keeps deformation next to the collider. `weights` on M scale it; inside H they count with
                   their mean.
  3. pins          vertices of M with weight 1 come out at rest, to the bit: all vertices of H that they depend on are put back. Between 0 and 1 a pin is a pull.

Positions are in tet space. `lattice` is needed for pins and weights.)";

class HoldNode : public Node {
 public:
  In<Points> points{this, "points", {.unit = "cells", .shape = "vertices of H", .doc = "H as the other steps left it, in tet space"}};
  In<TetMesh> tets{this, "tets", {.doc = "H at rest"}};
  OptionalIn<Lattice> lattice{this, "lattice", {.doc = "M in H; needed with pins or weights"}};
  OptionalIn<Weights> pins{this, "pins", {.shape = "vertices of M", .doc = "0 free, 1 pinned"}};
  OptionalIn<Weights> weights{this, "weights", {.shape = "vertices of M", .doc = "of the strength, 0 to 1; all 1 when left out"}};
  Param<double> strength{this, "strength", HoldSettings{}.strength, {.min = 0, .max = 1, .doc = "part of the way to rest per iteration"}};
  Param<bool> remove_rigid{
      this, "remove_rigid", HoldSettings{}.remove_rigid, {.doc = "undo the net rotation and translation, when nothing is pinned"}};
  Out<Points> result{this, "points", {.unit = "cells", .shape = "vertices of H", .doc = "H, held"}};

  Runs runs() const override { return Runs::kAnyDevice; }

  void evaluate(Context& context) const override {
    HoldSettings settings{.strength = strength(), .remove_rigid = remove_rigid()};
    if (const Weights* painted = context.get(pins)) settings.pins = &painted->values;
    if (const Weights* painted = context.get(weights)) settings.weights = &painted->values;
    context.set(result, Points{hold(context.executor(), context.get(points).values, context.get(tets), context.get(lattice), settings)});
  }
};

}  // namespace

KNEAD_REGISTER(hold, HoldNode, 1, kManual)

}  // namespace knead
