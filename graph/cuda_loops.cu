// Loops on CUDA devices: recorded rounds as one graph that repeats without the host.
#include <algorithm>
#include <cstring>
#include <string>
#include <utility>

#include "graph/cuda_backend.cuh"
#include "graph/error.h"

namespace knead {
namespace {

constexpr int kRoundsPerBatch = 16;  // where a graph cannot repeat by itself: rounds between two looks at whether the loop has ended

#if CUDART_VERSION >= 12040
#define KNEAD_CONDITIONAL_NODES 1
#endif

// The end of a round for every frame: whether it goes on, and whether any does. One block.
__device__ bool end_rounds(const LoopEnd* ends, uint32_t frames, uint32_t* running, uint32_t* any) {
  int mine = 0;
  for (uint32_t f = threadIdx.x; f < frames; f += blockDim.x) {
    ends[f](0);
    running[f] = ends[f].running();
    mine |= static_cast<int>(running[f]);
  }
  const bool some = __syncthreads_or(mine) != 0;
  if (threadIdx.x == 0) *any = some;
  return some;
}
__global__ void end_rounds_for_host(const LoopEnd* ends, uint32_t frames, uint32_t* running, uint32_t* any) {
  end_rounds(ends, frames, running, any);
}
#if defined(KNEAD_CONDITIONAL_NODES)
__global__ void end_rounds_for_graph(const LoopEnd* ends, uint32_t frames, uint32_t* running, uint32_t* any, cudaGraphConditionalHandle handle) {
  const bool some = end_rounds(ends, frames, running, any);
  if (threadIdx.x == 0) cudaGraphSetConditional(handle, some);
}
#endif

// Loops that are alike, on their way through the device: what their kernels read lies side by side in one piece of device memory.
//
// With a driver that can, one round is the body of a graph that repeats by itself while any of the loops goes on. With an older one it is a graph
// that is launched in batches until the device says that all have ended: rounds after the end come to nothing (graph/loop.h).
class LoopsOnDevice {
 public:
  LoopsOnDevice(CudaBackend& device, CudaLane& lane, const std::vector<const RecordedLoop*>& loops, bool repeats)
      : device_(device), stream_(lane.stream()), loops_(loops), repeats_(repeats) {
    const size_t frames = loops.size();
    const RecordedLoop& first = *loops.front();
    std::vector<char> bytes;
    const auto room = [&](size_t size) {
      const size_t at = (bytes.size() + kAlignment - 1) / kAlignment * kAlignment;
      bytes.resize(at + size);
      return at;
    };
    const auto side_by_side = [&](size_t size, const auto& body_of) {
      const size_t at = room(size * frames);
      for (size_t f = 0; f < frames; ++f) std::memcpy(&bytes[at + f * size], body_of(*loops[f]), size);
      return at;
    };
    if (frames > 1) {
      for (size_t s = 0; s < first.steps.size(); ++s)
        steps_.push_back(side_by_side(first.steps[s].kernel->body_bytes,
                                      [&](const RecordedLoop& loop) { return static_cast<const void*>(loop.steps[s].body.data()); }));
      commit_ = side_by_side(sizeof(LoopCommit), [](const RecordedLoop& loop) { return static_cast<const void*>(&loop.commit); });
    }
    ends_ = side_by_side(sizeof(LoopEnd), [](const RecordedLoop& loop) { return static_cast<const void*>(&loop.end); });
    const std::vector<uint32_t> ones(frames, 1);
    const auto flags = [&] {
      const size_t at = room(frames * sizeof(uint32_t));
      std::memcpy(&bytes[at], ones.data(), frames * sizeof(uint32_t));
      return at;
    };
    running_ = flags();
    always_ = flags();
    any_ = room(sizeof(uint32_t));
    storage_ = static_cast<char*>(device.allocate(bytes.size()));
    if (!storage_)
      throw Error(ErrorCode::kMemory, "out of memory on " + device.device().text() + " for a loop: " + device.free_memory(),
                  "run fewer frames at once");
    lane.copy_here(bytes.data(), storage_, bytes.size());
  }
  LoopsOnDevice(const LoopsOnDevice&) = delete;
  LoopsOnDevice& operator=(const LoopsOnDevice&) = delete;
  ~LoopsOnDevice() {
    cudaStreamSynchronize(stream_);  // after an error, rounds may still be on their way, and other threads free what they read
    drop_graph();
    if (storage_) device_.release(storage_);
  }

  // Returns how many graphs the host has launched.
  int run() {
    if (repeats_ && !launch_repeating()) repeats_ = false;
    int launches = 1;
    if (!repeats_) {
      make_graph();
      launches = run_in_batches();
    }
    check_cuda(cudaStreamSynchronize(stream_), "waiting for a loop");
    return launches;
  }
  bool repeats() const { return repeats_; }

 private:
  static constexpr size_t kAlignment = 256;

  template <class T>
  T* at(size_t offset) const {
    return reinterpret_cast<T*>(storage_ + offset);
  }
  uint32_t frames() const { return static_cast<uint32_t>(loops_.size()); }

  // A round, on the stream that is being captured.
  void launch_round(cudaStream_t stream) {
    const RecordedLoop& first = *loops_.front();
    const auto launch = [&](const Kernel& kernel, const void* body, size_t bodies, size_t running, uint32_t n) {
      if (frames() == 1)
        kernel.cuda.one(body, n, stream);
      else
        kernel.cuda.many(at<char>(bodies), at<uint32_t>(running), frames(), n, stream);
      check_cuda(cudaGetLastError(), kernel.name);
    };
    for (size_t s = 0; s < first.steps.size(); ++s) {
      const RecordedLoop::Step& step = first.steps[s];
      launch(*step.kernel, step.body.data(), frames() > 1 ? steps_[s] : 0, running_, step.n);
    }
    const uint32_t threads = std::min<uint32_t>(256, (frames() + 31) / 32 * 32);
#if defined(KNEAD_CONDITIONAL_NODES)
    if (repeats_)
      end_rounds_for_graph<<<1, threads, 0, stream>>>(at<LoopEnd>(ends_), frames(), at<uint32_t>(running_), at<uint32_t>(any_), handle_);
    else
#endif
      end_rounds_for_host<<<1, threads, 0, stream>>>(at<LoopEnd>(ends_), frames(), at<uint32_t>(running_), at<uint32_t>(any_));
    check_cuda(cudaGetLastError(), "loop_end");
    // The last round of a frame counts too, so here it does not matter who is running.
    if (first.words > 0) launch(kernel_of<LoopCommit>(), &first.commit, commit_, always_, first.words);
  }

  // False when CUDA refuses: what the driver's version promises, a kind of device or a part of one may lack. Batches give the same bits.
  bool launch_repeating() {
    try {
      make_graph();
      check_cuda(cudaGraphLaunch(ready_, stream_), "launching a loop");
      return true;
    } catch (const Error& error) {
      if (error.code() == ErrorCode::kMemory) throw;
      drop_graph();
      return false;
    }
  }

  void make_graph() {
    check_cuda(cudaStreamCreateWithFlags(&capturing_, cudaStreamNonBlocking), "making a stream");
    // Relaxed: other threads go on as they like.
#if defined(KNEAD_CONDITIONAL_NODES)
    if (repeats_) {
      check_cuda(cudaGraphCreate(&graph_, 0), "making a graph");
      check_cuda(cudaGraphConditionalHandleCreate(&handle_, graph_, 1, cudaGraphCondAssignDefault), "making a loop");
      cudaGraphNodeParams loop{};
      loop.type = cudaGraphNodeTypeConditional;
      loop.conditional.handle = handle_;
      loop.conditional.type = cudaGraphCondTypeWhile;
      loop.conditional.size = 1;
      cudaGraphNode_t node;
#if CUDART_VERSION >= 13000
      check_cuda(cudaGraphAddNode(&node, graph_, nullptr, nullptr, 0, &loop), "making a loop");
#else
      check_cuda(cudaGraphAddNode(&node, graph_, nullptr, 0, &loop), "making a loop");
#endif
      check_cuda(cudaStreamBeginCaptureToGraph(capturing_, loop.conditional.phGraph_out[0], nullptr, nullptr, 0, cudaStreamCaptureModeRelaxed),
                 "recording a loop");
    } else
#endif
      check_cuda(cudaStreamBeginCapture(capturing_, cudaStreamCaptureModeRelaxed), "recording a loop");
    launch_round(capturing_);
    check_cuda(end_capture(), "recording a loop");
    check_cuda(cudaGraphInstantiate(&ready_, graph_, 0), "making a loop ready");
  }
  // A loop's body whose capture has failed is freed by CUDA although its graph still holds it: destroying that graph would end the process
  // (NVIDIA/cuda-python 2918), so it is left alone.
  cudaError_t end_capture() {
    cudaGraph_t captured = nullptr;
    const cudaError_t status = cudaStreamEndCapture(capturing_, &captured);
    if (!repeats_)
      graph_ = captured;
    else if (status != cudaSuccess)
      graph_ = nullptr;
    cudaStreamDestroy(std::exchange(capturing_, nullptr));
    return status;
  }
  void drop_graph() {
    if (capturing_) end_capture();
    if (ready_) cudaGraphExecDestroy(std::exchange(ready_, nullptr));
    if (graph_) cudaGraphDestroy(std::exchange(graph_, nullptr));
    cudaGetLastError();
  }

  // While a batch runs, the next is on its way already: the device does not wait for the host. Two batches too many are the price.
  int run_in_batches() {
    struct Look {
      uint32_t* any = nullptr;
      cudaEvent_t seen = nullptr;
      Look() {
        check_cuda(cudaMallocHost(reinterpret_cast<void**>(&any), sizeof(uint32_t)), "pinning memory");
        check_cuda(cudaEventCreateWithFlags(&seen, cudaEventDisableTiming), "making an event");
      }
      ~Look() {
        if (seen) cudaEventDestroy(seen);
        if (any) cudaFreeHost(any);
      }
    } looks[2];
    const auto launch = [&](Look& look) {
      for (int round = 0; round < kRoundsPerBatch; ++round) check_cuda(cudaGraphLaunch(ready_, stream_), "launching a round");
      check_cuda(cudaMemcpyAsync(look.any, at<uint32_t>(any_), sizeof(uint32_t), cudaMemcpyDeviceToHost, stream_), "looking at a loop");
      check_cuda(cudaEventRecord(look.seen, stream_), "looking at a loop");
    };
    launch(looks[0]);
    for (int batch = 1;; ++batch) {
      launch(looks[batch % 2]);
      const Look& before = looks[(batch - 1) % 2];
      check_cuda(cudaEventSynchronize(before.seen), "waiting for a loop");
      if (*before.any) continue;
      check_cuda(cudaStreamSynchronize(stream_), "waiting for a loop");  // the last look writes to memory that goes
      return (batch + 1) * kRoundsPerBatch;
    }
  }

  CudaBackend& device_;
  cudaStream_t stream_;
  const std::vector<const RecordedLoop*>& loops_;
  bool repeats_;
  char* storage_ = nullptr;
  std::vector<size_t> steps_;  // where in storage the bodies are; of one frame they are kernel parameters
  size_t commit_ = 0, ends_ = 0, running_ = 0, always_ = 0, any_ = 0;
  cudaStream_t capturing_ = nullptr;
  cudaGraph_t graph_ = nullptr;
  cudaGraphExec_t ready_ = nullptr;
#if defined(KNEAD_CONDITIONAL_NODES)
  cudaGraphConditionalHandle handle_{};
#endif
};

}  // namespace

int CudaBackend::run_loops(const std::vector<const RecordedLoop*>& loops) {
  CudaLane& lane = use();
  const auto run = [&] {
    LoopsOnDevice on_device(*this, lane, loops, conditional_);
    const int launches = on_device.run();
    if (!on_device.repeats()) conditional_ = false;
    return launches;
  };
  try {
    return run();
  } catch (const Error& error) {
    if (error.code() != ErrorCode::kMemory) throw;
  }
  trim(lane);  // what CUDA needs for itself may be what the pool keeps; rounds that were made stay made
  return run();
}

}  // namespace knead
