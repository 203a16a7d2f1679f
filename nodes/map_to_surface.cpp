#include "graph/registry.h"
#include "kernels/loop/lattice_map.h"

namespace knead {

namespace {

const char* const kManual = R"(Moves M with H: interpolates the displacements of H's vertices at the vertices of M (paper 3.3).

  y_i = y_rest_i + scale * sum_j w_ij (x_j - x_rest_j)

where scale takes cells (tet space) to M's local units. Displacements are mapped, not positions: where H is at rest, M comes out with its own bits, and an
offset of 1e6 or a size of 1e-4 costs no precision. The surface has the polygons, attributes, box and placement of the mesh that build_tets has bound.)";

class MapToSurfaceNode : public Node {
 public:
  In<Points> points{this, "points", {.unit = "cells", .shape = "vertices of H", .doc = "H now, in tet space"}};
  In<Lattice> lattice{this, "lattice", {.doc = "M in H"}};
  Out<Surface> surface{this, "surface", {.unit = "world", .doc = "M, deformed"}};

  Runs runs() const override { return Runs::kAnyDevice; }

  void evaluate(Context& context) const override {
    const Lattice& bound = context.get(lattice);
    Surface mapped = bound.rest;
    mapped.points = map_to_surface(context.executor(), context.get(points).values, bound);
    context.set(surface, std::move(mapped));
  }
};

}  // namespace

KNEAD_REGISTER(map_to_surface, MapToSurfaceNode, 1, kManual)

}  // namespace knead
