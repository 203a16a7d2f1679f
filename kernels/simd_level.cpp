#include "kernels/simd_level.h"

#include <algorithm>
#include <atomic>
#include <cstring>

#include "graph/error.h"

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

// Where the levels beyond the compiler's own target are compiled is said by simd_sources.cmake.
bool build_has(SimdLevel level) {
#if defined(KNEAD_X86_LEVELS)
  constexpr bool kBeyond = true;
#else
  constexpr bool kBeyond = false;
#endif
#if defined(__SSE2__)
  constexpr bool kTarget = true;
#else
  constexpr bool kTarget = false;
#endif
  return level == SimdLevel::kScalar || (level == SimdLevel::kBaseline ? kTarget : kBeyond);
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
    if (processor_has(level) && build_has(level)) levels.push_back(level);
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

}  // namespace knead
