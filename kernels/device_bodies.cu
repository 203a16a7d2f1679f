// Every body that devices run, as CUDA kernels. Reductions take two: blocks of indices, whose number and order depend on n alone, then one block over
// what they found. The tree inside a block is fixed too, so that a device gives the same bits every time.
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

// What block `block` finds of its piece.
template <class Body>
__device__ void reduce_piece(const Reduction<Body>& reduction, uint32_t block, uint32_t n, uint32_t piece) {
  const uint64_t begin = uint64_t{block} * piece, end = begin + piece < n ? begin + piece : n;
  SumOf<Body> sum{};
  for (uint64_t i = begin + threadIdx.x; i < end; i += kThreads) sum = Body::combine(sum, reduction.body(static_cast<uint32_t>(i)));
  sum = block_sum<Body>(sum);
  if (threadIdx.x == 0) reduction.partial[block] = sum;
}
template <class Body>
__device__ void finish(const Reduction<Body>& reduction, uint32_t pieces) {
  SumOf<Body> sum{};
  for (uint32_t p = threadIdx.x; p < pieces; p += kThreads) sum = Body::combine(sum, reduction.partial[p]);
  sum = block_sum<Body>(sum);
  if (threadIdx.x == 0) reduction.body.finish(sum);
}

template <class Body>
__global__ void __launch_bounds__(kThreads) reduce_pieces(const __grid_constant__ Reduction<Body> reduction, uint32_t n, uint32_t piece) {
  reduce_piece(reduction, blockIdx.x, n, piece);
}
template <class Body>
__global__ void __launch_bounds__(kThreads) finish_reduction(const __grid_constant__ Reduction<Body> reduction, uint32_t pieces) {
  finish(reduction, pieces);
}
// A row of blocks is a frame.
template <class Body>
__global__ void __launch_bounds__(kThreads) reduce_pieces_of(const Reduction<Body>* reductions, const uint32_t* running, uint32_t n, uint32_t piece) {
  if (running[blockIdx.y]) reduce_piece(reductions[blockIdx.y], blockIdx.x, n, piece);
}
template <class Body>
__global__ void __launch_bounds__(kThreads) finish_reductions(const Reduction<Body>* reductions, const uint32_t* running, uint32_t pieces) {
  if (running[blockIdx.y]) finish(reductions[blockIdx.y], pieces);
}

struct Pieces {
  uint32_t size, count;  // indices of a piece; pieces
};
template <class Body>
Pieces pieces_of(uint32_t n) {
  constexpr uint32_t kMost = Reduction<Body>::kMostPieces;
  const uint64_t blocks = (uint64_t{n} + kThreads - 1) / kThreads;
  const uint64_t size = (blocks + kMost - 1) / kMost * kThreads;
  return {static_cast<uint32_t>(size), n == 0 ? 0 : static_cast<uint32_t>((n + size - 1) / size)};
}

template <class Body>
CudaCode code_of_reduction() {
  return {[](const void* of, uint32_t n, void* stream) {
            const auto& reduction = *static_cast<const Reduction<Body>*>(of);
            const auto on = static_cast<cudaStream_t>(stream);
            const Pieces pieces = pieces_of<Body>(n);
            if (n > 0) reduce_pieces<Body><<<pieces.count, kThreads, 0, on>>>(reduction, n, pieces.size);
            finish_reduction<Body><<<1, kThreads, 0, on>>>(reduction, pieces.count);
          },
          [](const void* of, const uint32_t* running, uint32_t frames, uint32_t n, void* stream) {
            const auto* reductions = static_cast<const Reduction<Body>*>(of);
            const auto on = static_cast<cudaStream_t>(stream);
            const Pieces pieces = pieces_of<Body>(n);
            if (n > 0) reduce_pieces_of<Body><<<dim3(pieces.count, frames), kThreads, 0, on>>>(reductions, running, n, pieces.size);
            finish_reductions<Body><<<dim3(1, frames), kThreads, 0, on>>>(reductions, running, pieces.count);
          }};
}

}  // namespace

#define KNEAD_BODY(Body)         \
  template <>                    \
  CudaCode cuda_code<Body>() {   \
    return code_of_body<Body>(); \
  }
#define KNEAD_REDUCTION(Body)             \
  template <>                             \
  CudaCode cuda_code<Reduction<Body>>() { \
    return code_of_reduction<Body>();     \
  }
#include "kernels/device_bodies.inl"

}  // namespace knead
