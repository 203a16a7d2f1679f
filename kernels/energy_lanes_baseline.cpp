#if defined(__SSE2__)
#define KNEAD_LANES Pack<4>
#define KNEAD_ENERGY_LANES energy_lanes_baseline
#include "kernels/energy_lanes.inl"
#else
#include "kernels/energy_lanes.h"
namespace knead {
const EnergyLanes* energy_lanes_baseline() { return nullptr; }
}  // namespace knead
#endif
