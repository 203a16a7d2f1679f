// Every body that devices run, as CUDA kernels. Reductions take two: blocks of indices, whose number and order depend on n alone, then one block over what
// they found. The tree inside a block is fixed too, so that a device gives the same bits every time.
#include "graph/cuda_launch.cuh"
#include "kernels/device_bodies.h"

namespace knead {
namespace {

constexpr uint32_t kWarp = 32, kThreads = 256, kWarps = kThreads / kWarp;

// The value that the lane `by` further up has.
template <class T>
__device__ T from_lane_above(const T& value, uint32_t by) {
  static_assert(sizeof(T) % sizeof(uint32_t) == 0);
  union Words {
    T value;
    uint32_t words[sizeof(T) / sizeof(uint32_t)];
    __device__ Words() {}
  } mine, theirs;
  mine.value = value;
#pragma unroll
  for (uint32_t w = 0; w < sizeof(T) / sizeof(uint32_t); ++w) theirs.words[w] = __shfl_down_sync(0xffffffffu, mine.words[w], by);
  return theirs.value;
}

// The sum over a block of kThreads, in thread 0.
template <class Body, class Sum>
__device__ Sum block_sum(Sum sum) {
  __shared__ alignas(16) unsigned char storage[kWarps * sizeof(Sum)];
  Sum* const warps = reinterpret_cast<Sum*>(storage);
  for (uint32_t by = kWarp / 2; by > 0; by /= 2) sum = Body::combine(sum, from_lane_above(sum, by));
  if (threadIdx.x % kWarp == 0) warps[threadIdx.x / kWarp] = sum;
  __syncthreads();
  if (threadIdx.x == 0)
    for (uint32_t w = 1; w < kWarps; ++w) sum = Body::combine(sum, warps[w]);
  return sum;
}

template <class Body>
__global__ void __launch_bounds__(kThreads) reduce_pieces(const __grid_constant__ Reduction<Body> reduction, uint32_t n, uint32_t piece) {
  const uint64_t begin = uint64_t{blockIdx.x} * piece, end = begin + piece < n ? begin + piece : n;
  SumOf<Body> sum{};
  for (uint64_t i = begin + threadIdx.x; i < end; i += kThreads) sum = Body::combine(sum, reduction.body(static_cast<uint32_t>(i)));
  sum = block_sum<Body>(sum);
  if (threadIdx.x == 0) reduction.partial[blockIdx.x] = sum;
}

template <class Body>
__global__ void __launch_bounds__(kThreads) finish_reduction(const __grid_constant__ Reduction<Body> reduction, uint32_t pieces) {
  SumOf<Body> sum{};
  for (uint32_t p = threadIdx.x; p < pieces; p += kThreads) sum = Body::combine(sum, reduction.partial[p]);
  sum = block_sum<Body>(sum);
  if (threadIdx.x == 0) reduction.body.finish(sum);
}

template <class Body>
CudaLauncher reduction_launcher() {
  return [](const void* of, uint32_t n, void* stream) {
    const auto& reduction = *static_cast<const Reduction<Body>*>(of);
    constexpr uint32_t kMost = Reduction<Body>::kMostPieces;
    const uint64_t blocks = (uint64_t{n} + kThreads - 1) / kThreads;
    const uint32_t piece = static_cast<uint32_t>((blocks + kMost - 1) / kMost * kThreads);
    const uint32_t pieces = n == 0 ? 0 : static_cast<uint32_t>((uint64_t{n} + piece - 1) / piece);
    const auto on = static_cast<cudaStream_t>(stream);
    if (pieces > 0) reduce_pieces<Body><<<pieces, kThreads, 0, on>>>(reduction, n, piece);
    finish_reduction<Body><<<1, kThreads, 0, on>>>(reduction, pieces);
  };
}

}  // namespace

#define KNEAD_BODY(Body)               \
  template <>                          \
  CudaLauncher cuda_launcher<Body>() { \
    return body_launcher<Body>();      \
  }
#define KNEAD_REDUCTION(Body)                     \
  template <>                                     \
  CudaLauncher cuda_launcher<Reduction<Body>>() { \
    return reduction_launcher<Body>();            \
  }
#include "kernels/device_bodies.inl"

}  // namespace knead
