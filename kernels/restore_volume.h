// The volume step of the paper's loop (eq. 1-3, mended as in method.md 3).
//
// For vertex a of a tet, 6 V = (d - a) . Base with Base = (b - d) x (c - d), so moving a by delta changes 6 V by -delta . Base. The step is the regularised
// least-squares solution over the vertex's tets of  Base . delta = 6 V - 6 V0 :
//     (sum Base Base^T + lambda (tr/3) I) delta = sum Base (6 V - 6 V0)
// All vertices move at once from the same positions (Jacobi). Since all four corners of a tet correct the same error, only a part `relaxation` of the step
// is taken; method.md found 1 to diverge. A step is no longer than max_step times H's mean edge.
#pragma once
#include "graph/executor.h"
#include "kernels/data.h"

namespace knead {

struct RestoreVolumeSettings {
  double relaxation = 0.35;
  double regularisation = 1e-3;  // lambda
  double max_step = 0.5;         // mean edges of H
};

// `points`: H in tet space. Returns the moved points. Throws Error(kInput) when their number is not H's.
Buffer<Vec3f> restore_volume(Executor& executor, const Buffer<Vec3f>& points, const TetMesh& tets, const RestoreVolumeSettings& settings);

}  // namespace knead
