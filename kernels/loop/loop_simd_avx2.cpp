#if defined(__AVX2__)
#define KNEAD_LANES Pack<8>
#define KNEAD_LOOP_LANES loop_simd_avx2
#include "kernels/loop/loop_simd.inl"
#else
#include "kernels/loop/loop_simd.h"
namespace knead {
const LoopSimd* loop_simd_avx2() {
  return nullptr;
}
}  // namespace knead
#endif
