// The other structures' bodies as CUDA kernels: a lane is a thread.
#include "graph/cuda_launch.cuh"
#include "tests/bench/table_simd.h"

namespace knead {

using namespace bench;

#define KNEAD_BODY(Body)         \
  template <>                    \
  CudaCode cuda_code<Body>() {   \
    return code_of_body<Body>(); \
  }
#include "tests/bench/table_device.inl"

}  // namespace knead
