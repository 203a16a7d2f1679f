// One contact sample of the equilibrium's energy (method.md 4): kc/2 a min(0, phi - lambda)^2 for every collider, and its gradient. A sample is a point of M that
// rides in H: y = y_rest + cell * sum w u. Each collider is a constraint of its own with its own memory lambda, so that a vertex between two is held by both.
#pragma once
#include <cstddef>
#include <cstdint>

#include "kernels/collide_body.h"
#include "kernels/rows4.h"

namespace knead {

struct ContactSum {
  double energy = 0;
  float deepest = 0;   // penetration, cells
  float change = 0;    // the largest change of a memory that an update would make, cells
  uint32_t active = 0; // constraints that push
};

struct ContactEnergy {
  const Row4* u;               // displacements of H, cells
  const uint32_t* offsets;     // [samples + 1] into indices and weights
  const uint32_t* indices;     // vertices of H
  const float* weights;
  const Vec3f* rest;           // y_rest, M's local units
  const float* area;           // cells^2
  const float* memory;         // [colliders][samples] lambda, cells
  float* distance;             // [colliders][samples] phi - margin, cells; kFar where it cannot matter
  Row4* force;                 // [samples] gradient by the sample's place
  ColliderView colliders[kMostColliders];
  uint32_t count;
  uint32_t samples;
  float to_local;              // cells to M's local units
  float margin;                // cells
  float stiffness;             // kc, per cell

  static constexpr float kFar = 1e30f;

  KNEAD_HD ContactSum operator()(uint32_t s) const {
    Vec3f move{0, 0, 0};
    for (uint32_t e = offsets[s]; e < offsets[s + 1]; ++e) move += weights[e] * to_vec(u[indices[e]]);
    const Vec3f y = rest[s] + to_local * move;
    ContactSum sum;
    Vec3f push{0, 0, 0};
    for (uint32_t k = 0; k < count; ++k) {
      const ColliderView& c = colliders[k];
      const size_t at = static_cast<size_t>(k) * samples + s;
      const float lambda = memory[at], to_cells = c.scale / to_local;
      float phi = kFar;
      SdfSampler sampler(c.sdf);
      const Vec3f p = CollidePush::to_index(c, y);
      Vec3f slope{0, 0, 0};
      if (sampler.reaches(p, (lambda + margin) / to_cells)) phi = sampler.spline(p, slope) * to_cells - margin;
      distance[at] = phi;
      const float next = lambda > phi ? lambda - phi : 0.0f, change = next > lambda ? next - lambda : lambda - next;
      sum.change = change > sum.change ? change : sum.change;
      sum.deepest = -phi > sum.deepest ? -phi : sum.deepest;
      if (next > 0) {  // phi < lambda
        const float pull = stiffness * area[s] * next;
        sum.energy += 0.5 * static_cast<double>(pull) * static_cast<double>(next);
        ++sum.active;
        push -= (pull * c.scale) * CollidePush::from_index(c, slope);
      }
    }
    force[s] = to_row(push);
    return sum;
  }
};

}  // namespace knead
