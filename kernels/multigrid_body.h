// The steps of a multigrid cycle (kernels/multigrid.h), each for one row: gathers only, three right-hand sides at once.
#pragma once
#include <cstdint>

#include "kernels/rows4.h"

namespace knead {

#if defined(__CUDACC__)
struct alignas(16) Quad {
  float x, y, z, w;
};
KNEAD_HD Quad operator+(const Quad& a, const Quad& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z, a.w + b.w};
}
KNEAD_HD Quad operator-(const Quad& a, const Quad& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z, a.w - b.w};
}
KNEAD_HD Quad operator*(const Quad& a, float by) {
  return {a.x * by, a.y * by, a.z * by, a.w * by};
}
#else
using Quad = Pack<4>;
#endif

KNEAD_HD Quad quad_at(const Row4* v, uint32_t i) {
  return *reinterpret_cast<const Quad*>(v + i);
}
KNEAD_HD void put_quad(Row4* v, uint32_t i, const Quad& q) {
  *reinterpret_cast<Quad*>(v + i) = q;
}

// A symmetric matrix: its diagonal, and by row what lies beside it. `inverse`: what the smoother takes for the diagonal's inverse.
struct MatrixRows {
  const uint32_t *offsets, *index;
  const float *value, *diagonal, *inverse;

  KNEAD_HD Quad times(const Row4* v, uint32_t p) const {
    Quad sum = quad_at(v, p) * diagonal[p], other{0, 0, 0, 0};  // two sums: an addition need not wait for the one before it
    uint32_t e = offsets[p];
    const uint32_t end = offsets[p + 1];
    for (; e + 2 <= end; e += 2) {
      sum = sum + quad_at(v, index[e]) * value[e];
      other = other + quad_at(v, index[e + 1]) * value[e + 1];
    }
    if (e < end) sum = sum + quad_at(v, index[e]) * value[e];
    return sum + other;
  }
};

// The first step of a smoother from zero.
struct SmoothStart {
  const float* inverse;
  float by;
  const Row4* right;
  Row4* x;
  KNEAD_HD void operator()(uint32_t p) const { put_quad(x, p, quad_at(right, p) * (by * inverse[p])); }
};

// x_k+1 = keep x_k - again x_k-1 + by D^-1 (b - A x_k). The result may take the place of x_k-1 or of b.
struct Smooth {
  MatrixRows a;
  float keep, again, by;
  const Row4 *right, *before, *x;
  Row4* to;
  KNEAD_HD void operator()(uint32_t p) const {
    const Quad residual = quad_at(right, p) - a.times(x, p);
    put_quad(to, p, quad_at(x, p) * keep - quad_at(before, p) * again + residual * (by * a.inverse[p]));
  }
};

struct Residual {
  MatrixRows a;
  const Row4 *right, *x;
  Row4* residual;
  KNEAD_HD void operator()(uint32_t p) const { put_quad(residual, p, quad_at(right, p) - a.times(x, p)); }
};

// Between two grids: rows of weights. To a coarser grid the residual, and from there the correction.
struct GridWeights {
  const uint32_t *offsets, *index;
  const float* weight;
  KNEAD_HD Quad of(const Row4* v, uint32_t p) const {
    Quad sum{0, 0, 0, 0};
    for (uint32_t e = offsets[p]; e < offsets[p + 1]; ++e) sum = sum + quad_at(v, index[e]) * weight[e];
    return sum;
  }
};

struct Restrict {
  GridWeights down;
  const Row4* fine;
  Row4* coarse;
  KNEAD_HD void operator()(uint32_t p) const { put_quad(coarse, p, down.of(fine, p)); }
};

struct Prolong {
  GridWeights up;
  const Row4* coarse;
  Row4* x;
  KNEAD_HD void operator()(uint32_t p) const { put_quad(x, p, quad_at(x, p) + up.of(coarse, p)); }
};

}  // namespace knead
