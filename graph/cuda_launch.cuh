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

// A row of blocks is a frame.
template <class Body>
__global__ void __launch_bounds__(kCudaBlock) run_bodies(const Body* bodies, const uint32_t* running, uint32_t n) {
  const uint32_t i = blockIdx.x * kCudaBlock + threadIdx.x;
  if (i < n && running[blockIdx.y]) bodies[blockIdx.y](i);
}

inline uint32_t blocks_for(uint32_t n) {
  return static_cast<uint32_t>((uint64_t{n} + kCudaBlock - 1) / kCudaBlock);
}

template <class Body>
CudaCode code_of_body() {
  return {[](const void* body, uint32_t n, void* stream) {
            run_body<Body><<<blocks_for(n), kCudaBlock, 0, static_cast<cudaStream_t>(stream)>>>(*static_cast<const Body*>(body), n);
          },
          [](const void* bodies, const uint32_t* running, uint32_t frames, uint32_t n, void* stream) {
            run_bodies<Body>
                <<<dim3(blocks_for(n), frames), kCudaBlock, 0, static_cast<cudaStream_t>(stream)>>>(static_cast<const Body*>(bodies), running, n);
          }};
}

}  // namespace knead
