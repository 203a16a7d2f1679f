#if defined(__AVX2__)
#define KNEAD_LANES Pack<8>
#define KNEAD_ENERGY_LANES energy_lanes_avx2
#include "kernels/energy_lanes.inl"
#else
#include "kernels/energy_lanes.h"
namespace knead {
const EnergyLanes* energy_lanes_avx2() { return nullptr; }
}  // namespace knead
#endif
