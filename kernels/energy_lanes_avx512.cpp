#if defined(__AVX512F__)
#define KNEAD_LANES Pack<16>
#define KNEAD_ENERGY_LANES energy_lanes_avx512
#include "kernels/energy_lanes.inl"
#else
#include "kernels/energy_lanes.h"
namespace knead {
const EnergyLanes* energy_lanes_avx512() { return nullptr; }
}  // namespace knead
#endif
