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
  KNEAD_HD uint32_t blocks() const { return (width + row_count + kPanelBlock - 1) / kPanelBlock; }
};

struct FactorView {
  const Panel* panels;
  const uint32_t* rows;
  const float* const* values;  // [panels] their entries
};

template <class F>
struct PanelSolve {
  using L = Lane<F>;
  static constexpr uint32_t kParts = kPanelBlock / L::kWidth;

  static void forward(const FactorView& factor, uint32_t p, Row4* x) {
    const Panel& panel = factor.panels[p];
    const float* b = factor.values[p];
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

  // scratch: [3][height] floats.
  static void backward(const FactorView& factor, uint32_t p, Row4* x, float* scratch) {
    const Panel& panel = factor.panels[p];
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
    const float* b = factor.values[p];
    uint32_t j = 0;
    for (; j + 4 <= panel.width; j += 4) columns<4>(b, panel, scratch, height, j, x);
    for (; j < panel.width; ++j) columns<1>(b, panel, scratch, height, j, x);
  }
};

// A front of the multifrontal factorisation: a dense symmetric matrix, lower half, by columns `ld` apart. Its first `width` columns are eliminated;
// what is left of the others is the front's update. Entries above the diagonal are neither read nor kept.
template <class F>
struct FrontFactor {
  using L = Lane<F>;
  static constexpr uint32_t kColumns = 8;           // of a tile of products
  static constexpr uint32_t kRows = 2 * L::kWidth;  // and its rows
  static constexpr uint32_t kBlock = 16;            // columns eliminated between two updates

  // The distance between the columns of a front: whole tiles, and no power of two, which would make cache lines collide.
  static uint32_t stride(uint32_t height) {
    const uint32_t tiles = (height + 31) / 32;
    return 32 * (tiles + (tiles % 2 == 0));
  }

  static void put(float* to, const F& v) { __builtin_memcpy(to, &v, sizeof v); }

  // to[i + j ld] -= sum_k a[i + k ld] b[k b_step + j] for a tile at i, kCount columns.
  template <uint32_t kCount>
  static void tile(const float* a, uint32_t ld, const float* b, uint32_t b_step, uint32_t terms, float* to) {
    F low[kCount] = {}, high[kCount] = {};
    for (uint32_t k = 0; k < terms; ++k, a += ld, b += b_step) {
      const F a0 = L::load(a), a1 = L::load(a + L::kWidth);
      for (uint32_t j = 0; j < kCount; ++j) {
        low[j] = low[j] + a0 * b[j];
        high[j] = high[j] + a1 * b[j];
      }
    }
    for (uint32_t j = 0; j < kCount; ++j) {
      float* at = to + static_cast<size_t>(j) * ld;
      put(at, L::load(at) - low[j]);
      put(at + L::kWidth, L::load(at + L::kWidth) - high[j]);
    }
  }

  // Columns [begin, end) minus what columns [from, to) say: A_ij -= sum_k L_ik L_jk.
  static void update(float* a, uint32_t ld, uint32_t from, uint32_t to, uint32_t begin, uint32_t end) {
    const float* left = a + static_cast<size_t>(from) * ld;
    for (uint32_t j = begin; j < end;) {
      const uint32_t count = end - j >= kColumns ? kColumns : 1;
      for (uint32_t i = j / kRows * kRows; i < ld; i += kRows) {
        if (count == kColumns)
          tile<kColumns>(left + i, ld, left + j, ld, to - from, a + static_cast<size_t>(j) * ld + i);
        else
          tile<1>(left + i, ld, left + j, ld, to - from, a + static_cast<size_t>(j) * ld + i);
      }
      j += count;
    }
  }

  // False at a pivot that is not positive.
  static bool eliminate(float* a, uint32_t ld, uint32_t width, uint32_t height) {
    for (uint32_t block = 0; block < width; block += kBlock) {
      const uint32_t end = block + kBlock < width ? block + kBlock : width;
      for (uint32_t j = block; j < end; ++j) {
        float* column = a + static_cast<size_t>(j) * ld;
        const uint32_t first = j / L::kWidth * L::kWidth;
        for (uint32_t k = block; k < j; ++k) {
          const float* before = a + static_cast<size_t>(k) * ld;
          const float by = before[j];
          for (uint32_t i = first; i < ld; i += L::kWidth) put(column + i, L::load(column + i) - L::load(before + i) * by);
        }
        const float pivot = column[j];
        if (!(pivot > 0)) return false;
        const float over = 1 / Lane<float>::root(pivot);
        for (uint32_t i = first; i < ld; i += L::kWidth) put(column + i, L::load(column + i) * over);
      }
      update(a, ld, block, end, end, width);
    }
    if (height > width) update(a, ld, 0, width, width, height);
    return true;
  }

  // Columns [begin, end) of an eliminated front, at most kPanelWidth, as a panel's block B.
  static void store_panel(const float* a, uint32_t ld, uint32_t begin, uint32_t end, uint32_t height, float* to) {
    const uint32_t width = end - begin;
    alignas(64) float inverse[kPanelWidth * kPanelWidth] = {};  // T^-1 by rows
    for (uint32_t i = 0; i < width; ++i) {
      float* row = inverse + i * kPanelWidth;
      row[i] = 1;
      for (uint32_t k = 0; k < i; ++k) {
        const float by = a[static_cast<size_t>(begin + k) * ld + begin + i];
        const float* before = inverse + k * kPanelWidth;
        for (uint32_t j = 0; j < kPanelWidth; j += L::kWidth) put(row + j, L::load(row + j) - L::load(before + j) * by);
      }
      const float over = 1 / a[static_cast<size_t>(begin + i) * ld + begin + i];
      for (uint32_t j = 0; j < kPanelWidth; j += L::kWidth) put(row + j, L::load(row + j) * over);
    }
    const uint32_t blocks = (height - begin + kPanelBlock - 1) / kPanelBlock;
    for (uint32_t block = 0; block < blocks; ++block)
      for (uint32_t part = 0; part < kPanelBlock; part += L::kWidth) {
        const uint32_t row = block * kPanelBlock + part;
        float* out = to + static_cast<size_t>(block) * kPanelBlock * width + part;
        for (uint32_t j = 0; j < width; j += kColumns) {
          F sum[kColumns] = {};
          const uint32_t count = width - j < kColumns ? width - j : kColumns;
          if (row >= width) {
            for (uint32_t k = j; k < width; ++k) {
              const F value = L::load(a + static_cast<size_t>(begin + k) * ld + begin + row);
              for (uint32_t c = 0; c < kColumns; ++c) sum[c] = sum[c] + value * inverse[k * kPanelWidth + j + c];
            }
          } else {
            for (uint32_t l = 0; l < L::kWidth; ++l)
              for (uint32_t c = 0; c < count; ++c) set(sum[c], l, entry(a, ld, begin, width, height, inverse, row + l, j + c));
          }
          for (uint32_t c = 0; c < count; ++c) put(out + static_cast<size_t>(j + c) * kPanelBlock, sum[c]);
        }
      }
  }

 private:
  static void set(F& v, uint32_t l, float to) {
    if constexpr (L::kWidth == 1)
      v = to;
    else
      v[l] = to;
  }
  // One entry of B, for blocks that straddle T^-1 and the rows below.
  static float entry(const float* a, uint32_t ld, uint32_t begin, uint32_t width, uint32_t height, const float* inverse, uint32_t row, uint32_t j) {
    if (row < width) return inverse[row * kPanelWidth + j];
    if (begin + row >= height) return 0;
    float sum = 0;
    for (uint32_t k = j; k < width; ++k) sum += a[static_cast<size_t>(begin + k) * ld + begin + row] * inverse[k * kPanelWidth + j];
    return sum;
  }
};

}  // namespace knead
