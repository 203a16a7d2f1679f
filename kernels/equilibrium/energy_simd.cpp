#include "kernels/equilibrium/energy_simd.h"

#include "kernels/simd_level.h"

namespace knead {

const EnergySimd& energy_simd(const Executor& executor) {
  switch (simd_level(executor)) {
    case SimdLevel::kAvx512: return *energy_simd_avx512();
    case SimdLevel::kAvx2: return *energy_simd_avx2();
    case SimdLevel::kBaseline: return *energy_simd_baseline();
    case SimdLevel::kScalar: break;
  }
  return *energy_simd_scalar();
}

}  // namespace knead
