// The steps of a multigrid cycle (kernels/multigrid/multigrid.h), each for one row: gathers only. A matrix has a block of three by three per entry, nine floats, its
// columns one after the other; arrays of blocks can be read four floats beyond their end.
#pragma once
#include <cstdint>

#include "kernels/array_ops_body.h"

namespace knead {

inline constexpr uint32_t kBlock = 9;

KNEAD_HD void clear_blocks(float* from, size_t begin, size_t end) {
  for (size_t i = kBlock * begin; i < kBlock * end; ++i) from[i] = 0;
}
KNEAD_HD void add_block(float* to, const float* block, float by) {
#if defined(__CUDACC__)
  for (uint32_t k = 0; k < kBlock; ++k) to[k] += by * block[k];
#else
  typedef float Unaligned __attribute__((vector_size(16), may_alias, aligned(4)));
  Unaligned *low = reinterpret_cast<Unaligned*>(to), *high = reinterpret_cast<Unaligned*>(to + 4);
  *low = *low + *reinterpret_cast<const Unaligned*>(block) * by;
  *high = *high + *reinterpret_cast<const Unaligned*>(block + 4) * by;
  to[8] += by * block[8];
#endif
}

// The fourth number of the result means nothing.
KNEAD_HD RowValue block_times(const float* block, const RowValue& v) {
#if defined(__CUDACC__)
  return {block[0] * v.x + block[3] * v.y + block[6] * v.z, block[1] * v.x + block[4] * v.y + block[7] * v.z,
          block[2] * v.x + block[5] * v.y + block[8] * v.z, 0};
#else
  typedef float Unaligned __attribute__((vector_size(16), may_alias, aligned(4)));
  const auto column = [&](int k) -> RowValue { return *reinterpret_cast<const Unaligned*>(block + 3 * k); };
  return column(0) * v[0] + column(1) * v[1] + column(2) * v[2];
#endif
}
KNEAD_HD RowValue without_fourth(RowValue v) {
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

  KNEAD_HD RowValue times(const Row4* v, uint32_t p) const {
    RowValue sum = block_times(diagonal + kBlock * static_cast<size_t>(p), row_at(v, p)), other{0, 0, 0, 0};  // two sums: neither waits for the other
    uint32_t e = offsets[p];
    const uint32_t end = offsets[p + 1];
    const float* at = value + kBlock * static_cast<size_t>(e);
    for (; e + 2 <= end; e += 2, at += 2 * kBlock) {
      sum = sum + block_times(at, row_at(v, index[e]));
      other = other + block_times(at + kBlock, row_at(v, index[e + 1]));
    }
    if (e < end) sum = sum + block_times(at, row_at(v, index[e]));
    return without_fourth(sum + other);
  }
  KNEAD_HD RowValue inverted(const RowValue& v, uint32_t p) const {
    return without_fourth(block_times(inverse + kBlock * static_cast<size_t>(p), v));
  }
};

// The first step of a smoother from zero. What is `unused` here and elsewhere are bytes that would else be there by chance, and look like an address of
// the host to tests, which search bodies for them.
struct SmoothStart {
  static constexpr const char* kKernel = "multigrid_start";
  MatrixRows a;
  const Row4* right;
  Row4* x;
  float by;
  uint32_t unused = 0;
  KNEAD_HD void operator()(uint32_t p) const { put_row(x, p, a.inverted(row_at(right, p), p) * by); }
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
    const RowValue residual = row_at(right, p) - a.times(x, p);
    put_row(to, p, row_at(x, p) * keep - row_at(before, p) * again + a.inverted(residual, p) * by);
  }
};

struct Residual {
  static constexpr const char* kKernel = "multigrid_residual";
  MatrixRows a;
  const Row4 *right, *x;
  Row4* residual;
  KNEAD_HD void operator()(uint32_t p) const { put_row(residual, p, row_at(right, p) - a.times(x, p)); }
};

// Between two grids: rows of weights. To a coarser grid the residual, and from there the correction.
struct GridWeights {
  const uint32_t *offsets, *index;
  const float* weight;
  KNEAD_HD RowValue of(const Row4* v, uint32_t p) const {
    RowValue sum{0, 0, 0, 0};
    for (uint32_t e = offsets[p]; e < offsets[p + 1]; ++e) sum = sum + row_at(v, index[e]) * weight[e];
    return sum;
  }
};

struct Restrict {
  static constexpr const char* kKernel = "multigrid_restrict";
  GridWeights down;
  const Row4* fine;
  Row4* coarse;
  KNEAD_HD void operator()(uint32_t p) const { put_row(coarse, p, down.of(fine, p)); }
};

struct Prolong {
  static constexpr const char* kKernel = "multigrid_prolong";
  GridWeights up;
  const Row4* coarse;
  Row4* x;
  KNEAD_HD void operator()(uint32_t p) const { put_row(x, p, row_at(x, p) + up.of(coarse, p)); }
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

// Which rows have anything to do with others that are marked.
struct MarkRows {
  static constexpr const char* kKernel = "multigrid_mark";
  const uint32_t *offsets, *index;
  const uint8_t* from;
  uint8_t* to;
  KNEAD_HD void operator()(uint32_t p) const {
    bool any = false;
    for (uint32_t e = offsets[p]; e < offsets[p + 1]; ++e) any = any || from[index[e]];
    to[p] = any;
  }
};

// Galerkin's coarse matrix P^T A P in two steps, row by row: the product A P, and P^T times that. Where a term goes is in tables: its place in the row.
// `diagonal_only`: of a matrix that has nothing else, and that not in most rows, whose products are left as they are. `only`: the rows that are made; null:
// all.
struct ProductRow {
  static constexpr const char* kKernel = "multigrid_product_row";
  MatrixRows a;
  GridWeights up;
  const uint32_t* terms;    // [rows + 1] into `places`
  const uint16_t* places;   // for the diagonal and then every entry of a row: a place per weight of its column
  const uint32_t* offsets;  // [rows + 1] into the product
  float* product;
  size_t diagonal_only;
  const uint8_t* only;

  static KNEAD_HD bool is_empty(const float* block) { return block[0] == 0 && block[4] == 0 && block[8] == 0; }

  KNEAD_HD void operator()(uint32_t p) const {
    const float* own = a.diagonal + kBlock * static_cast<size_t>(p);
    if ((diagonal_only && is_empty(own)) || (only && !only[p])) return;
    clear_blocks(product, offsets[p], offsets[p + 1]);
    float* row = product + kBlock * static_cast<size_t>(offsets[p]);
    const uint16_t* place = places + terms[p];
    const auto add = [&](const float* block, uint32_t q) {
      for (uint32_t g = up.offsets[q]; g < up.offsets[q + 1]; ++g) add_block(row + kBlock * *place++, block, up.weight[g]);
    };
    add(own, p);
    if (diagonal_only) return;
    for (uint32_t e = a.offsets[p]; e < a.offsets[p + 1]; ++e) add(a.value + kBlock * static_cast<size_t>(e), a.index[e]);
  }
};

struct CoarseRow {
  static constexpr const char* kKernel = "multigrid_coarse_row";
  static constexpr uint16_t kOwn = 0xffff;  // the place of the diagonal
  GridWeights down;
  const uint32_t* offsets;  // into the product
  const float* product;
  const uint32_t* terms;   // [rows + 1] into `places`
  const uint16_t* places;  // for every weight of a row: a place per block of that row of the product
  const uint32_t* coarse;  // [rows + 1] into `value`
  float *value, *diagonal;
  const float* fine_diagonal;  // null: all of it; else what is not empty in it is added to what is there
  const uint8_t* only;

  KNEAD_HD void operator()(uint32_t p) const {
    if (only && !only[p]) return;
    float *own = diagonal + kBlock * static_cast<size_t>(p), *row = value + kBlock * static_cast<size_t>(coarse[p]);
    if (!fine_diagonal) {
      clear_blocks(diagonal, p, p + 1);
      clear_blocks(value, coarse[p], coarse[p + 1]);
    }
    const uint16_t* place = places + terms[p];
    for (uint32_t e = down.offsets[p]; e < down.offsets[p + 1]; ++e) {
      const uint32_t q = down.index[e], count = offsets[q + 1] - offsets[q];
      if (fine_diagonal && ProductRow::is_empty(fine_diagonal + kBlock * static_cast<size_t>(q))) {
        place += count;
        continue;
      }
      const float* block = product + kBlock * static_cast<size_t>(offsets[q]);
      for (uint32_t f = 0; f < count; ++f, ++place, block += kBlock) add_block(*place == kOwn ? own : row + kBlock * *place, block, down.weight[e]);
    }
  }
};

// The coarsest matrix as a dense one, with `shift` of its diagonal added.
struct DenseRows {
  static constexpr const char* kKernel = "multigrid_dense";
  MatrixRows a;
  double shift;
  double* dense;
  size_t n;  // rows of blocks
  KNEAD_HD void operator()(uint32_t p) const {
    const size_t width = 3 * n;
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
  size_t n;             // rows of blocks
  const Row4* x;
  Row4* to;
  KNEAD_HD void operator()(uint32_t p) const {
    const double* column = dense + 9 * n * p;
    double sum[3] = {0, 0, 0};
    for (uint32_t r = 0; r < 3; ++r, column += 3 * n)
      for (size_t q = 0; q < n; ++q) sum[r] += column[3 * q] * x[q].x + column[3 * q + 1] * x[q].y + column[3 * q + 2] * x[q].z;
    to[p] = {static_cast<float>(sum[0]), static_cast<float>(sum[1]), static_cast<float>(sum[2]), 0};
  }
};

}  // namespace knead
