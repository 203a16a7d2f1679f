#include "kernels/build_tets/build_tets.h"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "graph/opaque_value.h"
#include "graph/registry.h"

namespace knead {
namespace {

// What the frames share: H about M's own space, and what had to be said about it.
struct BuildResult {
  static constexpr const char* kOpaqueName = "BuildResult";
  BuiltTets build;
  std::vector<std::string> warnings;
  double milliseconds = 0;
  void each_buffer(auto&& f) {
    PortTraits<TetMesh>::each_buffer(build.tets, f);
    PortTraits<Lattice>::each_buffer(build.lattice, f);
    f(build.inside);
  }
};

const char* const kManual = R"(The helper tet mesh H that embeds the soft surface M, and the lattice that ties M to it.

An octree over M's box splits a cell while it holds more than `max_vertices` of M and is above `max_depth`, or is touched by M and above `surface_depth`;
leaves that touch differ by one level at most. So H is about as fine as M, and at least 16 cells are to the box along M: flesh of two cells across is
three times as far from finite elements as flesh of four (docs/convergence.md). A `max_depth` beyond M's own fineness changes nothing; where it was
asked for and not reached a warning says so, and `surface_depth` reaches it, for about four times the tets a level. An H much finer than M wants
contact_samples, since between M's vertices nothing holds.

Leaves that M touches or that lie inside M are kept, and filled with tets from their centres to their faces (Labelle and Shewchuk 2007, not cut to
the surface). H therefore sticks out of M: the report gives the volumes of both, and `inside` what part of each tet is flesh: exact for a closed M
that does not run through itself; of an open one it may be off next to a hole. H is valid for any triangle soup: conforming, every tet
positive. Inside is where the winding number is beyond one half either way, so that open, broken and inside-out surfaces work too; what was assumed
is said in a warning.

`split_pieces` gives a cell a copy for each connected piece of material in it, so that fingers or lips closer than a cell come apart (Molino et al.
2004, Nesme et al. 2009); cells that only touch without material in between hold together only round a common edge. Without it, the default, what
shares a cell moves as one: loose shells such as eyebrows and buttons then go with the skin under them, which split ones do not.

`lattice` is how M rides in H: `barycentric` in the tet that holds the vertex, `trilinear` in the cell's corners, `mean_value` in the cell as a
closed cage (Ju et al. 2005). A head of 20,000 vertices bent by a quarter turn and dented by a Gaussian, given at H's vertices, against the exact
shape (max_depth 5):
  barycentric  4.0 entries a vertex, error 0.086 % and 0.73 % of the displacement, normals off by 0.27 and 0.29 degrees (RMS)
  trilinear    8.0                         0.145 %     1.39 %                                     0.29     0.32
  mean_value   8.1                         0.159 %     1.40 %                                     0.36     0.38
Barycentric is the default: it also uses the cells' centres and is continuous everywhere; trilinear tears a little where cells of two sizes meet. In
cells much larger than M's faces (depth 4) barycentric facets show first: dihedral angles off by 1.8 degrees, against 1.4 with trilinear.

A vertex that no face uses follows the nearest cell and does not move the body.

Cells stand along M's principal axes, by the second moments of its area, pointing where the third ones do. So a mesh that was turned before it was
written gets the same H. Where two axes differ by less than 0.1 % or fewer than two have a direction (balls, boxes, plates, capsules, tori), cells
stand along the axes of M's own space.

Tet space: units of the finest cell's edge along those axes, about M's centre; rest positions are whole eighths, exact in float32. H is built once
for a body that only moves, turns and scales as a whole.)";

LatticeKind kind_of(const std::string& name) {
  return name == "barycentric" ? LatticeKind::kBarycentric : name == "trilinear" ? LatticeKind::kTrilinear : LatticeKind::kMeanValue;
}

class BuildTets : public Node {
 public:
  In<Surface> surface{this, "surface", {.unit = "world", .doc = "M at rest"}};
  Param<int> max_depth{this,
                       "max_depth",
                       BuildTetsOptions{}.max_depth,
                       {.min = 1, .max = kDeepestOctree, .doc = "levels of the octree: M's box is at most 2^max_depth cells wide"}};
  Param<int> min_depth{
      this, "min_depth", BuildTetsOptions{}.min_depth, {.min = 0, .max = 8, .doc = "levels everywhere, however few vertices M has there"}};
  Param<int> surface_depth{this,
                           "surface_depth",
                           BuildTetsOptions{}.surface_depth,
                           {.min = 0, .max = kDeepestOctree, .doc = "levels of what M touches, however few vertices M has there; at most max_depth"}};
  Param<int> max_vertices{this, "max_vertices", BuildTetsOptions{}.max_vertices, {.min = 1, .doc = "vertices of M in a cell before it is split"}};
  Param<bool> split_pieces{this, "split_pieces", BuildTetsOptions{}.split_pieces, {.doc = "a copy of a cell for each connected piece of M in it"}};
  Param<std::string> lattice_kind{
      this, "lattice", "barycentric", {.choices = {"barycentric", "trilinear", "mean_value"}, .doc = "coordinates of M in H"}};
  Out<TetMesh> tets{this, "tets", {.unit = "cells", .doc = "H at rest"}};
  Out<Lattice> lattice{this, "lattice", {.doc = "M's vertices in H, both ways"}};
  Out<Points> points{this, "points", {.unit = "cells", .shape = "vertices of H", .doc = "H's rest positions, where the loop starts"}};
  Out<Weights> inside{this, "inside", {.shape = "tets of H", .doc = "the part of each tet that lies inside M, for equilibrium"}};
  Out<Report> report{this, "report", {.doc = "vertices, tets, edges, depth, volumes of H and M (world), pieces split, build time"}};

  void configure() override {
    if (!min_depth.is_set() || min_depth() <= max_depth()) return;
    Where where;
    where.member = "min_depth";
    throw Error(ErrorCode::kGraph, where, "min_depth " + std::to_string(min_depth()) + " is above max_depth " + std::to_string(max_depth()),
                "lower min_depth or raise max_depth");
  }

  void evaluate(Context& context) const override {
    const Surface& body = context.get(surface);
    Hasher key;
    key.add("build_tets")
        .add(body.points.id())
        .add(max_depth())
        .add(min_depth())
        .add(surface_depth())
        .add(max_vertices())
        .add(split_pieces())
        .add(lattice_kind());
    if (body.topology) {
      key.add(body.topology->triangles.size()).bytes(body.topology->triangles.data(), body.topology->triangles.size() * sizeof(uint32_t));
      key.add(body.topology->face_vertices.size()).bytes(body.topology->face_vertices.data(), body.topology->face_vertices.size() * sizeof(uint32_t));
    }
    const Value shared = context.once(key.key(), [&] { return Value::of(build(context, body)); });
    const BuildResult& built = shared.as<BuildResult>();
    for (const std::string& warning : built.warnings) context.warn(warning);
    Lattice placed = built.build.lattice;
    placed.rest = body;  // H is in M's own space; only M's placement changes from frame to frame
    context.set(tets, built.build.tets);
    context.set(lattice, std::move(placed));
    context.set(points, Points{built.build.tets.rest});
    context.set(inside, Weights{built.build.inside});
    context.set(report, figures(built, body.placement.scale));
  }

 private:
  BuildResult build(Context& context, const Surface& body) const {
    const auto start = std::chrono::steady_clock::now();
    const BuildTetsOptions options{.max_depth = max_depth(),
                                   .min_depth = std::min(min_depth(), max_depth()),
                                   .surface_depth = surface_depth(),
                                   .max_vertices = max_vertices(),
                                   .split_pieces = split_pieces(),
                                   .lattice = kind_of(lattice_kind())};
    BuildResult built;
    built.build = build_tets(body, options, context.executor(), built.warnings);
    built.milliseconds = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
    if (max_depth.is_set() && max_depth() > BuildTetsOptions{}.max_depth && built.build.depth < max_depth())
      built.warnings.push_back("H is of depth " + std::to_string(built.build.depth) + ", not of max_depth " + std::to_string(max_depth()) +
                               ", since no cell there has more than max_vertices = " + std::to_string(max_vertices()) +
                               " vertices of the surface: surface_depth splits whatever the surface touches, min_depth every cell");
    return built;
  }

  static Report figures(const BuildResult& built, double scale) {
    const BuiltTets& b = built.build;
    Report report;
    report.set("vertices", static_cast<double>(b.tets.vertices()));
    report.set("tets", static_cast<double>(b.tets.tets.size()));
    report.set("edges", static_cast<double>(b.tets.edges.size()));
    report.set("depth", b.depth);
    report.set("cell_size", b.tets.to_local.scale * scale);
    report.set("tet_volume", b.tet_volume * std::pow(scale, 3));
    report.set("surface_volume", b.surface_volume * std::pow(scale, 3));
    report.set("pieces_split", static_cast<double>(b.pieces_split));
    report.set("build_milliseconds", built.milliseconds);
    return report;
  }
};

}  // namespace

KNEAD_REGISTER(build_tets, BuildTets, 3, kManual)

}  // namespace knead
