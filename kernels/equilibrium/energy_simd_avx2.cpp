#if defined(__AVX2__)
#define KNEAD_LANES Pack<8>
#define KNEAD_ENERGY_LANES energy_simd_avx2
#include "kernels/equilibrium/energy_simd.inl"
#else
#include "kernels/equilibrium/energy_simd.h"
namespace knead {
const EnergySimd* energy_simd_avx2() {
  return nullptr;
}
}  // namespace knead
#endif
