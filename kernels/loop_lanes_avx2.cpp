#if defined(__AVX2__)
#define KNEAD_LANES Pack<8>
#define KNEAD_LOOP_LANES loop_lanes_avx2
#include "kernels/loop_lanes.inl"
#else
#include "kernels/loop_lanes.h"
namespace knead {
const LoopLanes* loop_lanes_avx2() { return nullptr; }
}  // namespace knead
#endif
