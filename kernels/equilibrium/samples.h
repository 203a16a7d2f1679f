// The points of M that an equilibrium keeps outside the colliders: M's vertices, and points inside triangles and on edges that are cut finer.
#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "kernels/device_tables.h"
#include "kernels/port_types.h"

namespace knead {

// Samples as combinations of H's vertices, M's vertices first; and the transpose.
struct SampleTable {
  uint32_t vertices = 0;
  int steps = 1;                           // into which every triangle's sides are cut, at least
  double longest_side = 0;                 // of M's triangles at rest, cells
  std::vector<uint32_t> offsets, indices;  // by sample
  std::vector<float> weights;
  std::vector<Vec3f> rest;                                     // tet space
  std::vector<float> area;                                     // cells^2
  std::vector<Vec3f> outward;                                  // area vectors at rest, out of the body, cells^2
  std::vector<uint32_t> triangles;                             // of samples: M's, cut as it was asked for
  std::vector<uint32_t> transpose_offsets, transpose_samples;  // by permuted vertex of H; of M's vertices, on a device of all samples
  std::vector<float> transpose_weights;
  size_t size() const { return area.size(); }
};

// What kernels read of a table, in the memory of the executor that they run on.
struct SamplesThere {
  const uint32_t *offsets, *indices, *transpose_offsets, *transpose_samples;
  const float *weights, *area, *transpose_weights;
  const Vec3f* rest;
};
SamplesThere put_samples(Executor& executor, const SampleTable& samples, DeviceTables& tables);

inline constexpr int kMostSteps = 16;  // into which a triangle's sides are cut

// Samples of the surface that `lattice` binds, over permuted vertices of H (`permuted`: the permuted number of each vertex), with every triangle's sides cut
// into `steps`; below 2: M's vertices only. `gathers`: the transpose holds all samples, not only M's vertices.
SampleTable make_samples(const Lattice& lattice, const std::vector<uint32_t>& permuted, int steps, bool gathers);

// The same with the sides of triangle t of M cut into steps[t], from 1 to kMostSteps. `triangles`: of M. `h_vertices`: how many H has.
SampleTable refined_samples(const SampleTable& samples, std::span<const uint32_t> triangles, std::span<const uint8_t> steps, size_t h_vertices,
                            bool gathers);

}  // namespace knead
