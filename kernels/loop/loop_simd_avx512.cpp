#if defined(__AVX512F__)
#define KNEAD_LANES Pack<16>
#define KNEAD_LOOP_LANES loop_simd_avx512
#include "kernels/loop/loop_simd.inl"
#else
#include "kernels/loop/loop_simd.h"
namespace knead {
const LoopSimd* loop_simd_avx512() {
  return nullptr;
}
}  // namespace knead
#endif
