// Which vector instructions the loop's kernels run with: chosen at run time, so that one binary serves every machine of its architecture.
#pragma once
#include <string>
#include <vector>

#include "graph/executor.h"

namespace knead {

enum class SimdLevel { kScalar, kBaseline, kAvx2, kAvx512 };  // kBaseline: what the compiler's target has anyway (SSE2 on x86-64)

const char* name_of(SimdLevel level);

// What this build has code for and this processor can run, best last; always has kScalar.
std::vector<SimdLevel> simd_levels();

// The level an executor's kernels run at: scalar for `serial`, else the best there is, or what use_simd_level has set.
SimdLevel simd_level(const Executor& executor);

// For tests and benchmarks. Throws Error(kInput) when this build or processor has not got it. Not to be called while kernels run.
void use_simd_level(SimdLevel level);

}  // namespace knead
