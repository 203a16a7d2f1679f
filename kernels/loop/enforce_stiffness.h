// The stiffness step of the paper's loop (eq. 4, mended as in method.md 3).
//
// Each neighbour i of a vertex wants it at distance e_i, the edge's rest length, on the line between them; the vertex moves the part s of the way to
// the mean of these places:
//     x0' = (1 - s) x0 + s (1/n) sum_i [ x_i + e_i (x0 - x_i) / |x0 - x_i| ]
// With `stretched_only` an edge no longer than at rest asks for nothing (its term is x0). An edge of no length asks for nothing either. All vertices
// move at once from the same positions, each at most max_step times H's mean edge.
#pragma once
#include "graph/executor.h"
#include "kernels/port_types.h"

namespace knead {

struct EnforceStiffnessSettings {
  double stiffness = 0.5;  // s, 0 to 1
  bool stretched_only = false;
  double max_step = 0.5;                   // mean edges of H
  const Buffer<float>* weights = nullptr;  // of s, per vertex of H, 0 to 1
};

// `points`: H in tet space. Returns the moved points. Throws Error(kInput) when the number of points or weights is not H's.
Buffer<Vec3f> enforce_stiffness(Executor& executor, const Buffer<Vec3f>& points, const TetMesh& tets, const EnforceStiffnessSettings& settings);

}  // namespace knead
