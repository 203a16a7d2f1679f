#include "kernels/loop/enforce_stiffness.h"

#include "kernels/loop/loop_points.h"
#include "kernels/loop/loop_simd.h"
#include "kernels/parallel.h"

namespace knead {

Buffer<Vec3f> enforce_stiffness(Executor& executor, const Buffer<Vec3f>& points, const TetMesh& tets, const EnforceStiffnessSettings& settings) {
  require_size(points.size(), tets.vertices(), "enforce_stiffness", "points", "vertices of the tet mesh");
  if (settings.weights) require_size(settings.weights->size(), tets.vertices(), "enforce_stiffness", "weights", "vertices of the tet mesh");
  const Buffer<Vec3f> from = padded(executor, points);
  Buffer<Vec3f> to = start_from(executor, from, tets.vertex_edges.lanes);
  EnforceStiffness body{};
  body.from = from.view(executor.device()).data();
  body.to = to.data_for_write();
  body.edges = lane_table(tets.vertex_edges, executor.device());
  body.weights = settings.weights ? settings.weights->view(executor.device()).data() : nullptr;
  body.stiffness = static_cast<float>(settings.stiffness);
  body.ignored = kRestRounding;
  body.max_step = static_cast<float>(settings.max_step) * tets.mean_edge;
  body.stretched_only = settings.stretched_only;
  run_lanes(executor, body.edges.lanes, body, loop_simd(executor).enforce_stiffness);
  return to;
}

}  // namespace knead
