#include "kernels/simd_level.h"

#include <algorithm>
#include <atomic>
#include <cstring>

#include "graph/error.h"
#include "kernels/loop/loop_simd.h"

namespace knead {
namespace {

bool processor_has(SimdLevel level) {
#if defined(__x86_64__)
  __builtin_cpu_init();
  const bool avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
  if (level == SimdLevel::kAvx2) return avx2;
  if (level == SimdLevel::kAvx512)
    return avx2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512dq") &&
           __builtin_cpu_supports("avx512bw");
  return true;
#else
  return level == SimdLevel::kScalar;
#endif
}

const LoopSimd* lanes_of(SimdLevel level) {
  switch (level) {
    case SimdLevel::kAvx512: return loop_simd_avx512();
    case SimdLevel::kAvx2: return loop_simd_avx2();
    case SimdLevel::kBaseline: return loop_simd_baseline();
    case SimdLevel::kScalar: break;
  }
  return loop_simd_scalar();
}

std::atomic<SimdLevel>& level_in_use() {
  static std::atomic<SimdLevel> level{simd_levels().back()};
  return level;
}

}  // namespace

const char* name_of(SimdLevel level) {
  switch (level) {
    case SimdLevel::kAvx512: return "AVX-512";
    case SimdLevel::kAvx2: return "AVX2";
    case SimdLevel::kBaseline: return "SSE2";
    case SimdLevel::kScalar: break;
  }
  return "scalar";
}

std::vector<SimdLevel> simd_levels() {
  std::vector<SimdLevel> levels;
  for (const SimdLevel level : {SimdLevel::kScalar, SimdLevel::kBaseline, SimdLevel::kAvx2, SimdLevel::kAvx512})
    if (processor_has(level) && lanes_of(level)) levels.push_back(level);
  return levels;
}

SimdLevel simd_level(const Executor& executor) {
  return std::strcmp(executor.name(), "serial") == 0 ? SimdLevel::kScalar : level_in_use().load(std::memory_order_relaxed);
}

void use_simd_level(SimdLevel level) {
  const std::vector<SimdLevel> levels = simd_levels();
  if (std::find(levels.begin(), levels.end(), level) == levels.end())
    throw Error(ErrorCode::kInput, std::string("this build or processor has no ") + name_of(level));
  level_in_use().store(level, std::memory_order_relaxed);
}

const LoopSimd& loop_simd(const Executor& executor) {
  return *lanes_of(simd_level(executor));
}

}  // namespace knead
