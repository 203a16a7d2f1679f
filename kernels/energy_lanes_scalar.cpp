#define KNEAD_LANES float
#define KNEAD_ENERGY_LANES energy_lanes_scalar
#include "kernels/energy_lanes.inl"
