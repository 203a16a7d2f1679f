// read_tets: a tet mesh from elsewhere as H.
#include <cmath>

#include "graph/registry.h"
#include "io/files.h"
#include "io/tets/tet_file.h"
#include "kernels/build_tets/bind_tets.h"

namespace knead {

namespace {

const char* const kManual =
    R"(A tet mesh from a file as the helper mesh H, and the lattice that ties the soft surface M to it: in the place of build_tets.

Files are .vtu and .vtk (VTK, unstructured grids), .msh (Gmsh 2.2 and 4.1) and TetGen's .ele with its .node beside it, as text or binary. Coordinates are
those of M's file, in world units. Of curved tets the corners are taken; other cells, and faces and edges, are left out. Fields in the file are not read.

H is checked. Tets that are inside out are turned; tets without volume and vertices that no tet uses are left out; each of that is said in a warning, as are
several pieces and tets that lie over each other. A vertex of M rides in the tet that holds it (barycentric coordinates). H should hold the whole of M:
meshers that keep to a surface only nearly leave some vertices outside, and such a vertex is bound to the nearest place of H. That is said in a warning, and
further out than `tolerance` is an error. A vertex that no face uses follows H and does not move it.

Tet space: units of the mean edge, along the axes of M's own space, about the middle of M's box. build_tets makes H of cells in a grid, which the coarse grids
of the equilibrium fit best: an H from elsewhere takes a few more iterations.)";

class ReadTets : public Node {
 public:
  In<Surface> surface{this, "surface", {.unit = "world", .doc = "M at rest"}};
  Param<std::string> path{this, "path", "", {.doc = "the file, .vtu, .vtk, .msh or .ele"}};
  Param<double> tolerance{this, "tolerance", 0.01, {.min = 0, .unit = "of M's diagonal", .doc = "how far outside H a vertex of M may lie"}};
  Out<TetMesh> tets{this, "tets", {.unit = "cells", .doc = "H at rest"}};
  Out<Lattice> lattice{this, "lattice", {.doc = "M's vertices in H, both ways"}};
  Out<Points> points{this, "points", {.unit = "cells", .shape = "vertices of H", .doc = "H's rest positions, where the loop starts"}};
  Out<Report> report{this, "report", {.doc = "vertices, tets, edges, volume of H (world), vertices of M outside and how far (world)"}};

  void configure() override {
    if (path().empty()) throw Error(ErrorCode::kGraph, Where{{}, 0, 0, {}, "path"}, "no file is named", "set path to a tet mesh");
    check_readable_tet_name(path());
  }
  void add_to_key(Hasher& hasher, int) const override { hasher.add(file_content_key(path())); }

  void evaluate(Context& context) const override {
    const Surface& body = context.get(surface);
    std::vector<std::string> warnings;
    TetFile file = read_tet_file(path(), warnings);
    context.check_cancelled();
    const Similarity to_local = body.placement.inverse();
    for (Vec3d& p : file.points) p = to_local.apply(p);
    BoundTets bound;
    try {
      bound = bind_tets(body, {std::move(file.points), std::move(file.tets)}, tolerance() * body.diagonal(), context.executor(), warnings);
    } catch (const Error& e) {
      throw Error(e.code(), in_file(path()), e.message(), e.hint());
    }
    for (const std::string& warning : warnings) context.warn(path() + ": " + warning);
    context.set(report, figures(bound, body.placement.scale));
    context.set(points, Points{bound.build.tets.rest});
    context.set(lattice, std::move(bound.build.lattice));
    context.set(tets, std::move(bound.build.tets));
  }

 private:
  static Report figures(const BoundTets& bound, double scale) {
    Report report;
    report.set("vertices", static_cast<double>(bound.build.tets.vertices()));
    report.set("tets", static_cast<double>(bound.build.tets.tets.size()));
    report.set("edges", static_cast<double>(bound.build.tets.edges.size()));
    report.set("tet_volume", bound.build.tet_volume * std::pow(scale, 3));
    report.set("vertices_outside", static_cast<double>(bound.outside));
    report.set("furthest_outside", bound.furthest * scale);
    return report;
  }
};

}  // namespace

KNEAD_REGISTER(read_tets, ReadTets, 1, kManual)

}  // namespace knead
