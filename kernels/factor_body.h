// Triangular solves with a sparse Cholesky factor in panels (kernels/sparse_cholesky.h), three right-hand sides at once.
//
// A panel is `width` consecutive columns of L with everything below them: the triangle T at the diagonal and the rows S below. What is stored is
// B = [T^-1; S T^-1], so that both directions are products with one dense block and no step waits for the one before it:
//   forward   [z; s] = B x,   x <- z,  x_rows <- x_rows - s
//   backward  x <- B^T [x; -x_rows]
// B lies in blocks of kPanelBlock rows, the columns of a block one after the other, so that either solve reads it from end to end.
#pragma once
#include <cstddef>
#include <cstdint>

#include "kernels/rows4.h"

namespace knead {

inline constexpr uint32_t kPanelBlock = 16;
inline constexpr uint32_t kPanelWidth = 64;  // at most

struct Panel {
  uint32_t first = 0, width = 0;  // columns
  uint32_t rows = 0;              // first of its rows below, in FactorView::rows
  uint32_t row_count = 0;
  size_t values = 0;              // first of its entries, in FactorView::values
  KNEAD_HD uint32_t blocks() const { return (width + row_count + kPanelBlock - 1) / kPanelBlock; }
};

struct FactorView {
  const Panel* panels;
  const uint32_t* rows;
  const float* values;
};

template <class F>
struct PanelSolve {
  using L = Lane<F>;
  static constexpr uint32_t kParts = kPanelBlock / L::kWidth;

  // x: rows of the vector; scratch: [3][height] floats.
  static void forward(const FactorView& factor, const Panel& panel, Row4* x, float* scratch) {
    const float* b = factor.values + panel.values;
    Row4 in[kPanelWidth];
    for (uint32_t j = 0; j < panel.width; ++j) in[j] = x[panel.first + j];
    const uint32_t* rows = factor.rows + panel.rows;
    const uint32_t height = panel.width + panel.row_count;
    for (uint32_t block = 0; block < panel.blocks(); ++block) {
      Vec3<F> sum[kParts] = {};
      for (uint32_t j = 0; j < panel.width; ++j, b += kPanelBlock)
        for (uint32_t k = 0; k < kParts; ++k) {
          const F value = L::load(b + k * L::kWidth);
          sum[k].x = sum[k].x + value * in[j].x;
          sum[k].y = sum[k].y + value * in[j].y;
          sum[k].z = sum[k].z + value * in[j].z;
        }
      Row4 out[kPanelBlock];
      for (uint32_t k = 0; k < kParts; ++k) Rows4<F>::store(out + k * L::kWidth, sum[k]);
      const uint32_t begin = block * kPanelBlock, end = begin + kPanelBlock < height ? begin + kPanelBlock : height;
      for (uint32_t i = begin; i < end; ++i) {
        const Row4& s = out[i - begin];
        if (i < panel.width) {
          x[panel.first + i] = s;
          continue;
        }
        Row4& to = x[rows[i - panel.width]];
        to = {to.x - s.x, to.y - s.y, to.z - s.z, 0};
      }
    }
    (void)scratch;
  }

  static KNEAD_HD float total(const F& v) {
    if constexpr (L::kWidth == 1) {
      return v;
    } else {
      float sum = 0;
      for (uint32_t l = 0; l < L::kWidth; ++l) sum += v[l];
      return sum;
    }
  }

  template <uint32_t kColumns>
  static void columns(const float* b, const Panel& panel, const float* scratch, uint32_t height, uint32_t j, Row4* x) {
    Vec3<F> sum[kColumns] = {};
    for (uint32_t i = 0; i < height; i += L::kWidth) {
      const Vec3<F> in{L::load(scratch + i), L::load(scratch + height + i), L::load(scratch + 2 * height + i)};
      const float* at = b + (i / kPanelBlock) * kPanelBlock * panel.width + i % kPanelBlock + j * kPanelBlock;
      for (uint32_t c = 0; c < kColumns; ++c) {
        const F value = L::load(at + c * kPanelBlock);
        sum[c].x = sum[c].x + value * in.x;
        sum[c].y = sum[c].y + value * in.y;
        sum[c].z = sum[c].z + value * in.z;
      }
    }
    for (uint32_t c = 0; c < kColumns; ++c) x[panel.first + j + c] = {total(sum[c].x), total(sum[c].y), total(sum[c].z), 0};
  }

  static void backward(const FactorView& factor, const Panel& panel, Row4* x, float* scratch) {
    const uint32_t* rows = factor.rows + panel.rows;
    const uint32_t height = panel.blocks() * kPanelBlock;
    const auto put = [&](uint32_t i, float px, float py, float pz) {
      scratch[i] = px;
      scratch[height + i] = py;
      scratch[2 * height + i] = pz;
    };
    for (uint32_t i = 0; i < panel.width; ++i) put(i, x[panel.first + i].x, x[panel.first + i].y, x[panel.first + i].z);
    for (uint32_t i = 0; i < panel.row_count; ++i) {
      const Row4& below = x[rows[i]];
      put(panel.width + i, -below.x, -below.y, -below.z);
    }
    for (uint32_t i = panel.width + panel.row_count; i < height; ++i) put(i, 0, 0, 0);
    const float* b = factor.values + panel.values;
    uint32_t j = 0;
    for (; j + 4 <= panel.width; j += 4) columns<4>(b, panel, scratch, height, j, x);
    for (; j < panel.width; ++j) columns<1>(b, panel, scratch, height, j, x);
  }
};

}  // namespace knead
