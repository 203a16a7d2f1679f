// In builds without CUDA: what the CUDA executor's file would hold.
#include "graph/error.h"
#include "graph/loop.h"

namespace knead {

template <class Body>
CudaCode cuda_code() {
  return {};
}
#define KNEAD_BODY(Body) template CudaCode cuda_code<Body>();
#include "graph/loop_bodies.inl"
#undef KNEAD_BODY

CudaDevices cuda_devices() {
  return {{}, "not in this build"};
}
std::unique_ptr<Executor> make_cuda_executor(int, bool) {
  throw Error(ErrorCode::kDevice, "this build has no CUDA", "build the preset `cuda`, with nvcc on the PATH");
}

}  // namespace knead
