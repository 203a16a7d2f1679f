// The second derivative of the equilibrium's energy without contacts, kept positive definite: a row of blocks (kernels/multigrid_body.h) per vertex of H.
//
// A tet's part between corners i and j is V0 (mu (n_i . n_j) I + (lambda + mu) (C n_i) (x) (C n_j)), with n the gradients of the shape functions and C the
// cofactors of the deformation gradient. At rest that is linear elasticity but for a term that only a free surface feels; as the body deforms it turns and
// stretches with it, and what of the second derivative may be negative is left out.
#pragma once
#include "kernels/elastic_body.h"
#include "kernels/multigrid_body.h"

namespace knead {

struct HessianRow {
  static constexpr const char* kKernel = "hessian_row";
  static constexpr float kFloating = 1e-5f;  // a floating body without hold stays solvable in float32
  const Row4* u;                             // displacements, cells; null: at rest
  const uint32_t* corners;                   // as ElasticTets has them
  const float *shape, *mu, *lambda;
  size_t stride;
  ElasticTerm term;
  const uint32_t *slot_offsets, *slots;  // by place: which of the tets' corners it is
  const float *hold, *free;
  MatrixRows matrix;  // the pattern
  float *value, *diagonal;

  // The shape functions' gradients at rest.
  KNEAD_HD void gradients(uint32_t t, Vec3f* n) const {
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
  }
  // C n for every corner.
  KNEAD_HD void turned(uint32_t t, const Vec3f* n, Vec3f* to) const {
    Mat3<float> f{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    const Vec3f first = to_vec(u[corners[t]]);
    for (uint32_t c = 1; c < 4; ++c) {
      const Vec3f s = to_vec(u[corners[c * stride + t]]) - first;
      f.x += s.x * n[c];
      f.y += s.y * n[c];
      f.z += s.z * n[c];
    }
    const Mat3<float> m = cofactors(f);
    for (uint32_t c = 0; c < 4; ++c) to[c] = {dot(m.x, n[c]), dot(m.y, n[c]), dot(m.z, n[c])};
  }

  static KNEAD_HD void add(float* block, float same, const Vec3f& left, const Vec3f& right) {
    block[0] += same + left.x * right.x;
    block[1] += left.y * right.x;
    block[2] += left.z * right.x;
    block[3] += left.x * right.y;
    block[4] += same + left.y * right.y;
    block[5] += left.z * right.y;
    block[6] += left.x * right.z;
    block[7] += left.y * right.z;
    block[8] += same + left.z * right.z;
  }

  KNEAD_HD void operator()(uint32_t p) const {
    float* own = diagonal + kBlock * static_cast<size_t>(p);
    for (size_t i = kBlock * static_cast<size_t>(matrix.offsets[p]); i < kBlock * static_cast<size_t>(matrix.offsets[p + 1]); ++i) value[i] = 0;
    for (uint32_t k = 0; k < kBlock; ++k) own[k] = k % 4 != 0 ? 0 : free[p] == 0 ? 1 : hold[p];
    if (free[p] == 0) return;
    for (uint32_t e = slot_offsets[p]; e < slot_offsets[p + 1]; ++e) {
      const uint32_t i = static_cast<uint32_t>(slots[e] / stride), t = static_cast<uint32_t>(slots[e] % stride);
      Vec3f n[4], c[4];
      gradients(t, n);
      if (u)
        turned(t, n, c);
      else
        for (uint32_t k = 0; k < 4; ++k) c[k] = n[k];
      const float m = mu[t], both = lambda[t] + (term == ElasticTerm::kStableNeoHookean ? 0 : m);
      for (uint32_t j = 0; j < 4; ++j) {
        const uint32_t q = corners[j * stride + t];
        if (q == p)
          add(own, m * dot(n[i], n[i]), both * c[i], c[i]);
        else if (free[q] != 0)
          add(value + kBlock * matrix.entry(p, q), m * dot(n[i], n[j]), both * c[i], c[j]);
      }
    }
    for (uint32_t k = 0; k < kBlock; k += 4) own[k] *= 1 + kFloating;
  }
};

}  // namespace knead
