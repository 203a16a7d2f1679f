#define KNEAD_LANES float
#define KNEAD_ENERGY_LANES energy_simd_scalar
#include "kernels/equilibrium/energy_simd.inl"
