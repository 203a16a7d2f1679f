#define KNEAD_LANES float
#define KNEAD_LOOP_LANES loop_lanes_scalar
#include "kernels/loop_lanes.inl"
