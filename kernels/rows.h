// A vector of the equilibrium solver: a row of four floats per vertex of H, zero to begin with.
#pragma once
#include <algorithm>

#include "graph/buffer.h"
#include "kernels/rows4.h"

namespace knead {

class Rows {
 public:
  explicit Rows(size_t n) : buffer_(n) { std::fill_n(data(), n, Row4{0, 0, 0, 0}); }
  Row4* data() { return buffer_.data_for_write(); }
  float* floats() { return &data()->x; }

 private:
  Buffer<Row4> buffer_;
};

}  // namespace knead
