#if defined(__SSE2__)
#define KNEAD_LANES Pack<4>
#define KNEAD_ENERGY_LANES energy_simd_baseline
#include "kernels/equilibrium/energy_simd.inl"
#else
#include "kernels/equilibrium/energy_simd.h"
namespace knead {
const EnergySimd* energy_simd_baseline() {
  return nullptr;
}
}  // namespace knead
#endif
