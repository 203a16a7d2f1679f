#include "kernels/restore_volume.h"

#include "kernels/loop_lanes.h"
#include "kernels/loop_points.h"
#include "kernels/parallel.h"

namespace knead {

Buffer<Vec3f> restore_volume(Executor& executor, const Buffer<Vec3f>& points, const TetMesh& tets, const RestoreVolumeSettings& settings) {
  require_host(executor, "restore_volume");
  require_size(points.size(), tets.vertices(), "restore_volume", "points", "vertices of the tet mesh");
  const Buffer<Vec3f> from = padded(executor, points);
  Buffer<Vec3f> to = start_from(executor, from, tets.vertex_tets.lanes);
  RestoreVolume body{};
  body.from = from.view(executor.device()).data();
  body.to = to.data_for_write();
  body.tets = lane_table(tets.vertex_tets, executor.device());
  body.regularisation = static_cast<float>(settings.regularisation);
  body.relaxation = static_cast<float>(settings.relaxation);
  body.ignored = kRestRounding;
  body.max_step = static_cast<float>(settings.max_step) * tets.mean_edge;
  run_lanes(executor, body.tets.lanes, body, loop_lanes(executor).restore_volume);
  return to;
}

}  // namespace knead
