#if defined(__SSE2__)
#define KNEAD_LANES Pack<4>
#define KNEAD_LOOP_LANES loop_simd_baseline
#include "kernels/loop/loop_simd.inl"
#else
#include "kernels/loop/loop_simd.h"
namespace knead {
const LoopSimd* loop_simd_baseline() {
  return nullptr;
}
}  // namespace knead
#endif
