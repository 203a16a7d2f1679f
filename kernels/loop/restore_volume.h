// The volume step of the paper's loop (eq. 1-3, mended as in method.md 3).
//
// For vertex a of a tet, 6 V = (d - a) . Base with Base = (b - d) x (c - d), so moving a by delta changes 6 V by -delta . Base. The step is the
// regularised least-squares solution over the vertex's tets of  Base . delta = 6 V - 6 V0 :
//     (sum w Base Base^T + lambda (tr/3) I) delta = sum w Base (6 V - 6 V0)
// with w = 1 / V0, so that a tet counts by its relative error; w = 1 is the paper's system, in which the large tets of a graded H drown the small
// ones.
//
// All vertices move at once from the same positions (Jacobi). The four corners of a tet then correct the same error together: the iteration's
// eigenvalues lie between 0 and 4, so a part `relaxation` below 1/2 of the step settles, and 1 diverges. With k sweeps the parts follow Chebyshev's
// polynomial for the interval from 1/k to 4, which together reach much further than k equal ones. A step is no longer than max_step times H's mean
// edge.
#pragma once
#include "graph/executor.h"
#include "kernels/port_types.h"

namespace knead {

struct RestoreVolumeSettings {
  double relaxation = 0.4;       // mean part of the step that is taken, 0 to 1
  double regularisation = 0.03;  // lambda
  double max_step = 0.5;         // mean edges of H
  bool relative = true;          // w = 1 / V0
  int sweeps = 2;
};

// The part of the step that each of `sweeps` takes: 1 / (mean + half-width * Chebyshev node), scaled so that a single sweep takes `relaxation`;
// cautious and bold ones alternate.
double sweep_relaxation(double relaxation, int sweep, int sweeps);

// `points`: H in tet space. Returns the moved points. Throws Error(kInput) when their number is not H's.
Buffer<Vec3f> restore_volume(Executor& executor, const Buffer<Vec3f>& points, const TetMesh& tets, const RestoreVolumeSettings& settings);

}  // namespace knead
