// The sum of the equilibrium's forces over one vertex of H, and how far two shapes of H are apart there.
#pragma once
#include <cstdint>

#include "kernels/rows4.h"

namespace knead {

// One place of H: the sum of what acts on it.
struct GatherForces {
  const Row4* forces;  // by slot
  const uint32_t *slot_offsets, *slots;
  const Row4* u;
  const float *hold, *free;
  const Row4* pushes;   // by place
  const Row4* contact;  // by vertex of M, in addition; may be null
  const uint32_t *back_offsets, *back_samples;
  const float* back_weights;
  Row4* gradient;

  struct Sum {
    double squares = 0, load = 0, energy = 0;
  };

  Sum operator()(uint32_t p) const {
    Pack<4> sum{};
    for (uint32_t e = slot_offsets[p]; e < slot_offsets[p + 1]; ++e) sum += *reinterpret_cast<const Pack<4>*>(forces + slots[e]);
    const Pack<4> at = *reinterpret_cast<const Pack<4>*>(u + p);
    sum += at * hold[p];
    Pack<4> push = *reinterpret_cast<const Pack<4>*>(pushes + p);
    if (contact)
      for (uint32_t e = back_offsets[p]; e < back_offsets[p + 1]; ++e)
        push += *reinterpret_cast<const Pack<4>*>(contact + back_samples[e]) * back_weights[e];
    sum = (sum + push) * free[p];
    push = push * free[p];
    *reinterpret_cast<Pack<4>*>(gradient + p) = sum;
    const auto squared = [](const Pack<4>& v) { return static_cast<double>(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); };
    return {squared(sum), squared(push), 0.5 * static_cast<double>(hold[p]) * squared(at)};
  }
};

struct SquaredDistance {
  const Row4 *a, *b;
  KNEAD_HD float operator()(uint32_t p) const {
    const Vec3f d = to_vec(a[p]) - to_vec(b[p]);
    return dot(d, d);
  }
};

}  // namespace knead
