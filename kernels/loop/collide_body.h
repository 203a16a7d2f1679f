// One vertex of the push out of several colliders (method.md 3, Collide, with the contact memory of finding 2).
#pragma once
#include <cstdint>

#include "kernels/collider_view.h"
#include "kernels/pack.h"
#include "kernels/port_types.h"
#include "kernels/vec.h"

namespace knead {

inline constexpr float kLeastSlope = 0.05f;  // a distance has slope 1; below this its direction means nothing

struct ContactFigures {
  float deepest = 0;    // penetration, M's local units
  uint32_t inside = 0;  // vertices with phi < margin
  uint32_t pushed = 0;  // vertices with a push that is not zero
};

struct PushCollider {
  ColliderView view;
  Vec3f lower, upper;  // box around it, M's local space: outside it is farther away than the margin
  uint32_t number;     // among all colliders
};

struct CollidePush {
  static constexpr const char* kKernel = "collide_push";
  static constexpr uint32_t kFew = 24;  // so many colliders travel with the body, so that a launch needs no upload
  static constexpr uint32_t kNone = ~0u;
  const Vec3f* points;            // [n] M's local space
  const float* memory;            // [n] lambda, local units; null: none yet
  Vec3f* displacement;            // [n] d_i, M's local space
  float* memory_out;              // [n]
  const Vec3f* stand_back;        // [count] where each collider began, away from its place, M's local space; null: in its place
  const ContactProgress* before;  // of the push before this; null: this is the first
  ContactProgress* after;
  double diagonal;  // of M at rest, local units
  PushCollider few[kFew];
  const PushCollider* many;  // [count] where there are more; null: `few`
  uint32_t count;
  float left_out;  // the least distance of colliders that M's box is clear of, above the margin, local units; they are not among the others
  float margin;    // local units: phi is measured from this far outside the collider
  float rate;      // how much of phi goes into the memory per iteration
  float most;      // upper bound of lambda, local units

  // Unit direction out of collider c at y, and zero where there is no slope outside it. On a medial surface inside, away from the collider's centre.
  static KNEAD_HD Vec3f outwards(const ColliderView& c, const Vec3f& y, bool inside) {
    SdfSampler sampler(c.sdf);
    Vec3f g = c.from_index(sampler.smooth_gradient(c.to_index(y)));
    float size = length(g);
    if (!(size * c.scale > kLeastSlope)) {
      if (!inside) return {0, 0, 0};
      g = y - c.centre;
      size = length(g);
      if (!(size > 0)) return {0, 1, 0};
    }
    return g * (1 / size);
  }

  KNEAD_HD const PushCollider& collider(uint32_t k) const { return many ? many[k] : few[k]; }

  // The part of the colliders' way in that is left in this push.
  KNEAD_HD float way_left() const {
    return stand_back && before && before->step + 1 < before->steps ? 1 - static_cast<float>(before->step + 1) / static_cast<float>(before->steps)
                                                                    : 0.0f;
  }
  // y as a collider sees it while it stands back.
  KNEAD_HD Vec3f seen_by(const PushCollider& c, const Vec3f& y, float left) const { return left > 0 ? y - stand_back[c.number] * left : y; }

  // True only where no collider is as near as its margin, whatever its distance: most of most bodies. False for NaN.
  KNEAD_HD bool is_far(const Vec3f& y, float left) const {
    for (uint32_t k = 0; k < count; ++k) {
      const PushCollider& c = collider(k);
      if (!outside(seen_by(c, y, left), c.lower, c.upper)) return false;
    }
    return true;
  }
  static KNEAD_HD bool outside(const Vec3f& y, const Vec3f& l, const Vec3f& u) {
#if defined(__SSE2__) && !defined(__CUDACC__)  // most of what a push does: three comparisons at once
    const auto row = [](const Vec3f& v) {
      return _mm_movelh_ps(_mm_loadl_pi(_mm_setzero_ps(), reinterpret_cast<const __m64*>(&v.x)), _mm_load_ss(&v.z));
    };
    const __m128 at = row(y);
    return _mm_movemask_ps(_mm_or_ps(_mm_cmplt_ps(at, row(l)), _mm_cmpgt_ps(at, row(u)))) != 0;
#else
    return y.x < l.x || y.y < l.y || y.z < l.z || y.x > u.x || y.y > u.y || y.z > u.z;
#endif
  }

  // The distance of y above the margin of the collider that it is deepest in, and which that is; kNone: one whose box y is outside of, which has no slope there.
  // Of several that are as near, the first whose box holds y.
  KNEAD_HD float distance(const Vec3f& y, uint32_t& nearest, float left = 0) const {
    float phi = left_out;
    nearest = kNone;
    for (uint32_t k = 0; k < count; ++k) {
      const PushCollider& c = collider(k);
      const Vec3f at = seen_by(c, y, left);
      SdfSampler sampler(c.view.sdf);
      const float value = sampler.value(c.view.to_index(at)) * c.view.scale - margin;
      const bool holds = !outside(at, c.lower, c.upper);
      if (value < phi || (value == phi && nearest == kNone && holds)) phi = value, nearest = holds ? k : kNone;
    }
    return phi;
  }

  KNEAD_HD ContactFigures operator()(uint32_t i) const {
    const Vec3f y = points[i];
    const float left = way_left(), kept = memory ? memory[i] : 0.0f;
    if (!(kept > 0) && is_far(y, left)) {  // without a memory no more than the sign of phi counts
      memory_out[i] = 0;
      displacement[i] = {0, 0, 0};
      return {};
    }
    uint32_t nearest = kNone;
    const float phi = distance(y, nearest, left);
    float lambda = kept - rate * phi;
    lambda = lambda > 0 ? (lambda < most ? lambda : most) : 0.0f;
    const float push = lambda > -phi ? lambda : -phi;  // never less than the penetration itself
    ContactFigures figures;
    memory_out[i] = lambda;
    displacement[i] = {0, 0, 0};
    if (phi < 0) {
      figures.inside = 1;
      figures.deepest = -phi;
    }
    if (push > 0 && nearest != kNone) {
      const PushCollider& c = collider(nearest);
      const Vec3f d = outwards(c.view, seen_by(c, y, left), phi < 0) * push;
      displacement[i] = d;
      figures.pushed = d.x != 0 || d.y != 0 || d.z != 0;
    }
    return figures;
  }
  static KNEAD_HD ContactFigures combine(const ContactFigures& a, const ContactFigures& b) {
    return {a.deepest < b.deepest ? b.deepest : a.deepest, a.inside + b.inside, a.pushed + b.pushed};
  }
  KNEAD_HD void finish(const ContactFigures& figures) const {
    ContactProgress now;
    double away = figures.deepest;
    const float left = way_left();
    if (left > 0)  // the loop must not end on the way
      for (uint32_t k = 0; k < count; ++k) {
        const double stands = static_cast<double>(length(stand_back[collider(k).number]) * left);
        away = stands > away ? stands : away;
      }
    now.unrest = diagonal > 0 ? away / diagonal : 0.0;
    now.deepest = figures.deepest;
    now.inside = figures.inside;
    now.pushed = figures.pushed;
    now.steps = before ? before->steps : 0;
    now.step = before && before->step < before->steps ? before->step + 1 : now.steps;
    *after = now;
  }
};

struct AddDisplacement {
  static constexpr const char* kKernel = "add_displacement";
  const Vec3f* points;
  const Vec3f* displacement;
  Vec3f* moved;

  KNEAD_HD void operator()(uint32_t i) const { moved[i] = points[i] + displacement[i]; }
};

}  // namespace knead
