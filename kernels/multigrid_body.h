// The steps of a multigrid cycle (kernels/multigrid.h), each for one row: gathers only. A matrix has a block of three by three per entry, nine floats, its
// columns one after the other; arrays of blocks can be read four floats beyond their end.
#pragma once
#include <cstdint>

#include "kernels/rows4.h"

namespace knead {

inline constexpr uint32_t kBlock = 9;

// The fourth number of the result means nothing.
KNEAD_HD Quad block_times(const float* block, const Quad& v) {
#if defined(__CUDACC__)
  return {block[0] * v.x + block[3] * v.y + block[6] * v.z, block[1] * v.x + block[4] * v.y + block[7] * v.z,
          block[2] * v.x + block[5] * v.y + block[8] * v.z, 0};
#else
  typedef float Unaligned __attribute__((vector_size(16), may_alias, aligned(4)));
  const auto column = [&](int k) -> Quad { return *reinterpret_cast<const Unaligned*>(block + 3 * k); };
  return column(0) * v[0] + column(1) * v[1] + column(2) * v[2];
#endif
}
KNEAD_HD Quad without_fourth(Quad v) {
#if defined(__CUDACC__)
  v.w = 0;
#else
  v[3] = 0;
#endif
  return v;
}

// A symmetric matrix: its diagonal, and by row what lies beside it, columns rising. `inverse`: of the diagonal, block by block.
struct MatrixRows {
  const uint32_t *offsets, *index;
  const float *value, *diagonal, *inverse;

  KNEAD_HD Quad times(const Row4* v, uint32_t p) const {
    Quad sum = block_times(diagonal + kBlock * static_cast<size_t>(p), quad_at(v, p)), other{0, 0, 0, 0};  // two sums: neither waits for the other
    uint32_t e = offsets[p];
    const uint32_t end = offsets[p + 1];
    const float* at = value + kBlock * static_cast<size_t>(e);
    for (; e + 2 <= end; e += 2, at += 2 * kBlock) {
      sum = sum + block_times(at, quad_at(v, index[e]));
      other = other + block_times(at + kBlock, quad_at(v, index[e + 1]));
    }
    if (e < end) sum = sum + block_times(at, quad_at(v, index[e]));
    return without_fourth(sum + other);
  }
  KNEAD_HD Quad inverted(const Quad& v, uint32_t p) const { return without_fourth(block_times(inverse + kBlock * static_cast<size_t>(p), v)); }
  // Where the entry of row p and column q is, which must be there.
  KNEAD_HD size_t entry(uint32_t p, uint32_t q) const {
    uint32_t low = offsets[p], high = offsets[p + 1];
    while (low + 1 < high) {
      const uint32_t middle = (low + high) / 2;
      if (index[middle] <= q)
        low = middle;
      else
        high = middle;
    }
    return low;
  }
};

// The first step of a smoother from zero.
struct SmoothStart {
  static constexpr const char* kKernel = "multigrid_start";
  MatrixRows a;
  float by;
  const Row4* right;
  Row4* x;
  KNEAD_HD void operator()(uint32_t p) const { put_quad(x, p, a.inverted(quad_at(right, p), p) * by); }
};

// x_k+1 = keep x_k - again x_k-1 + by D^-1 (b - A x_k). The result may take the place of x_k-1 or of b.
struct Smooth {
  static constexpr const char* kKernel = "multigrid_smooth";
  MatrixRows a;
  float keep, again, by;
  const Row4 *right, *before, *x;
  Row4* to;
  KNEAD_HD void operator()(uint32_t p) const {
    const Quad residual = quad_at(right, p) - a.times(x, p);
    put_quad(to, p, quad_at(x, p) * keep - quad_at(before, p) * again + a.inverted(residual, p) * by);
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

// The inverse of a symmetric block.
struct InverseOfDiagonal {
  static constexpr const char* kKernel = "multigrid_inverse";
  const float* diagonal;
  float* inverse;
  KNEAD_HD void operator()(uint32_t p) const {
    const float* m = diagonal + kBlock * static_cast<size_t>(p);
    float* to = inverse + kBlock * static_cast<size_t>(p);
    const Vec3f x{m[0], m[1], m[2]}, y{m[3], m[4], m[5]}, z{m[6], m[7], m[8]};
    const Vec3f yz = cross(y, z), zx = cross(z, x), xy = cross(x, y);
    const float size = dot(x, yz), over = size > 0 ? 1 / size : 0;
    const Vec3f rows[3] = {over * yz, over * zx, over * xy};
    for (uint32_t r = 0; r < 3; ++r) {
      to[r] = rows[r].x;
      to[3 + r] = rows[r].y;
      to[6 + r] = rows[r].z;
    }
  }
};

// A row of Galerkin's coarse matrix P^T A P. `adds`: P^T D P with the fine `diagonal` alone, most of which is zero, added to what is there.
struct CoarseRow {
  static constexpr const char* kKernel = "multigrid_coarse_row";
  MatrixRows fine;
  GridWeights down, up;
  MatrixRows coarse;  // the pattern
  float *value, *diagonal;
  bool adds;

  KNEAD_HD void add(const float* block, uint32_t q, float weight, uint32_t row) const {
    for (uint32_t g = up.offsets[q]; g < up.offsets[q + 1]; ++g) {
      const uint32_t c = up.index[g];
      const float by = weight * up.weight[g];
      float* to = c == row ? diagonal + kBlock * static_cast<size_t>(row) : value + kBlock * coarse.entry(row, c);
      for (uint32_t k = 0; k < kBlock; ++k) to[k] += by * block[k];
    }
  }
  KNEAD_HD void operator()(uint32_t row) const {
    if (!adds) {
      for (uint32_t k = 0; k < kBlock; ++k) diagonal[kBlock * static_cast<size_t>(row) + k] = 0;
      for (size_t i = kBlock * static_cast<size_t>(coarse.offsets[row]); i < kBlock * static_cast<size_t>(coarse.offsets[row + 1]); ++i) value[i] = 0;
    }
    for (uint32_t e = down.offsets[row]; e < down.offsets[row + 1]; ++e) {
      const uint32_t p = down.index[e];
      const float* own = fine.diagonal + kBlock * static_cast<size_t>(p);
      if (!adds || own[0] != 0 || own[4] != 0 || own[8] != 0) add(own, p, down.weight[e], row);
      if (adds) continue;
      for (uint32_t f = fine.offsets[p]; f < fine.offsets[p + 1]; ++f) add(fine.value + kBlock * static_cast<size_t>(f), fine.index[f], down.weight[e], row);
    }
  }
};

struct AddFloats {
  static constexpr const char* kKernel = "add_floats";
  const float *a, *b;  // b may be null
  float* to;
  KNEAD_HD void operator()(uint32_t i) const { to[i] = b ? a[i] + b[i] : a[i]; }
};

// The coarsest matrix as a dense one, with `shift` of its diagonal added.
struct DenseRows {
  static constexpr const char* kKernel = "multigrid_dense";
  MatrixRows a;
  double shift;
  double* dense;
  uint32_t n;  // rows of blocks
  KNEAD_HD void operator()(uint32_t p) const {
    const size_t width = 3 * static_cast<size_t>(n);
    for (uint32_t r = 0; r < 3; ++r) {
      double* row = dense + (3 * p + r) * width;
      for (size_t q = 0; q < width; ++q) row[q] = 0;
      for (uint32_t c = 0; c < 3; ++c) row[3 * p + c] = a.diagonal[kBlock * static_cast<size_t>(p) + 3 * c + r] * (r == c ? 1 + shift : 1);
      for (uint32_t e = a.offsets[p]; e < a.offsets[p + 1]; ++e)
        for (uint32_t c = 0; c < 3; ++c) row[3 * a.index[e] + c] = a.value[kBlock * static_cast<size_t>(e) + 3 * c + r];
    }
  }
};

// Step k of Gauss and Jordan's inversion of a positive definite matrix, which needs no pivoting; after n of them it is inverted.
struct InvertColumn {
  static constexpr const char* kKernel = "multigrid_invert";
  const double* from;
  double* to;
  uint32_t n, k;
  KNEAD_HD void operator()(uint32_t r) const {
    const double pivot = from[static_cast<size_t>(k) * n + k], over = pivot > 0 ? 1 / pivot : 0;
    const double* beside = from + static_cast<size_t>(k) * n;
    const double* row = from + static_cast<size_t>(r) * n;
    double* out = to + static_cast<size_t>(r) * n;
    const double below = r == k ? 0 : over * row[k];
    for (uint32_t c = 0; c < n; ++c) out[c] = r == k ? over * beside[c] : row[c] - below * beside[c];
    out[k] = r == k ? over : -below;
  }
};

struct DenseTimes {
  static constexpr const char* kKernel = "multigrid_coarsest";
  const double* dense;  // symmetric
  uint32_t n;           // rows of blocks
  const Row4* x;
  Row4* to;
  KNEAD_HD void operator()(uint32_t p) const {
    const double* column = dense + 9 * static_cast<size_t>(n) * p;
    double sum[3] = {0, 0, 0};
    for (uint32_t r = 0; r < 3; ++r, column += 3 * static_cast<size_t>(n))
      for (uint32_t q = 0; q < n; ++q) sum[r] += column[3 * q] * x[q].x + column[3 * q + 1] * x[q].y + column[3 * q + 2] * x[q].z;
    to[p] = {static_cast<float>(sum[0]), static_cast<float>(sum[1]), static_cast<float>(sum[2]), 0};
  }
};

struct CopyQuads {
  static constexpr const char* kKernel = "copy_quads";
  const Row4* from;
  Row4* to;
  KNEAD_HD void operator()(uint32_t i) const { to[i] = from[i]; }
};

}  // namespace knead
