#define KNEAD_LANES float
#define KNEAD_LOOP_LANES loop_simd_scalar
#include "kernels/loop/loop_simd.inl"
