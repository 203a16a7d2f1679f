// One contact sample of the equilibrium's energy (method.md 4) and its gradient: kc a times the law of contact_law.h for every collider. A sample is a point
// of M that rides in H: y = y_rest + sum w u, all in tet space. Each collider is a constraint of its own with its own multiplier lambda, so that a vertex
// between two colliders is held by both.
#pragma once
#include <cstddef>
#include <cstdint>

#include "kernels/collider_view.h"
#include "kernels/equilibrium/contact_law.h"
#include "kernels/row4.h"

namespace knead {

struct ContactSum {
  double energy = 0;
  float deepest = 0;    // The deepest penetration, cells.
  float change = 0;     // The largest change of a multiplier that an update would make, cells.
  uint32_t active = 0;  // How many contacts have a force.
  float squares = 0;    // Squares of the changes, weighted with the samples' areas, of contacts with a force or a multiplier, cells^4.
  float area = 0;       // The areas of these contacts' samples, cells^2.
};

struct ContactEnergy {
  static constexpr const char* kKernel = "contact_energy";
  static constexpr size_t kGrain = 64;  // A sample in contact costs a look at 27 voxels.
  static constexpr float kFar = 1e30f;
  const Row4* u;            // displacements of H, cells
  const uint32_t* offsets;  // [samples + 1] into indices and weights
  const uint32_t* indices;  // vertices of H
  const float* weights;
  const Vec3f* rest;        // y_rest, cells
  const float* area;        // cells^2
  const float* multiplier;  // [colliders][samples] lambda, cells
  float* distance;          // [colliders][samples] phi - margin, cells; kFar where the distance cannot matter
  // [colliders][samples] how far along `entry` a sample that began inside a collider leaves the collider, cells; negative: the sample did not begin inside.
  // Null once sides are no longer told from the rest shape.
  const float* exits;
  Row4* force;             // [samples] the gradient by the sample's position
  const uint32_t* list;    // the samples that may come in contact; null: all, of which those that may not are left at once
  const float* slack;      // [samples] how far H may move before the sample may come in contact, cells
  const float* travelled;  // how far H has moved at most since the list was made, cells
  ContactSum* result;
  const Vec3f* entry;             // [colliders] unit, the way a collider came in
  const ColliderView* colliders;  // [colliders] those that M can meet (MetColliders)
  uint32_t count;
  uint32_t samples;
  float margin;     // cells
  float stiffness;  // kc, per cell
  ContactLaw law;   // cells
  float friction;   // the largest force of friction over the multiplier; 0: no friction, then `stuck` and `began` are null
  uint32_t known;   // whether `distance` and `normal` are of this u already, so that only multipliers differ
  Row4* normal;  // [colliders][samples] unit, out of the collider, where there is a force; the fourth number is the length of the distance's gradient
  const Row4* stuck;   // [colliders][samples] `normal` when the multiplier was updated
  const float* began;  // [colliders][samples] how far along `entry` from rest the contact began, cells; negative: not known

  // The displacement of sample s.
  KNEAD_HD Vec3f moved(uint32_t s) const {
    Vec3f move{0, 0, 0};
    for (uint32_t e = offsets[s]; e < offsets[s + 1]; ++e) move += weights[e] * to_vec(u[indices[e]]);
    return move;
  }

  // How far H may travel, at least, until a collider's force reaches sample s, cells.
  KNEAD_HD float room(uint32_t s) const {
    const Vec3f y = rest[s] + moved(s);
    float least = kFar, reach = 1;  // A sample outside H may go farther than H travels, by the factor `reach`.
    for (uint32_t e = offsets[s]; e < offsets[s + 1]; ++e) reach += weights[e] < 0 ? -2 * weights[e] : 0.0f;
    for (uint32_t k = 0; k < count; ++k) {
      const size_t at = static_cast<size_t>(k) * samples + s;
      if (multiplier[at] > 0 || (exits && exits[at] >= 0)) return 0;
      SdfSampler sampler(colliders[k].sdf);
      const float room = sampler.least(colliders[k].to_index(y)) * colliders[k].scale - margin - law.gap;
      least = room < least ? room : least;
    }
    return least > 0 ? least / reach : 0.0f;
  }

  // Sample s has no force.
  KNEAD_HD void leave_out(uint32_t s) const {
    force[s] = {0, 0, 0, 0};
    for (uint32_t k = 0; k < count; ++k) distance[static_cast<size_t>(k) * samples + s] = kFar;
  }

  // A collider as a sample sees it.
  struct Sight {
    float phi = kFar;    // distance - margin, cells
    Vec3f out{0, 0, 0};  // the distance's gradient
  };
  KNEAD_HD Sight sight(uint32_t k, size_t at, const Vec3f& move, const Vec3d& y) const {
    if (known) return {distance[at], normal[at].w * to_vec(normal[at])};
    if (exits && exits[at] >= 0) return {dot(entry[k], move) - exits[at], entry[k]};
    const ColliderView& c = colliders[k];
    SdfSampler sampler(c.sdf);
    const Vec3d p = c.to_index(y);
    if (!(multiplier[at] > 0 || sampler.reaches(to_float(p), (law.gap + margin) / c.scale))) return {};
    Vec3f slope;
    const float phi = sampler.spline(p, slope) * c.scale - margin;
    return {phi, c.scale * c.from_index(slope)};
  }

  // One collider's part: adds to the sample's gradient and to the sums.
  KNEAD_HD void add_contact(uint32_t s, uint32_t k, const Vec3f& move, const Vec3d& y, Vec3f& gradient, ContactSum& sum) const {
    const size_t at = static_cast<size_t>(k) * samples + s;
    const float lambda = multiplier[at];
    const Sight seen = sight(k, at, move, y);
    distance[at] = seen.phi;
    const ContactForce next = law.at(lambda - seen.phi);
    const float change = next.force > lambda ? next.force - lambda : lambda - next.force;
    sum.change = change > sum.change ? change : sum.change;
    if (next.force > 0 || lambda > 0) {
      sum.squares += area[s] * change * change;
      sum.area += area[s];
    }
    sum.deepest = -seen.phi > sum.deepest ? -seen.phi : sum.deepest;
    if (next.force > 0) {
      const float size = stiffness * area[s] * next.force;
      sum.energy += static_cast<double>(stiffness * area[s]) * static_cast<double>(next.energy);
      ++sum.active;
      gradient -= size * seen.out;
      if (!known) {
        const float steep = length(seen.out);
        normal[at] = to_row((1 / (steep > 1e-20f ? steep : 1e-20f)) * seen.out);
        normal[at].w = steep;
      }
    }
    if (friction > 0 && lambda > 0 && began[at] >= 0) {
      const FrictionForce held = friction_force(move - began[at] * entry[k], to_vec(stuck[at]), friction * lambda);
      sum.energy += static_cast<double>(stiffness * area[s]) * static_cast<double>(held.energy);
      gradient += (stiffness * area[s]) * held.gradient;
    }
  }

  // The force of sample s on collider k, after an evaluation.
  KNEAD_HD Vec3f force_on(uint32_t k, uint32_t s) const {
    const size_t at = static_cast<size_t>(k) * samples + s;
    const float lambda = multiplier[at], pressed = law.at(lambda - distance[at]).force;
    Vec3f sum{0, 0, 0};
    if (pressed > 0) sum -= (pressed * normal[at].w) * to_vec(normal[at]);
    if (friction > 0 && lambda > 0 && began[at] >= 0)
      sum += friction_force(moved(s) - began[at] * entry[k], to_vec(stuck[at]), friction * lambda).gradient;
    return (stiffness * area[s]) * sum;
  }

  KNEAD_HD ContactSum operator()(uint32_t i) const {
    const uint32_t s = list ? list[i] : i;
    ContactSum sum;
    if (slack[s] > *travelled) {
      leave_out(s);
      return sum;
    }
    const Vec3f move = moved(s);
    const Vec3d y = to_double(rest[s]) + to_double(move);
    Vec3f gradient{0, 0, 0};
    for (uint32_t k = 0; k < count; ++k) add_contact(s, k, move, y, gradient, sum);
    force[s] = to_row(gradient);
    return sum;
  }
  static KNEAD_HD ContactSum combine(const ContactSum& a, const ContactSum& b) {
    return {a.energy + b.energy,
            a.deepest < b.deepest ? b.deepest : a.deepest,
            a.change < b.change ? b.change : a.change,
            a.active + b.active,
            a.squares + b.squares,
            a.area + b.area};
  }
  KNEAD_HD void finish(const ContactSum& sum) const { *result = sum; }

  // Adds sample s's part of the second derivative by its own position, times `by`, to a block: contacts along the colliders' normals, and what friction
  // holds.
  KNEAD_HD void add_block(uint32_t s, float by, float* block) const {
    for (uint32_t k = 0; k < count; ++k) {
      const size_t at = static_cast<size_t>(k) * samples + s;
      const float slope = law.at(multiplier[at] - distance[at]).slope;
      if (!(slope > 0)) continue;
      const float size = by * stiffness * area[s] * slope;
      const float n[3] = {normal[at].x, normal[at].y, normal[at].z};
      for (uint32_t c = 0; c < 3; ++c)
        for (uint32_t r = 0; r < 3; ++r) block[3 * c + r] += size * (friction > 0 ? (r == c ? 1.0f : 0.0f) : n[r] * n[c]);
    }
  }
};

// The sum of the forces on one collider, of shear modulus times cells^2.
struct ForceOnCollider {
  static constexpr const char* kKernel = "force_on_collider";
  ContactEnergy contact;
  Vec3d* result;
  uint32_t collider, unused = 0;
  KNEAD_HD Vec3d operator()(uint32_t s) const { return to_double(contact.force_on(collider, s)); }
  static KNEAD_HD Vec3d combine(const Vec3d& a, const Vec3d& b) { return a + b; }
  KNEAD_HD void finish(const Vec3d& sum) const { *result = sum; }
};

}  // namespace knead
