#include "kernels/build_tets/build_tets.h"

#include <algorithm>
#include <cmath>

#include "graph/error.h"
#include "kernels/build_tets/inside_fraction.h"
#include "kernels/build_tets/lattice.h"
#include "kernels/build_tets/tables.h"

namespace knead {
namespace {

void check(const BuildTetsOptions& options) {
  if (options.max_depth < 1 || options.max_depth > kDeepestOctree)
    throw Error(ErrorCode::kInput, "max_depth " + std::to_string(options.max_depth) + " is out of range",
                "take 1 to " + std::to_string(kDeepestOctree));
  if (options.min_depth < 0 || options.min_depth > options.max_depth || options.min_depth > 8)
    throw Error(ErrorCode::kInput, "min_depth " + std::to_string(options.min_depth) + " is out of range", "take 0 to max_depth, at most 8");
  if (options.max_vertices < 1) throw Error(ErrorCode::kInput, "max_vertices must be at least 1");
}

}  // namespace

BuiltTets build_tets(const Surface& surface, const BuildTetsOptions& options, Executor& executor, std::vector<std::string>& warnings) {
  check(options);
  SoftBody body = make_soft_body(surface, executor, warnings);
  Octree octree(body.sorted_keys, options.min_depth, options.max_depth, static_cast<uint32_t>(options.max_vertices));
  refine_along_surface(octree, body, std::min(options.surface_depth, options.max_depth));
  octree.balance();
  const WindingNumber winding(body.points, body.triangles, executor);
  const Cells cells = keep_cells(octree, body, winding, executor);
  const Copies copies = options.split_pieces ? split_cells(octree, cells, body, winding, executor) : whole_cells(octree, cells);
  RawTets raw = make_raw_tets(octree, cells, copies, !options.split_pieces, executor);
  sort_vertices(raw);

  // Tet space begins at the grid place nearest M's centre, so that rest positions are whole eighths: exact in float32, and so are volumes at rest.
  const double side = std::ldexp(1.0, octree.depth());
  std::array<int32_t, 3> origin;
  for (int k = 0; k < 3; ++k) origin[static_cast<size_t>(k)] = kPlaceUnit * static_cast<int32_t>(std::lround(body.centre[k] * side));

  BuiltTets build;
  build.depth = octree.depth();
  build.pieces_split = copies.count() - cells.count();
  build.surface_volume = std::abs(body.volume) * std::pow(body.to_local.scale, 3);
  build.tets = make_tet_mesh(raw, origin, executor);
  build.inside = Buffer<float>(inside_fractions(octree, cells, copies, raw, body, winding, executor));
  Similarity to_root;
  to_root.scale = 1 / side;
  for (int k = 0; k < 3; ++k) to_root.translation[k] = (origin[static_cast<size_t>(k)] / kPlaceUnit) / side;
  build.tets.to_local = body.to_local * to_root;
  double volume = 0;
  for (const float v : build.tets.rest_volumes.host()) volume += double{v};
  build.tet_volume = volume * std::pow(build.tets.to_local.scale, 3);

  for (uint32_t copy = 0; copy < copies.count(); ++copy) {
    const OctreeNode& node = octree.node(cells.nodes[copies.cell[copy]]);
    build.cells.push_back({node.x, node.y, node.z, node.level});
  }
  build.cell_of_vertex = bind_vertices(octree, cells, copies, body, body.points, executor);
  const LatticeRows rows = make_lattice_rows(octree, cells, copies, raw, body.points, build.cell_of_vertex, options.lattice, executor);
  fill_lattice_tables(rows, body.used, static_cast<uint32_t>(raw.places.size()), build.lattice, executor);
  build.lattice.rest = surface;
  build.lattice.tet_rest = build.tets.rest;
  build.lattice.to_local = build.tets.to_local;
  return build;
}

}  // namespace knead
