// A sparse Cholesky factor for many solves: made once in double by the multifrontal method (Duff and Reid 1983; Liu 1992) over a nested dissection, kept in float32
// panels for solves with three right-hand sides (kernels/factor_body.h).
#pragma once
#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "graph/buffer.h"
#include "graph/executor.h"
#include "kernels/factor_body.h"
#include "kernels/nested_dissection.h"

namespace knead {

struct EnergyLanes;

class SparseCholesky {
 public:
  // The matrix in places of the dissection: `edges` with their entries, each once, and the diagonal. Throws Error(kInput) when it is not positive definite,
  // Error(kMemory) when the factor would not fit.
  SparseCholesky(Executor& executor, const Dissection& dissection, std::span<const std::array<uint32_t, 2>> edges, std::span<const double> entries,
                 std::span<const double> diagonal);

  // x <- A^-1 x; `scratch` has scratch_floats() of room.
  void solve(const EnergyLanes& lanes, Row4* x, float* scratch) const;

  size_t scratch_floats() const { return scratch_floats_; }
  size_t stored_values() const { return values_.size(); }
  size_t bytes() const { return values_.bytes() + rows_.size() * sizeof(uint32_t) + panels_.size() * sizeof(Panel); }

 private:
  std::vector<Panel> panels_;
  std::vector<uint32_t> rows_;
  Buffer<float> values_;
  size_t scratch_floats_ = 0;
};

}  // namespace knead
