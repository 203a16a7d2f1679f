// The equilibrium solver's inner loops, compiled per instruction set like the loop's (kernels/loop/loop_simd.h).
#pragma once
#include <cstdint>

#include "graph/executor.h"
#include "kernels/equilibrium/elastic_body.h"
#include "kernels/multigrid/multigrid_body.h"

namespace knead {

struct EnergySimd {
  // Tets [begin, end), multiples of NeighbourTable::kLaneBlock.
  ElasticSum (*elastic)(const ElasticTets&, uint32_t begin, uint32_t end);
  // Rows [begin, end) of a multigrid cycle's products with a matrix.
  void (*smooth)(const Smooth&, size_t begin, size_t end);
  void (*residual)(const Residual&, size_t begin, size_t end);
};

const EnergySimd* energy_simd_scalar();
const EnergySimd* energy_simd_baseline();
const EnergySimd* energy_simd_avx2();
const EnergySimd* energy_simd_avx512();

// Those of the executor's simd_level.
const EnergySimd& energy_simd(const Executor& executor);

}  // namespace knead
