// The CUDA executor: the one file that talks to CUDA's runtime. Kernels and their launchers are in kernels/device_bodies.cu.
//
// Every thread that uses the device has a stream of its own, so that frames run side by side. Storage comes from a stream-ordered pool that keeps
// what it was given back. What a node publishes is complete (the evaluator synchronises), so buffers need no events.
#include <algorithm>
#include <atomic>
#include <cstdio>
#include <cstring>
#include <mutex>
#include <string>
#include <thread>
#include <unordered_map>
#include <utility>
#include <vector>

#include "graph/cuda_launch.cuh"
#include "graph/device_executor.h"
#include "graph/error.h"

namespace knead {

#define KNEAD_BODY(Body)         \
  template <>                    \
  CudaCode cuda_code<Body>() {   \
    return code_of_body<Body>(); \
  }
#include "graph/loop_bodies.inl"
#undef KNEAD_BODY

namespace {

constexpr int kLeastMajor = 7, kLeastMinor = 5;
constexpr int kConditionalNodes = 12040;  // driver and toolkit from which a graph can loop by itself
constexpr size_t kStagingBytes = size_t{1} << 20;
constexpr int kRoundsPerBatch = 16;  // where it cannot: rounds between two looks at whether the loop has ended

#if CUDART_VERSION >= 12040
#define KNEAD_CONDITIONAL_NODES 1
#endif

void check(cudaError_t status, const char* what) {
  if (status == cudaSuccess) return;
  cudaGetLastError();
  if (status == cudaErrorMemoryAllocation)  // CUDA's own: streams, graphs, code, the kernels' stacks
    throw Error(ErrorCode::kMemory, std::string("out of memory for CUDA itself: ") + what, "run fewer frames at once, or lower the resolution");
  throw Error(ErrorCode::kDevice, std::string("CUDA: ") + what + ": " + cudaGetErrorString(status),
              "run the frame again with --device cpu; a device that has failed serves no further frames of this run");
}

bool is_new_enough(const cudaDeviceProp& properties) {
  return properties.major > kLeastMajor || (properties.major == kLeastMajor && properties.minor >= kLeastMinor);
}

std::string in_gigabytes(size_t bytes) {
  char text[32];
  std::snprintf(text, sizeof text, "%.2f GB", static_cast<double>(bytes) / 1e9);
  return text;
}

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

// A thread's way to the device. What `open` has made when it fails goes with the lane.
class Lane {
 public:
  Lane() = default;
  Lane(const Lane&) = delete;
  Lane& operator=(const Lane&) = delete;
  void open() {
    check(cudaStreamCreateWithFlags(&stream_, cudaStreamNonBlocking), "making a stream");
    for (Staging& one : staging_) {
      check(cudaMallocHost(&one.memory, kStagingBytes), "pinning memory for transfers");
      check(cudaEventCreateWithFlags(&one.done, cudaEventDisableTiming), "making an event");
    }
  }
  ~Lane() {
    for (Staging& one : staging_) {
      if (one.done) cudaEventDestroy(one.done);
      if (one.memory) cudaFreeHost(one.memory);
    }
    if (stream_) cudaStreamDestroy(stream_);
  }
  cudaStream_t stream() const { return stream_; }

  // Through pinned memory, in pieces: one is filled while the other is on its way.
  void copy_here(const void* host, void* here, size_t bytes) {
    for (size_t at = 0, piece = 0; at < bytes; at += kStagingBytes, ++piece) {
      Staging& one = staging_[piece % 2];
      const size_t size = std::min(kStagingBytes, bytes - at);
      check(cudaEventSynchronize(one.done), "waiting for a transfer");
      std::memcpy(one.memory, static_cast<const char*>(host) + at, size);
      check(cudaMemcpyAsync(static_cast<char*>(here) + at, one.memory, size, cudaMemcpyHostToDevice, stream_), "a transfer to the device");
      check(cudaEventRecord(one.done, stream_), "a transfer to the device");
    }
  }
  void copy_to_host(const void* here, void* host, size_t bytes) {
    const size_t pieces = (bytes + kStagingBytes - 1) / kStagingBytes;
    const auto size_of = [&](size_t piece) { return std::min(kStagingBytes, bytes - piece * kStagingBytes); };
    for (size_t piece = 0; piece <= pieces; ++piece) {
      if (piece < pieces) {
        Staging& one = staging_[piece % 2];
        check(cudaEventSynchronize(one.done), "waiting for a transfer");
        check(cudaMemcpyAsync(one.memory, static_cast<const char*>(here) + piece * kStagingBytes, size_of(piece), cudaMemcpyDeviceToHost, stream_),
              "a transfer to the host");
        check(cudaEventRecord(one.done, stream_), "a transfer to the host");
      }
      if (piece > 0) {
        Staging& before = staging_[(piece - 1) % 2];
        check(cudaEventSynchronize(before.done), "waiting for a transfer");
        std::memcpy(static_cast<char*>(host) + (piece - 1) * kStagingBytes, before.memory, size_of(piece - 1));
      }
    }
  }

 private:
  struct Staging {
    void* memory = nullptr;
    cudaEvent_t done = nullptr;  // the last transfer through it
  };
  cudaStream_t stream_ = nullptr;
  Staging staging_[2];
};

class CudaBackend final : public DeviceBackend {
 public:
  CudaBackend(int index, bool graph_loops) : index_(index) {
    use();
    cudaDeviceProp properties;
    check(cudaGetDeviceProperties(&properties, index), "asking for the device's properties");
    description_ = properties.name;
    if (!is_new_enough(properties))
      throw Error(ErrorCode::kDevice,
                  description_ + " has compute capability " + std::to_string(properties.major) + "." + std::to_string(properties.minor),
                  "7.5 or later is needed");
    if (!properties.memoryPoolsSupported) throw Error(ErrorCode::kDevice, description_ + " has no memory pools", "update the driver");
    cudaFuncAttributes attributes;
    check(cudaFuncGetAttributes(&attributes, run_body<LoopBegin>),
          "looking for code for this device: is its architecture in CMAKE_CUDA_ARCHITECTURES?");
    total_ = properties.totalGlobalMem;
    int driver = 0;
    check(cudaDriverGetVersion(&driver), "asking for the driver's version");
    conditional_ = graph_loops && driver >= kConditionalNodes;
    cudaMemPoolProps wanted{};
    wanted.allocType = cudaMemAllocationTypePinned;
    wanted.location.type = cudaMemLocationTypeDevice;
    wanted.location.id = index;
    check(cudaMemPoolCreate(&pool_, &wanted), "making a memory pool");
    uint64_t keep_all = UINT64_MAX;
    check(cudaMemPoolSetAttribute(pool_, cudaMemPoolAttrReleaseThreshold, &keep_all), "setting up the memory pool");
  }
  ~CudaBackend() override {
    if (cudaSetDevice(index_) != cudaSuccess) return;  // the process is ending, and CUDA is gone
    // Stream by stream: waiting for the device as a whole would end what others in the process are recording.
    for (const auto& [thread, lane] : lanes_)
      if (lane) cudaStreamSynchronize(lane->stream());
    for (const auto& lane : idle_) cudaStreamSynchronize(lane->stream());
    lanes_.clear();
    idle_.clear();
    cudaMemPoolDestroy(pool_);
  }

  const char* name() const override { return "cuda"; }
  Device device() const override { return {DeviceKind::kCuda, index_}; }
  std::string describe() const override { return description_; }

  void* allocate(size_t bytes) override {
    if (bytes > total_) return nullptr;  // what CUDA calls a size beyond its address space is not said
    Lane& lane = use();
    void* storage = nullptr;
    cudaError_t status = cudaMallocFromPoolAsync(&storage, bytes, pool_, lane.stream());
    if (status == cudaErrorMemoryAllocation) {
      trim(lane);
      status = cudaMallocFromPoolAsync(&storage, bytes, pool_, lane.stream());
    }
    if (status == cudaErrorMemoryAllocation) {
      cudaGetLastError();
      return nullptr;
    }
    check(status, "allocating memory");
    return storage;
  }
  void release(void* storage) noexcept override {
    try {
      if (cudaFreeAsync(storage, use().stream()) != cudaSuccess) cudaGetLastError();  // else the next launch would be blamed for it
    } catch (...) {
      cudaGetLastError();  // a device that has failed frees nothing
    }
  }
  std::string free_memory() override {
    size_t free = 0, all = 0;
    if (cudaMemGetInfo(&free, &all) != cudaSuccess) {
      cudaGetLastError();
      return "and the device does not say what is free";
    }
    return in_gigabytes(free) + " of " + in_gigabytes(all) + " are free";
  }

  void copy_here(const void* host, void* here, size_t bytes) override { use().copy_here(host, here, bytes); }
  void copy_to_host(const void* here, void* host, size_t bytes) override { use().copy_to_host(here, host, bytes); }
  void launch(const Kernel& kernel, const void* body, uint32_t n) override {
    if (!kernel.cuda.one) throw Error(ErrorCode::kDevice, std::string("kernel ") + kernel.name + " has no code for CUDA in this build");
    Lane& lane = use();
    kernel.cuda.one(body, n, lane.stream());
    cudaError_t status = cudaGetLastError();
    if (status == cudaErrorMemoryAllocation) {  // for its code or its stack, on its first launch
      trim(lane);
      kernel.cuda.one(body, n, lane.stream());
      status = cudaGetLastError();
    }
    check(status, kernel.name);
  }
  void synchronise() override { check(cudaStreamSynchronize(use().stream()), "waiting for the device"); }
  int run_loops(const std::vector<const RecordedLoop*>& loops) override;

  // Makes the device the calling thread's, and finds the thread's lane.
  Lane& use() {
    check(cudaSetDevice(index_), "choosing the device");
    const std::lock_guard lock(mutex_);
    std::unique_ptr<Lane>& lane = lanes_[std::this_thread::get_id()];
    if (!lane && !idle_.empty()) {
      lane = std::move(idle_.back());
      idle_.pop_back();
    }
    if (!lane) {
      auto made = std::make_unique<Lane>();
      made->open();
      lane = std::move(made);
    }
    return *lane;
  }
  void thread_ends() override {
    const std::lock_guard lock(mutex_);
    const auto mine = lanes_.find(std::this_thread::get_id());
    if (mine == lanes_.end()) return;
    idle_.push_back(std::move(mine->second));
    lanes_.erase(mine);
  }

 private:
  // Gives back what the pool keeps, for another try.
  void trim(Lane& lane) {
    cudaGetLastError();
    check(cudaStreamSynchronize(lane.stream()), "waiting for the device");
    if (cudaMemPoolTrimTo(pool_, 0) != cudaSuccess) cudaGetLastError();
  }

  int index_;
  std::atomic<bool> conditional_{false};
  size_t total_ = 0;
  std::string description_;
  cudaMemPool_t pool_ = nullptr;
  std::mutex mutex_;
  std::unordered_map<std::thread::id, std::unique_ptr<Lane>> lanes_;
  std::vector<std::unique_ptr<Lane>> idle_;  // of threads that have ended
};

// Loops that are alike, on their way through the device: what their kernels read lies side by side in one piece of device memory.
//
// With a driver that can, one round is the body of a graph that repeats by itself while any of the loops goes on. With an older one it is a graph
// that is launched in batches until the device says that all have ended: rounds after the end come to nothing (graph/loop.h).
class LoopsOnDevice {
 public:
  LoopsOnDevice(CudaBackend& device, Lane& lane, const std::vector<const RecordedLoop*>& loops, bool repeats)
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
    check(cudaStreamSynchronize(stream_), "waiting for a loop");
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
      check(cudaGetLastError(), kernel.name);
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
    check(cudaGetLastError(), "loop_end");
    // The last round of a frame counts too, so here it does not matter who is running.
    if (first.words > 0) launch(kernel_of<LoopCommit>(), &first.commit, commit_, always_, first.words);
  }

  // False when CUDA refuses: what the driver's version promises, a kind of device or a part of one may lack. Batches give the same bits.
  bool launch_repeating() {
    try {
      make_graph();
      check(cudaGraphLaunch(ready_, stream_), "launching a loop");
      return true;
    } catch (const Error& error) {
      if (error.code() == ErrorCode::kMemory) throw;
      drop_graph();
      return false;
    }
  }

  void make_graph() {
    check(cudaStreamCreateWithFlags(&capturing_, cudaStreamNonBlocking), "making a stream");
    // Relaxed: other threads go on as they like.
#if defined(KNEAD_CONDITIONAL_NODES)
    if (repeats_) {
      check(cudaGraphCreate(&graph_, 0), "making a graph");
      check(cudaGraphConditionalHandleCreate(&handle_, graph_, 1, cudaGraphCondAssignDefault), "making a loop");
      cudaGraphNodeParams loop{};
      loop.type = cudaGraphNodeTypeConditional;
      loop.conditional.handle = handle_;
      loop.conditional.type = cudaGraphCondTypeWhile;
      loop.conditional.size = 1;
      cudaGraphNode_t node;
#if CUDART_VERSION >= 13000
      check(cudaGraphAddNode(&node, graph_, nullptr, nullptr, 0, &loop), "making a loop");
#else
      check(cudaGraphAddNode(&node, graph_, nullptr, 0, &loop), "making a loop");
#endif
      check(cudaStreamBeginCaptureToGraph(capturing_, loop.conditional.phGraph_out[0], nullptr, nullptr, 0, cudaStreamCaptureModeRelaxed),
            "recording a loop");
    } else
#endif
      check(cudaStreamBeginCapture(capturing_, cudaStreamCaptureModeRelaxed), "recording a loop");
    launch_round(capturing_);
    check(end_capture(), "recording a loop");
    check(cudaGraphInstantiate(&ready_, graph_, 0), "making a loop ready");
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
        check(cudaMallocHost(reinterpret_cast<void**>(&any), sizeof(uint32_t)), "pinning memory");
        check(cudaEventCreateWithFlags(&seen, cudaEventDisableTiming), "making an event");
      }
      ~Look() {
        if (seen) cudaEventDestroy(seen);
        if (any) cudaFreeHost(any);
      }
    } looks[2];
    const auto launch = [&](Look& look) {
      for (int round = 0; round < kRoundsPerBatch; ++round) check(cudaGraphLaunch(ready_, stream_), "launching a round");
      check(cudaMemcpyAsync(look.any, at<uint32_t>(any_), sizeof(uint32_t), cudaMemcpyDeviceToHost, stream_), "looking at a loop");
      check(cudaEventRecord(look.seen, stream_), "looking at a loop");
    };
    launch(looks[0]);
    for (int batch = 1;; ++batch) {
      launch(looks[batch % 2]);
      const Look& before = looks[(batch - 1) % 2];
      check(cudaEventSynchronize(before.seen), "waiting for a loop");
      if (*before.any) continue;
      check(cudaStreamSynchronize(stream_), "waiting for a loop");  // the last look writes to memory that goes
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

int CudaBackend::run_loops(const std::vector<const RecordedLoop*>& loops) {
  Lane& lane = use();
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

// "" or why there is none.
std::string missing_cuda(int& count) {
  int driver = 0;
  count = 0;
  if (cudaDriverGetVersion(&driver) != cudaSuccess || driver == 0) {
    cudaGetLastError();
    return "no NVIDIA driver";
  }
  const cudaError_t status = cudaGetDeviceCount(&count);
  if (status == cudaSuccess && count > 0) return {};
  cudaGetLastError();
  count = 0;
  return status == cudaSuccess || status == cudaErrorNoDevice ? "no NVIDIA device" : cudaGetErrorString(status);
}

}  // namespace

CudaDevices cuda_devices() {
  CudaDevices found;
  int count = 0;
  found.missing = missing_cuda(count);
  for (int index = 0; index < count; ++index) {
    cudaDeviceProp properties;
    if (const cudaError_t status = cudaGetDeviceProperties(&properties, index); status != cudaSuccess) {
      cudaGetLastError();
      found.missing = cudaGetErrorString(status);
      continue;
    }
    const std::string name = std::string(properties.name) + ", " + in_gigabytes(properties.totalGlobalMem) + ", compute capability " +
                             std::to_string(properties.major) + "." + std::to_string(properties.minor);
    if (is_new_enough(properties))
      found.devices.push_back({index, name});
    else
      found.missing = name + "; 7.5 or later is needed";
  }
  if (!found.devices.empty()) found.missing.clear();
  return found;
}

std::unique_ptr<Executor> make_cuda_executor(int index, bool graph_loops) {
  int count = 0;
  if (const std::string missing = missing_cuda(count); !missing.empty())
    throw Error(ErrorCode::kDevice, "there is no CUDA device: " + missing, "take --device cpu");
  if (index < 0 || index >= count)
    throw Error(ErrorCode::kDevice, "there is no CUDA device " + std::to_string(index), "there are " + std::to_string(count) + ", counted from 0");
  return std::make_unique<DeviceExecutor>(std::make_unique<CudaBackend>(index, graph_loops));
}

}  // namespace knead
