#if defined(__AVX512F__)
#define KNEAD_LANES Pack<16>
#define KNEAD_ENERGY_LANES energy_simd_avx512
#include "kernels/equilibrium/energy_simd.inl"
#else
#include "kernels/equilibrium/energy_simd.h"
namespace knead {
const EnergySimd* energy_simd_avx512() {
  return nullptr;
}
}  // namespace knead
#endif
