#include "kernels/loop/lattice_map.h"

#include "kernels/loop/loop_points.h"
#include "kernels/loop/loop_simd.h"
#include "kernels/parallel.h"

namespace knead {
namespace {

Linear3 linear_part(const Similarity& similarity, double gain) {
  Linear3 linear{};
  for (size_t k = 0; k < 9; ++k) linear.rows[k] = static_cast<float>(gain * similarity.scale * similarity.rotation[k]);
  return linear;
}

}  // namespace

Buffer<Vec3f> map_to_tets(Executor& executor, const Buffer<Vec3f>& displacement, const Buffer<Vec3f>& points, const Lattice& lattice,
                          const MapToTetsSettings& settings) {
  require_size(displacement.size(), lattice.rest.vertices(), "map_to_tets", "displacements", "vertices of the surface that the lattice binds");
  require_size(points.size(), lattice.tet_rest.size(), "map_to_tets", "points", "vertices of the tet mesh");
  const Buffer<Vec3f> push = padded(executor, displacement), from = padded(executor, points);
  Buffer<Vec3f> to = start_from(executor, from, lattice.gather.lanes);
  MapToTets body{};
  body.displacement = push.view(executor.device()).data();
  body.from = from.view(executor.device()).data();
  body.to = to.data_for_write();
  body.gather = lane_table(lattice.gather, executor.device());
  body.to_cells = linear_part(lattice.to_local.inverse(), settings.gain);
  body.max_step = static_cast<float>(settings.max_step * settings.mean_edge);
  run_lanes(executor, body.gather.lanes, body, loop_simd(executor).map_to_tets);
  return to;
}

Buffer<Vec3f> map_to_surface(Executor& executor, const Buffer<Vec3f>& points, const Lattice& lattice) {
  require_size(points.size(), lattice.tet_rest.size(), "map_to_surface", "points", "vertices of the tet mesh");
  const Buffer<Vec3f> now = padded(executor, points), tets_rest = padded(executor, lattice.tet_rest), rest = padded(executor, lattice.rest.points);
  Buffer<Vec3f> to = start_from(executor, rest, lattice.map.lanes);
  MapToSurface body{};
  body.tets_now = now.view(executor.device()).data();
  body.tets_rest = tets_rest.view(executor.device()).data();
  body.rest = rest.view(executor.device()).data();
  body.to = to.data_for_write();
  body.map = lane_table(lattice.map, executor.device());
  body.to_local = linear_part(lattice.to_local, 1);
  run_lanes(executor, body.map.lanes, body, loop_simd(executor).map_to_surface);
  return to;
}

}  // namespace knead
