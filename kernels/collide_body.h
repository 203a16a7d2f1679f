// One vertex of the push out of several colliders (method.md 3, Collide, with the contact memory of finding 2).
#pragma once
#include <cstdint>

#include "kernels/sdf_sample.h"
#include "kernels/vec.h"

namespace knead {

inline constexpr uint32_t kMostColliders = 24;  // by value in the body, so that a launch needs no upload
inline constexpr float kLeastSlope = 0.05f;     // a distance has slope 1; below this its direction means nothing

// A collider seen from M: index = matrix * y + offset for a vertex y in M's local space.
struct ColliderView {
  SdfView sdf;
  float matrix[9];
  Vec3f offset;
  float scale;    // M's local units per unit of the grid's values
  Vec3f centre;   // of the collider, M's local space: where to push from when the distance has no slope
};

struct ContactFigures {
  float deepest = 0;    // penetration, M's local units
  uint32_t inside = 0;  // vertices with phi < margin
  uint32_t pushed = 0;  // vertices with a push that is not zero
};

struct CollidePush {
  const Vec3f* points;        // [n] M's local space
  const float* memory;        // [n] lambda, local units; null: none yet
  Vec3f* displacement;        // [n] d_i, M's local space
  float* memory_out;          // [n]
  ColliderView colliders[kMostColliders];
  uint32_t count;
  float margin;               // local units: phi is measured from this far outside the collider
  float rate;                 // how much of phi goes into the memory per iteration
  float most;                 // upper bound of lambda, local units

  static KNEAD_HD Vec3f to_index(const ColliderView& c, const Vec3f& y) {
    return {c.matrix[0] * y.x + c.matrix[1] * y.y + c.matrix[2] * y.z + c.offset.x, c.matrix[3] * y.x + c.matrix[4] * y.y + c.matrix[5] * y.z + c.offset.y,
            c.matrix[6] * y.x + c.matrix[7] * y.y + c.matrix[8] * y.z + c.offset.z};
  }
  // A gradient in index space turned into M's local space.
  static KNEAD_HD Vec3f from_index(const ColliderView& c, const Vec3f& g) {
    return {c.matrix[0] * g.x + c.matrix[3] * g.y + c.matrix[6] * g.z, c.matrix[1] * g.x + c.matrix[4] * g.y + c.matrix[7] * g.z,
            c.matrix[2] * g.x + c.matrix[5] * g.y + c.matrix[8] * g.z};
  }

  // Unit direction out of collider c at y, and zero where there is no slope outside it. On a medial surface inside, away from the collider's centre.
  static KNEAD_HD Vec3f outwards(const ColliderView& c, const Vec3f& y, bool inside) {
    SdfSampler sampler(c.sdf);
    Vec3f g = from_index(c, sampler.smooth_gradient(to_index(c, y)));
    float size = length(g);
    if (!(size * c.scale > kLeastSlope)) {
      if (!inside) return {0, 0, 0};
      g = y - c.centre;
      size = length(g);
      if (!(size > 0)) return {0, 1, 0};
    }
    return g * (1 / size);
  }

  // The distance of y above the margin of the collider that it is deepest in, and which that is.
  KNEAD_HD float distance(const Vec3f& y, uint32_t& nearest) const {
    float phi = 3.4e38f;
    for (uint32_t k = 0; k < count; ++k) {
      SdfSampler sampler(colliders[k].sdf);
      const float value = sampler.value(to_index(colliders[k], y)) * colliders[k].scale - margin;
      if (value < phi) phi = value, nearest = k;
    }
    return phi;
  }

  KNEAD_HD ContactFigures operator()(uint32_t i) const {
    const Vec3f y = points[i];
    uint32_t nearest = 0;
    const float phi = distance(y, nearest);
    const float before = memory ? memory[i] : 0.0f;
    float lambda = before - rate * phi;
    lambda = lambda > 0 ? (lambda < most ? lambda : most) : 0.0f;
    const float push = lambda > -phi ? lambda : -phi;  // never less than the penetration itself
    ContactFigures figures;
    memory_out[i] = lambda;
    displacement[i] = {0, 0, 0};
    if (phi < 0) {
      figures.inside = 1;
      figures.deepest = -phi;
    }
    if (push > 0) {
      const Vec3f d = outwards(colliders[nearest], y, phi < 0) * push;
      displacement[i] = d;
      figures.pushed = d.x != 0 || d.y != 0 || d.z != 0;
    }
    return figures;
  }
};

struct AddDisplacement {
  const Vec3f* points;
  const Vec3f* displacement;
  Vec3f* moved;

  KNEAD_HD void operator()(uint32_t i) const { moved[i] = points[i] + displacement[i]; }
};

}  // namespace knead
