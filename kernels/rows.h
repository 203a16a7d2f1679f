// Vectors of the equilibrium solver: a row of four floats per vertex of H, zero to begin with, in the executor's memory, and what L-BFGS does with them
// on the host (on a device: kernels/history_body.h).
#pragma once
#include <algorithm>
#include <array>

#include "graph/buffer.h"
#include "graph/executor.h"
#include "kernels/energy_lanes.h"
#include "kernels/parallel.h"
#include "kernels/rows4.h"

namespace knead {

// Storage in the executor's memory, of which every word is `word`.
template <class T>
Buffer<T> filled(Executor& executor, size_t n, uint32_t word = 0) {
  Buffer<T> made(n, executor.memory());
  parallel_for(executor, made.bytes() / sizeof word, "fill_words", FillWords{reinterpret_cast<uint32_t*>(made.data_for_write()), word}, size_t{1} << 16);
  return made;
}

class Rows {
 public:
  Rows(Executor& executor, size_t n) : buffer_(filled<Row4>(executor, n)) {}
  Row4* data() { return buffer_.data_for_write(); }
  float* floats() { return &data()->x; }

 private:
  Buffer<Row4> buffer_;
};

// EnergyLanes' operations on vectors of n floats, on all threads; sums over fixed pieces.
class RowMath {
 public:
  RowMath(Executor& executor, const EnergyLanes& lanes) : executor_(executor), lanes_(lanes) {}

  double dot(const float* a, const float* b, size_t n) const {
    std::array<double, kMostPieces> parts;
    const size_t grain = std::max(kPiece, (n / kMostPieces + 1 + 15) / 16 * 16);
    executor_.parallel_ranges(n, grain, [&](size_t begin, size_t end) { parts[begin / grain] = lanes_.dot(a + begin, b + begin, end - begin); });
    double sum = 0;
    for (size_t piece = 0; piece * grain < n; ++piece) sum += parts[piece];
    return sum;
  }
  void add_scaled(float* to, const float* from, float by, size_t n) const {
    executor_.parallel_ranges(n, kPiece, [&](size_t begin, size_t end) { lanes_.add_scaled(to + begin, from + begin, by, end - begin); });
  }
  void combine(float* to, const float* a, const float* b, float by, size_t n) const {
    executor_.parallel_ranges(n, kPiece, [&](size_t begin, size_t end) { lanes_.combine(to + begin, a + begin, b + begin, by, end - begin); });
  }

 private:
  static constexpr size_t kPiece = 1 << 15, kMostPieces = 256;
  Executor& executor_;
  const EnergyLanes& lanes_;
};

}  // namespace knead
