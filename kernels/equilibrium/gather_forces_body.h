// The sum of the equilibrium's forces over one vertex of H, and how far two shapes of H are apart there.
#pragma once
#include <cstdint>

#include "kernels/row4.h"

namespace knead {

// The sum of the forces on one vertex of H.
struct GatherForces {
  static constexpr const char* kKernel = "gather_forces";
  const Row4* forces;                                   // [4][stride] by corner of a tet, as ElasticTets leaves them
  const uint32_t *incident_offsets, *incident_corners;  // by vertex: the rows of `forces` that act on it
  const Row4* u;
  const float *hold, *free;
  const uint32_t *ghost_offsets, *ghosts;  // by vertex: rows of ghost_penalty.h; may be null
  const float* ghost_values;
  const Row4* contact_on_h;  // contact forces by vertex of H; may be null
  const Row4* contact;       // contact forces by sample, in addition; may be null
  const uint32_t *transpose_offsets, *transpose_samples;
  const float* transpose_weights;
  Row4* gradient;
  struct Sum {
    double squares = 0;  // of the gradient
    double load = 0;     // squares of the contact forces
    double energy = 0;   // of the hold and the ghost penalty
  };
  Sum* result;

  KNEAD_HD Sum operator()(uint32_t p) const {
    RowValue sum{0, 0, 0, 0};
    for (uint32_t e = incident_offsets[p]; e < incident_offsets[p + 1]; ++e) sum = sum + row_at(forces, incident_corners[e]);
    const RowValue at = row_at(u, p);
    sum = sum + at * hold[p];
    double ghost = 0;
    for (uint32_t e = ghost_offsets ? ghost_offsets[p] : 0; ghost_offsets && e < ghost_offsets[p + 1]; ++e) {
      const RowValue apart = row_at(u, ghosts[e]) - at;
      sum = sum + apart * ghost_values[e];
      ghost -= static_cast<double>(ghost_values[e]) * static_cast<double>(squared(apart));
    }
    RowValue load{0, 0, 0, 0};
    if (contact_on_h) load = row_at(contact_on_h, p);
    if (contact)
      for (uint32_t e = transpose_offsets[p]; e < transpose_offsets[p + 1]; ++e)
        load = load + row_at(contact, transpose_samples[e]) * transpose_weights[e];
    sum = (sum + load) * free[p];
    load = load * free[p];
    put_row(gradient, p, sum);
    return {squared(sum), squared(load), 0.5 * static_cast<double>(hold[p]) * static_cast<double>(squared(at)) + 0.25 * ghost};
  }
  static KNEAD_HD Sum combine(const Sum& a, const Sum& b) { return {a.squares + b.squares, a.load + b.load, a.energy + b.energy}; }
  KNEAD_HD void finish(const Sum& sum) const { *result = sum; }
};

// How far any vertex of H is in one shape from where the vertex is in the other, or a little more.
struct Farthest {
  static constexpr const char* kKernel = "farthest";
  const Row4 *a, *b;  // b null: all zero
  float* result;

  KNEAD_HD float operator()(uint32_t p) const {
    const Vec3f d = b ? to_vec(a[p]) - to_vec(b[p]) : to_vec(a[p]);
    return dot(d, d);
  }
  static KNEAD_HD float combine(float a, float b) { return a < b ? b : a; }
  KNEAD_HD void finish(float squared) const {
    constexpr float kRoundUp = 1.0001f;
    *result = sqrtf(squared) * kRoundUp;
  }
};

}  // namespace knead
