// In builds without CUDA: no body has a launcher.
#include "tests/bench/table_simd.h"

namespace knead {

using namespace bench;

#define KNEAD_BODY(Body)       \
  template <>                  \
  CudaCode cuda_code<Body>() { \
    return {};                 \
  }
#include "tests/bench/table_device.inl"

}  // namespace knead
