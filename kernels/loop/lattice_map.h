// Between M and H through the lattice coordinates W (paper 3.2 and 3.3).
#pragma once
#include "graph/executor.h"
#include "kernels/port_types.h"

namespace knead {

struct MapToTetsSettings {
  double gain = 1;
  double max_step = 0.5;  // mean edges of H
  double mean_edge = 1;   // of H, cells
};

// Reverse interpolation: x_j + gain * d_j with d_j = sum_i w_ij d_i / sum_i w_ij over the vertices of M that x_j influences; d in M's local space,
// turned and scaled into tet space, x in tet space. A step is no longer than max_step mean edges. Vertices of H without influence, or without a push,
// keep their bits.
Buffer<Vec3f> map_to_tets(Executor& executor, const Buffer<Vec3f>& displacement, const Buffer<Vec3f>& points, const Lattice& lattice,
                          const MapToTetsSettings& settings);

// y = y_rest + scale * rotation * sum_j w_ij (x_j - x_rest_j), local space of M. Vertices whose part of H is at rest come out with the bits of
// y_rest.
Buffer<Vec3f> map_to_surface(Executor& executor, const Buffer<Vec3f>& points, const Lattice& lattice);

}  // namespace knead
