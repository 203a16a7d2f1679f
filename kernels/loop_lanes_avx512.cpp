#if defined(__AVX512F__)
#define KNEAD_LANES Pack<16>
#define KNEAD_LOOP_LANES loop_lanes_avx512
#include "kernels/loop_lanes.inl"
#else
#include "kernels/loop_lanes.h"
namespace knead {
const LoopLanes* loop_lanes_avx512() { return nullptr; }
}  // namespace knead
#endif
