#include "graph/registry.h"
#include "kernels/loop/lattice_map.h"

namespace knead {

namespace {

const char* const kManual = R"(Moves H so that it follows displacements of M: reverse interpolation through the lattice coordinates (paper 3.2, 3.3).

  x_j' = x_j + gain * d_j,   d_j = sum_i w_ij d_i / sum_i w_ij

over the vertices i of M that x_j influences. The displacements d_i are in M's local units, positions of H in tet space. Vertices of H that no vertex of M
depends on, and those without a push, keep their bits. (Dividing by sum w^2 instead would bring a lone vertex all the way, and diverges.)

Where one vertex of M is pushed and its neighbours are not, the mean d_j is smaller than d_i, so that a single step does not take M out of the collider: the
contact memory of collide_sdf makes up for it over the iterations. `gain` above 1 does so faster, and less calmly.

No vertex moves further than `max_step` times the mean edge of H; without `tets` the finest cell stands for the mean edge.)";

class MapToTetsNode : public Node {
 public:
  In<Points> displacement{this, "displacement", {.unit = "local units of M", .shape = "vertices of M", .doc = "where M should go from where it is"}};
  In<Points> points{this, "points", {.unit = "cells", .shape = "vertices of H", .doc = "H now, in tet space"}};
  In<Lattice> lattice{this, "lattice", {.doc = "M in H"}};
  OptionalIn<TetMesh> tets{this, "tets", {.doc = "H at rest, for its mean edge"}};
  Param<double> gain{this, "gain", MapToTetsSettings{}.gain, {.min = 0, .max = 4, .doc = "multiplies the displacements"}};
  Param<double> max_step{this, "max_step", MapToTetsSettings{}.max_step, {.min = 0, .unit = "mean edges of H", .doc = "longest move of a vertex"}};
  Out<Points> result{this, "points", {.unit = "cells", .shape = "vertices of H", .doc = "H, moved"}};

  Runs runs() const override { return Runs::kAnyDevice; }

  void evaluate(Context& context) const override {
    MapToTetsSettings settings{.gain = gain(), .max_step = max_step()};
    if (const TetMesh* mesh = context.get(tets)) settings.mean_edge = mesh->mean_edge;
    context.set(result, Points{map_to_tets(context.executor(), context.get(displacement).values, context.get(points).values, context.get(lattice),
                                           settings)});
  }
};

}  // namespace

KNEAD_REGISTER(map_to_tets, MapToTetsNode, 1, kManual)

}  // namespace knead
