// The sum of the equilibrium's forces over one vertex of H, and how far two shapes of H are apart there.
#pragma once
#include <cstdint>

#include "kernels/row4.h"

namespace knead {

// One place of H: the sum of what acts on it.
struct GatherForces {
  static constexpr const char* kKernel = "gather_forces";
  const Row4* forces;  // by slot
  const uint32_t *slot_offsets, *slots;
  const Row4* u;
  const float *hold, *free;
  const Row4* pushes;   // by place; may be null
  const Row4* contact;  // by sample, in addition; may be null
  const uint32_t *back_offsets, *back_samples;
  const float* back_weights;
  Row4* gradient;
  struct Sum {
    double squares = 0, load = 0, energy = 0;
  };
  Sum* result;

  KNEAD_HD Sum operator()(uint32_t p) const {
    Quad sum{0, 0, 0, 0};
    for (uint32_t e = slot_offsets[p]; e < slot_offsets[p + 1]; ++e) sum = sum + quad_at(forces, slots[e]);
    const Quad at = quad_at(u, p);
    sum = sum + at * hold[p];
    Quad push{0, 0, 0, 0};
    if (pushes) push = quad_at(pushes, p);
    if (contact)
      for (uint32_t e = back_offsets[p]; e < back_offsets[p + 1]; ++e) push = push + quad_at(contact, back_samples[e]) * back_weights[e];
    sum = (sum + push) * free[p];
    push = push * free[p];
    put_quad(gradient, p, sum);
    return {squared(sum), squared(push), 0.5 * static_cast<double>(hold[p]) * static_cast<double>(squared(at))};
  }
  static KNEAD_HD Sum combine(const Sum& a, const Sum& b) { return {a.squares + b.squares, a.load + b.load, a.energy + b.energy}; }
  KNEAD_HD void finish(const Sum& sum) const { *result = sum; }
};

// The farthest that any place is in one shape from where it is in the other, or a little more.
struct Farthest {
  static constexpr const char* kKernel = "farthest";
  const Row4 *a, *b;
  float* result;

  KNEAD_HD float operator()(uint32_t p) const {
    const Vec3f d = to_vec(a[p]) - to_vec(b[p]);
    return dot(d, d);
  }
  static KNEAD_HD float combine(float a, float b) { return a < b ? b : a; }
  KNEAD_HD void finish(float squared) const {
    constexpr float kRoundUp = 1.0001f;
    *result = sqrtf(squared) * kRoundUp;
  }
};

}  // namespace knead
