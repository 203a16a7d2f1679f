// Internal, for .cu files: how a body becomes a kernel. Errors of launches are looked at by the executor that asks for them.
#pragma once
#include "graph/device_code.h"

namespace knead {

inline constexpr uint32_t kCudaBlock = 128;

template <class Body>
__global__ void __launch_bounds__(kCudaBlock) run_body(const __grid_constant__ Body body, uint32_t n) {
  const uint32_t i = blockIdx.x * kCudaBlock + threadIdx.x;
  if (i < n) body(i);
}

template <class Body>
CudaLauncher body_launcher() {
  return [](const void* body, uint32_t n, void* stream) {
    const uint32_t blocks = static_cast<uint32_t>((uint64_t{n} + kCudaBlock - 1) / kCudaBlock);
    run_body<Body><<<blocks, kCudaBlock, 0, static_cast<cudaStream_t>(stream)>>>(*static_cast<const Body*>(body), n);
  };
}

}  // namespace knead
