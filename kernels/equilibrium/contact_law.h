// The law of one contact of the equilibrium's energy: the force of a contact and of friction, each with its energy. They know nothing of colliders or of H.
#pragma once
#include "kernels/vec.h"

namespace knead {

// The force of a contact over kc a (contact stiffness times area): a length. With its integral over t and its slope.
struct ContactForce {
  float force = 0;   // p
  float energy = 0;  // integral of p dt
  float slope = 0;   // dp / dt
};

// An augmented Lagrangian with a multiplier lambda (a length; phi is the distance): p is a function of t = lambda - phi, and p becomes the next lambda. A
// contact at rest has p = lambda and obeys
//   sqrt(p / (gentle gap)) + sqrt(phi / gap) = 1   while phi > 0,
// so that the force grows from nothing as the gap closes, and what a vertex does as it meets a collider is smooth in time. At phi = 0 any force holds. With
// straight = gentle gap, r as in rise = 1 + t / gap = 2 r + (gentle - 1) r^2:
//   p = 0                 for t <= -gap
//   p = straight r^2      in between
//   p = t                 for t >= straight
// For gap = 0 that is p = max(0, t), lambda >= 0, phi >= 0.
struct ContactLaw {
  float gap;     // Where a contact begins, cells; 0: at touch.
  float gentle;  // The force that closes the gap of a contact at rest, over the gap.

  KNEAD_HD ContactForce at(float t) const {
    if (!(t > -gap)) return {};
    const float straight = gentle * gap;
    if (t >= straight) return {t, 0.5f * t * t + gap * straight / 6, 1};
    const float rise = 1 + t / gap, r = rise / (1 + sqrtf(fmaxf(0.0f, 1 + (gentle - 1) * rise)));
    return {straight * r * r, gap * straight * r * r * r * (0.5f * r * (gentle - 1) + 2.0f / 3), gentle * r / (gentle * r + 1 - r)};
  }
};

// The force of friction over kc a.
struct FrictionForce {
  Vec3f gradient{0, 0, 0};  // of the energy by `away`
  float energy = 0;
};

// Friction draws a sample back to where its contact began, along the collider's surface: a spring as stiff as the contact up to its bound (Coulomb's, with
// the multiplier and the normal n of the multiplier's last update). With slid = away - (away . n) n and s = |slid|:
//   energy = s^2 / 2                    while s <= bound
//   energy = bound s - bound^2 / 2      beyond
// The trap: n is held, so that the gradient is that of a plane, whatever the collider's curvature.
KNEAD_HD FrictionForce friction_force(const Vec3f& away, const Vec3f& n, float bound) {
  const Vec3f slid = away - dot(away, n) * n;
  const float size = length(slid);
  if (size <= bound) return {slid, 0.5f * size * size};
  return {(bound / size) * slid, bound * size - 0.5f * bound * bound};
}

}  // namespace knead
