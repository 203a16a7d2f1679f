#include "kernels/loop/loop_simd.h"

#include "kernels/simd_level.h"

namespace knead {

const LoopSimd& loop_simd(const Executor& executor) {
  static constexpr const LoopSimd* (*kByLevel[])() = {loop_simd_scalar, loop_simd_baseline, loop_simd_avx2, loop_simd_avx512};
  return *kByLevel[static_cast<size_t>(simd_level(executor))]();
}

}  // namespace knead
