#include "kernels/loop/restore_volume.h"

#include <cmath>
#include <numbers>
#include <utility>

#include "kernels/loop/loop_points.h"
#include "kernels/loop/loop_simd.h"
#include "kernels/parallel.h"

namespace knead {

double sweep_relaxation(double relaxation, int sweep, int sweeps) {
  const int node = sweep % 2 == 0 ? sweep / 2 : sweeps - 1 - sweep / 2;
  const double lowest = 1.0 / sweeps, highest = 4;
  const double width = (highest - lowest) / (highest + lowest);
  return relaxation / (1 + width * std::cos(std::numbers::pi * (2 * node + 1) / (2.0 * sweeps)));
}

Buffer<Vec3f> restore_volume(Executor& executor, const Buffer<Vec3f>& points, const TetMesh& tets, const RestoreVolumeSettings& settings) {
  require_size(points.size(), tets.vertices(), "restore_volume", "points", "vertices of the tet mesh");
  RestoreVolume body{};
  body.strips = lane_table(tets.vertex_strips, executor.device());
  body.regularisation = static_cast<float>(settings.regularisation);
  body.ignored = kRestRounding;
  body.max_step = static_cast<float>(settings.max_step) * tets.mean_edge;
  body.relative = settings.relative;
  Buffer<Vec3f> from = padded(executor, points);
  for (int sweep = 0; sweep < settings.sweeps; ++sweep) {
    Buffer<Vec3f> to = start_from(executor, from, tets.vertex_strips.lanes);
    body.from = from.view(executor.device()).data();
    body.to = to.data_for_write();
    body.relaxation = static_cast<float>(sweep_relaxation(settings.relaxation, sweep, settings.sweeps));
    run_lanes(executor, body.strips.lanes, body, loop_simd(executor).restore_volume);
    from = std::move(to);
  }
  return from;
}

}  // namespace knead
