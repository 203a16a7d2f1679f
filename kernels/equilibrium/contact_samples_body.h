// What is done with the contact samples between evaluations of their energy, each step for one sample or one vertex of H.
#pragma once
#include "kernels/equilibrium/contact_body.h"
#include "kernels/multigrid/multigrid_body.h"

namespace knead {

// How far H may travel before a sample is in contact. For a sample far from all colliders that is known from the last time.
struct ContactRoom {
  static constexpr const char* kKernel = "contact_list";
  ContactEnergy contact;
  float* slack;
  float skin;
  float travelled;  // since the last time, at most; negative: colliders have moved since
  KNEAD_HD void operator()(uint32_t s) const {
    const float left = slack[s] - travelled;
    slack[s] = travelled >= 0 && left >= skin ? left : contact.room(s);
    if (!(slack[s] < skin)) contact.leave_out(s);
  }
};

// The multiplier becomes the force, after ContactEnergy. The multiplier stays zero where the field is flat, beyond its band: there a force has no direction,
// and a multiplier would take long to fade. Friction then draws back to where the collider is now.
struct UpdateMultiplier {
  static constexpr const char* kKernel = "contact_multiplier";
  ContactEnergy contact;
  float *multiplier, *slack;
  Row4* stuck;  // null: no friction
  KNEAD_HD void operator()(uint32_t i) const {
    const uint32_t s = contact.list ? contact.list[i] : i;
    for (uint32_t k = 0; k < contact.count; ++k) {
      const size_t at = static_cast<size_t>(k) * contact.samples + s;
      const float force = contact.law.at(multiplier[at] - contact.distance[at]).force;
      multiplier[at] = force > 0 && contact.normal[at].w > 0 ? force : 0.0f;
      if (multiplier[at] > 0) slack[s] = 0;
      if (stuck) stuck[at] = contact.normal[at];
    }
  }
};

// What the samples with a force add to the diagonal of a metric, lumped: a block by permuted vertex of H.
struct ContactBlocks {
  static constexpr const char* kKernel = "contact_blocks";
  ContactEnergy contact;
  const uint32_t *transpose_offsets, *transpose_samples;  // by permuted vertex
  const float *transpose_weights, *free;
  float* blocks;
  KNEAD_HD void operator()(uint32_t p) const {
    float* block = blocks + kBlock * static_cast<size_t>(p);
    for (uint32_t k = 0; k < kBlock; ++k) block[k] = 0;
    if (free[p] == 0) return;
    for (uint32_t e = transpose_offsets[p]; e < transpose_offsets[p + 1]; ++e) contact.add_block(transpose_samples[e], transpose_weights[e], block);
  }
};

// How far along the way in a sample must go from rest to be out of a collider again: the collider that the sample began inside, or that the sample meets
// within `reach`. A sphere as wide as the distance is free of walls, so steps are as long as the distance.
struct ContactExit {
  static constexpr const char* kKernel = "contact_exit";
  static constexpr int kMostSteps = 400;
  static constexpr float kLeastStep = 0.02f;  // of a voxel
  ContactEnergy contact;
  uint32_t collider;
  Vec3f entry;   // unit, the way in
  float reach;   // cells
  float* exits;  // [samples] of this collider

  KNEAD_HD void operator()(uint32_t s) const {
    const ColliderView& c = contact.colliders[collider];
    const float to_cells = c.scale, least = kLeastStep * c.sdf.voxel * to_cells;
    SdfSampler sampler(c.sdf);
    Vec3f y = contact.rest[s];
    bool inside = false;
    float gone = 0;
    for (int step = 0; step < kMostSteps; ++step) {
      const float phi = sampler.value(c.to_index(y)) * to_cells - contact.margin;
      if (phi >= 0 && (inside || gone >= reach)) break;
      inside = inside || phi < 0;
      const float size = phi < 0 ? -phi : phi, along = size > least ? size : least;
      gone += along;
      y += along * entry;
    }
    exits[s] = inside ? gone : -1.0f;
  }
};

}  // namespace knead
