// The steps of a multigrid cycle (kernels/multigrid.h), each for one row: gathers only, three right-hand sides at once.
#pragma once
#include <cstdint>

#include "kernels/rows4.h"

namespace knead {

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

// The first step of a smoother from zero. What is `unused` here and elsewhere are bytes that would else be there by chance, and look like an address of
// the host to tests, which search bodies for them.
struct SmoothStart {
  static constexpr const char* kKernel = "multigrid_start";
  const float* inverse;
  const Row4* right;
  Row4* x;
  float by;
  uint32_t unused = 0;
  KNEAD_HD void operator()(uint32_t p) const { put_quad(x, p, quad_at(right, p) * (by * inverse[p])); }
};

// x_k+1 = keep x_k - again x_k-1 + by D^-1 (b - A x_k). The result may take the place of x_k-1 or of b.
struct Smooth {
  static constexpr const char* kKernel = "multigrid_smooth";
  MatrixRows a;
  const Row4 *right, *before, *x;
  Row4* to;
  float keep, again, by;
  uint32_t unused = 0;
  KNEAD_HD void operator()(uint32_t p) const {
    const Quad residual = quad_at(right, p) - a.times(x, p);
    put_quad(to, p, quad_at(x, p) * keep - quad_at(before, p) * again + residual * (by * a.inverse[p]));
  }
};

struct Residual {
  static constexpr const char* kKernel = "multigrid_residual";
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
  static constexpr const char* kKernel = "multigrid_restrict";
  GridWeights down;
  const Row4* fine;
  Row4* coarse;
  KNEAD_HD void operator()(uint32_t p) const { put_quad(coarse, p, down.of(fine, p)); }
};

struct Prolong {
  static constexpr const char* kKernel = "multigrid_prolong";
  GridWeights up;
  const Row4* coarse;
  Row4* x;
  KNEAD_HD void operator()(uint32_t p) const { put_quad(x, p, quad_at(x, p) + up.of(coarse, p)); }
};

// What the smoother takes for the diagonal's inverse: that of the sum of a row's magnitudes.
struct InverseOfRows {
  static constexpr const char* kKernel = "multigrid_inverse";
  MatrixRows a;
  float* inverse;
  KNEAD_HD void operator()(uint32_t p) const {
    float sum = a.diagonal[p];
    for (uint32_t e = a.offsets[p]; e < a.offsets[p + 1]; ++e) sum += fabsf(a.value[e]);
    inverse[p] = 1 / sum;
  }
};

// One number of a coarse matrix P^T A P, on a device: first those of the diagonal, then those beside it. All columns rise within their rows.
struct GalerkinProduct {
  static constexpr const char* kKernel = "multigrid_product";
  MatrixRows fine;
  GridWeights down;             // P^T
  const uint32_t *row, *index;  // of the coarse numbers beside the diagonal
  float *value, *diagonal;
  uint32_t rows;

  KNEAD_HD double row_times(uint32_t p, uint32_t column) const {
    double sum = 0;
    uint32_t e = fine.offsets[p];
    const uint32_t end = fine.offsets[p + 1];
    for (uint32_t f = down.offsets[column]; f < down.offsets[column + 1]; ++f) {
      const uint32_t q = down.index[f];
      if (q == p) sum += static_cast<double>(fine.diagonal[p]) * down.weight[f];
      while (e < end && fine.index[e] < q) ++e;
      if (e < end && fine.index[e] == q) sum += static_cast<double>(fine.value[e]) * down.weight[f];
    }
    return sum;
  }
  KNEAD_HD void operator()(uint32_t i) const {
    const bool beside = i >= rows;
    const uint32_t a = beside ? row[i - rows] : i, b = beside ? index[i - rows] : i;
    double sum = 0;
    for (uint32_t e = down.offsets[a]; e < down.offsets[a + 1]; ++e) sum += down.weight[e] * row_times(down.index[e], b);
    (beside ? value[i - rows] : diagonal[i]) = static_cast<float>(sum);
  }
};

// The coarsest matrix as a dense one, row by row, with `shift` of its diagonal added.
struct DenseRows {
  static constexpr const char* kKernel = "multigrid_dense";
  MatrixRows a;
  double shift;
  double* dense;
  uint32_t n;
  KNEAD_HD void operator()(uint32_t p) const {
    double* row = dense + static_cast<size_t>(p) * n;
    for (uint32_t q = 0; q < n; ++q) row[q] = 0;
    row[p] = a.diagonal[p] * (1 + shift);
    for (uint32_t e = a.offsets[p]; e < a.offsets[p + 1]; ++e) row[a.index[e]] = a.value[e];
  }
};

// Step k of Gauss and Jordan's inversion of a positive definite matrix, which needs no pivoting; after n of them it is inverted.
struct InvertColumn {
  static constexpr const char* kKernel = "multigrid_invert";
  const double* from;
  double* to;
  uint32_t n, k;
  KNEAD_HD void operator()(uint32_t i) const {
    const uint32_t r = i / n, c = i % n;
    const double pivot = from[static_cast<size_t>(k) * n + k], over = pivot > 0 ? 1 / pivot : 0;
    const double below = from[static_cast<size_t>(r) * n + k], beside = from[static_cast<size_t>(k) * n + c];
    if (r == k)
      to[i] = c == k ? over : over * beside;
    else
      to[i] = c == k ? -over * below : from[i] - over * below * beside;
  }
};

struct DenseTimes {
  static constexpr const char* kKernel = "multigrid_coarsest";
  const double* dense;  // symmetric
  uint32_t n;
  const Row4* x;
  Row4* to;
  KNEAD_HD void operator()(uint32_t p) const {
    Quad sum{0, 0, 0, 0};
    for (uint32_t q = 0; q < n; ++q) sum = sum + quad_at(x, q) * static_cast<float>(dense[static_cast<size_t>(q) * n + p]);
    put_quad(to, p, sum);
  }
};

struct CopyQuads {
  static constexpr const char* kKernel = "copy_quads";
  const Row4* from;
  Row4* to;
  KNEAD_HD void operator()(uint32_t i) const { to[i] = from[i]; }
};

}  // namespace knead
