// The equilibrium solver's inner loops, compiled per instruction set like the loop's (kernels/loop_lanes.h).
#pragma once
#include <cstdint>

#include "graph/executor.h"
#include "kernels/elastic_body.h"
#include "kernels/multigrid_body.h"

namespace knead {

struct EnergyLanes {
  // Tets [begin, end), multiples of NeighbourTable::kLaneBlock.
  ElasticSum (*elastic)(const ElasticTets&, uint32_t begin, uint32_t end);
  // Rows [begin, end) of a multigrid cycle's products with a matrix.
  void (*smooth)(const Smooth&, size_t begin, size_t end);
  void (*residual)(const Residual&, size_t begin, size_t end);
};

const EnergyLanes* energy_lanes_scalar();
const EnergyLanes* energy_lanes_baseline();
const EnergyLanes* energy_lanes_avx2();
const EnergyLanes* energy_lanes_avx512();

// Those of the executor's simd_level.
const EnergyLanes& energy_lanes(const Executor& executor);

}  // namespace knead
