#if defined(__SSE2__)
#define KNEAD_LANES Pack<4>
#define KNEAD_LOOP_LANES loop_lanes_baseline
#include "kernels/loop_lanes.inl"
#else
#include "kernels/loop_lanes.h"
namespace knead {
const LoopLanes* loop_lanes_baseline() { return nullptr; }
}  // namespace knead
#endif
