// The second derivative of the equilibrium's energy without contacts, kept positive definite: a row of blocks (kernels/multigrid/multigrid_body.h) per vertex of H.
//
// A tet's part between corners i and j is V0 (mu (n_i . n_j) I + (lambda + mu) (C n_i) (x) (C n_j)), with n the gradients of the shape functions and C the
// cofactors of the deformation gradient. At rest that is linear elasticity but for a term that only a free surface feels; as the body deforms it turns and
// stretches with it, and what of the second derivative may be negative is left out.
#pragma once
#include "kernels/equilibrium/elastic_body.h"
#include "kernels/multigrid/multigrid_body.h"

namespace knead {

// The two vectors of each corner of a tet: sqrt(V0 mu) n and sqrt(V0 (lambda + mu)) C n. Where `to` has those of another shape already, tets that are nearly
// as they were then are left as they are: as a body settles, fewer and fewer are not.
struct TetGradients {
  static constexpr const char* kKernel = "tet_gradients";
  static constexpr uint32_t kFloats = 24;
  const Row4* u;                             // displacements, cells; null: at rest
  const uint32_t* corners;                   // as ElasticTets has them
  const float *shape, *mu, *lambda, *guard;  // the last one may be null
  size_t stride;
  float* to;         // [tets][kFloats]
  uint8_t* changed;  // [tets] which were written; null: all are
  ElasticTerm term;
  float tolerance;  // by how much of the largest of C n any other may differ in a tet that is left

  KNEAD_HD void operator()(uint32_t t) const {
    Vec3f n[4];
    const float* d = shape + t;
    for (uint32_t c = 0; c < 3; ++c, d += 3 * stride) n[c + 1] = {d[0], d[stride], d[2 * stride]};
    if (term == ElasticTerm::kEdges) {
      const Vec3f a = n[1], b = n[2], c = n[3];
      const float over = 1 / dot(a, cross(b, c));
      n[1] = over * cross(b, c);
      n[2] = over * cross(c, a);
      n[3] = over * cross(a, b);
    }
    n[0] = -(n[1] + n[2] + n[3]);
    Mat3<float> f{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    if (u) {
      const Vec3f first = to_vec(u[corners[t]]);
      for (uint32_t c = 1; c < 4; ++c) {
        const Vec3f s = to_vec(u[corners[c * stride + t]]) - first;
        f.x += s.x * n[c];
        f.y += s.y * n[c];
        f.z += s.z * n[c];
      }
    }
    const Mat3<float> m = cofactors(f);
    const bool flat = guard && dot(f.x, m.x) < ElasticTets::kGuarded;
    const float both = sqrtf(lambda[t] + (term == ElasticTerm::kStableNeoHookean ? 0 : mu[t]) + (flat ? guard[t] : 0)), shear = sqrtf(mu[t]);
    float* out = to + kFloats * static_cast<size_t>(t);
    float turned[12], largest = 0, difference = 0;
    for (uint32_t c = 0; c < 4; ++c) {
      turned[3 * c] = both * dot(m.x, n[c]);
      turned[3 * c + 1] = both * dot(m.y, n[c]);
      turned[3 * c + 2] = both * dot(m.z, n[c]);
      if (!changed) continue;
      for (uint32_t k = 0; k < 3; ++k) {
        const float before = out[6 * c + 3 + k], size = fabsf(before), off = fabsf(turned[3 * c + k] - before);
        largest = largest < size ? size : largest;
        difference = difference < off ? off : difference;
      }
    }
    if (changed) {
      changed[t] = difference > tolerance * largest;
      if (!changed[t]) return;
    }
    for (uint32_t c = 0; c < 4; ++c, out += 6)
      for (uint32_t k = 0; k < 3; ++k) {
        out[k] = shear * n[c][static_cast<int>(k)];
        out[3 + k] = turned[3 * c + k];
      }
  }
};

struct HessianRow {
  static constexpr const char* kKernel = "hessian_row";
  static constexpr float kFloating = 1e-5f;                 // a floating body without hold stays solvable in float32
  static constexpr uint16_t kOwn = 0xffff, kNone = 0xfffe;  // of `entries`: the diagonal block, and a block that is left out
  const float* gradients;                                   // of TetGradients
  size_t stride;
  const uint32_t *incident_offsets, *incident_corners;  // by vertex: which of the tets' corners the vertex is
  const uint16_t* entries;                              // [incident_corners][4] where in the row the block with the tet's corner is
  const float *hold, *free;
  const uint32_t* ghost_offsets;  // rows of ghost_penalty.h; null: none
  const float* ghost_values;
  const uint16_t* ghost_entries;  // [ghosts] where in the row each goes
  const uint32_t* offsets;        // of the rows
  float *value, *diagonal;
  const uint8_t* changed_tets;  // null: all; rows without such a tet are left as they are
  uint8_t* changed;             // [rows] which were not; null with the other

  KNEAD_HD void operator()(uint32_t p) const {
    if (changed_tets) {
      bool any = false;
      for (uint32_t e = incident_offsets[p]; e < incident_offsets[p + 1]; ++e) any = any || changed_tets[incident_corners[e] % stride];
      changed[p] = any;
      if (!any) return;
    }
    float *own = diagonal + kBlock * static_cast<size_t>(p), *row = value + kBlock * static_cast<size_t>(offsets[p]);
    clear_blocks(value, offsets[p], offsets[p + 1]);
    for (uint32_t k = 0; k < kBlock; ++k) own[k] = k % 4 != 0 ? 0 : free[p] == 0 ? 1 : hold[p];
    if (free[p] == 0) return;
    for (uint32_t e = incident_offsets[p]; e < incident_offsets[p + 1]; ++e) {
      const float* tet = gradients + TetGradients::kFloats * (incident_corners[e] % stride);
      const float* i = tet + 6 * (incident_corners[e] / stride);
      for (uint32_t c = 0; c < 4; ++c) {
        const uint16_t entry = entries[4 * static_cast<size_t>(e) + c];
        if (entry == kNone) continue;
        const float* j = tet + 6 * c;
        float* to = entry == kOwn ? own : row + kBlock * entry;
        const float same = i[0] * j[0] + i[1] * j[1] + i[2] * j[2];
        for (uint32_t k = 0; k < 3; ++k)
          for (uint32_t r = 0; r < 3; ++r) to[3 * k + r] += i[3 + r] * j[3 + k] + (r == k ? same : 0.0f);
      }
    }
    for (uint32_t e = ghost_offsets ? ghost_offsets[p] : 0; ghost_offsets && e < ghost_offsets[p + 1]; ++e)
      for (uint32_t k = 0; k < kBlock; k += 4) {
        own[k] -= ghost_values[e];
        if (ghost_entries[e] != kNone) row[kBlock * ghost_entries[e] + k] += ghost_values[e];
      }
    for (uint32_t k = 0; k < kBlock; k += 4) own[k] *= 1 + kFloating;
  }
};

}  // namespace knead
