// The CUDA executor: the one file that talks to CUDA's runtime. Kernels and their launchers are in kernels/device_bodies.cu.
//
// Every thread that uses the device has a stream of its own, so that frames run side by side. Storage comes from a stream-ordered pool that keeps what it was
// given back. What a node publishes is complete (the evaluator synchronises), so buffers need no events.
#include <algorithm>
#include <cstdio>
#include <cstring>
#include <mutex>
#include <string>
#include <thread>
#include <unordered_map>

#include "graph/cuda_launch.cuh"
#include "graph/device_executor.h"
#include "graph/error.h"

namespace knead {

#define KNEAD_BODY(Body)               \
  template <>                          \
  CudaLauncher cuda_launcher<Body>() { \
    return body_launcher<Body>();      \
  }
#include "graph/loop_bodies.inl"
#undef KNEAD_BODY

namespace {

constexpr int kLeastMajor = 7, kLeastMinor = 5;
constexpr int kConditionalNodes = 12040;       // driver and toolkit from which a graph can loop by itself
constexpr size_t kStagingBytes = size_t{4} << 20;
constexpr int kRoundsPerBatch = 16;            // where it cannot: rounds between two looks at whether the loop has ended

#if CUDART_VERSION >= 12040
#define KNEAD_CONDITIONAL_NODES 1
#endif

void check(cudaError_t status, const char* what) {
  if (status == cudaSuccess) return;
  cudaGetLastError();
  throw Error(ErrorCode::kDevice, std::string("CUDA: ") + what + ": " + cudaGetErrorString(status),
              "run the frame again with --device cpu; a device that has failed serves no further frames of this run");
}

std::string in_gigabytes(size_t bytes) {
  char text[32];
  std::snprintf(text, sizeof text, "%.2f GB", static_cast<double>(bytes) / 1e9);
  return text;
}

// A graph that can be launched.
class Graph {
 public:
  Graph() = default;
  Graph(const Graph&) = delete;
  Graph& operator=(const Graph&) = delete;
  ~Graph() {
    if (ready_) cudaGraphExecDestroy(ready_);
    if (graph_) cudaGraphDestroy(graph_);
  }
  cudaGraph_t& graph() { return graph_; }
  void make_ready() { check(cudaGraphInstantiate(&ready_, graph_, 0), "making a graph ready"); }
  void launch(cudaStream_t stream) { check(cudaGraphLaunch(ready_, stream), "launching a graph"); }

 private:
  cudaGraph_t graph_ = nullptr;
  cudaGraphExec_t ready_ = nullptr;
};

#if defined(KNEAD_CONDITIONAL_NODES)
__global__ void end_round(const __grid_constant__ LoopEnd end, cudaGraphConditionalHandle handle) {
  end(0);
  cudaGraphSetConditional(handle, end.running());
}
#endif

// A thread's way to the device.
class Lane {
 public:
  Lane() {
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

class CudaBackend;

// One round, captured, as the body of a graph that loops while the device says so; or, with an older driver, as a graph that is launched in batches until
// the device says that it has ended: rounds after the end come to nothing (graph/loop.h).
class CudaLoop final : public DeviceLoop {
 public:
  CudaLoop(CudaBackend& device, bool conditional);
  ~CudaLoop() override;
  void launch(const Kernel& kernel, const void* body, uint32_t n) override {
    kernel.cuda(body, n, capturing_);
    check(cudaGetLastError(), kernel.name);
  }
  void run(const LoopEnd& end, const LoopCommit& commit, uint32_t words) override;

 private:
  void close(const LoopEnd& end, const LoopCommit& commit, uint32_t words);
  void run_in_batches(const LoopEnd& end, cudaStream_t stream);

  CudaBackend& device_;
  bool conditional_;
  bool is_capturing_ = false;
  bool ready_ = false;
  cudaStream_t capturing_ = nullptr;
  Graph graph_;
#if defined(KNEAD_CONDITIONAL_NODES)
  cudaGraphConditionalHandle handle_{};
#endif
};

class CudaBackend final : public DeviceBackend {
 public:
  explicit CudaBackend(int index) : index_(index) {
    use();
    cudaDeviceProp properties;
    check(cudaGetDeviceProperties(&properties, index), "asking for the device's properties");
    description_ = properties.name;
    if (properties.major < kLeastMajor || (properties.major == kLeastMajor && properties.minor < kLeastMinor))
      throw Error(ErrorCode::kDevice, description_ + " has compute capability " + std::to_string(properties.major) + "." + std::to_string(properties.minor),
                  "7.5 or later is needed");
    if (!properties.memoryPoolsSupported) throw Error(ErrorCode::kDevice, description_ + " has no memory pools", "update the driver");
    cudaFuncAttributes attributes;
    check(cudaFuncGetAttributes(&attributes, run_body<LoopBegin>), "looking for code for this device: is its architecture in CMAKE_CUDA_ARCHITECTURES?");
    int driver = 0;
    check(cudaDriverGetVersion(&driver), "asking for the driver's version");
    conditional_ = driver >= kConditionalNodes;
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
    cudaDeviceSynchronize();
    lanes_.clear();
    cudaMemPoolDestroy(pool_);
  }

  const char* name() const override { return "cuda"; }
  Device device() const override { return {DeviceKind::kCuda, index_}; }
  std::string describe() const override { return description_; }

  void* allocate(size_t bytes) override {
    Lane& lane = use();
    void* storage = nullptr;
    cudaError_t status = cudaMallocFromPoolAsync(&storage, bytes, pool_, lane.stream());
    if (status == cudaErrorMemoryAllocation) {  // give back what the pool keeps, and try again
      cudaGetLastError();
      check(cudaStreamSynchronize(lane.stream()), "waiting for the device");
      cudaMemPoolTrimTo(pool_, 0);
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
      cudaFreeAsync(storage, use().stream());
    } catch (...) {
      cudaGetLastError();  // a device that has failed frees nothing
    }
  }
  std::string free_memory() override {
    size_t free = 0, all = 0;
    if (cudaMemGetInfo(&free, &all) != cudaSuccess) return "and the device does not say what is free";
    return in_gigabytes(free) + " of " + in_gigabytes(all) + " are free";
  }

  void copy_here(const void* host, void* here, size_t bytes) override { use().copy_here(host, here, bytes); }
  void copy_to_host(const void* here, void* host, size_t bytes) override { use().copy_to_host(here, host, bytes); }
  void launch(const Kernel& kernel, const void* body, uint32_t n) override {
    if (!kernel.cuda) throw Error(ErrorCode::kDevice, std::string("kernel ") + kernel.name + " has no code for CUDA in this build");
    kernel.cuda(body, n, use().stream());
    check(cudaGetLastError(), kernel.name);
  }
  void synchronise() override { check(cudaStreamSynchronize(use().stream()), "waiting for the device"); }
  std::unique_ptr<DeviceLoop> begin_loop() override { return std::make_unique<CudaLoop>(*this, conditional_); }

  // Makes the device the calling thread's, and finds the thread's lane.
  Lane& use() {
    check(cudaSetDevice(index_), "choosing the device");
    const std::lock_guard lock(mutex_);
    std::unique_ptr<Lane>& lane = lanes_[std::this_thread::get_id()];
    if (!lane) lane = std::make_unique<Lane>();
    return *lane;
  }

 private:
  int index_;
  bool conditional_ = false;
  std::string description_;
  cudaMemPool_t pool_ = nullptr;
  std::mutex mutex_;
  std::unordered_map<std::thread::id, std::unique_ptr<Lane>> lanes_;
};

CudaLoop::CudaLoop(CudaBackend& device, bool conditional) : device_(device), conditional_(conditional) {
  device_.use();
  check(cudaStreamCreateWithFlags(&capturing_, cudaStreamNonBlocking), "making a stream");
#if defined(KNEAD_CONDITIONAL_NODES)
  if (conditional_) {
    check(cudaGraphCreate(&graph_.graph(), 0), "making a graph");
    check(cudaGraphConditionalHandleCreate(&handle_, graph_.graph(), 1, cudaGraphCondAssignDefault), "making a loop");
    cudaGraphNodeParams loop{};
    loop.type = cudaGraphNodeTypeConditional;
    loop.conditional.handle = handle_;
    loop.conditional.type = cudaGraphCondTypeWhile;
    loop.conditional.size = 1;
    cudaGraphNode_t node;
#if CUDART_VERSION >= 13000
    check(cudaGraphAddNode(&node, graph_.graph(), nullptr, nullptr, 0, &loop), "making a loop");
#else
    check(cudaGraphAddNode(&node, graph_.graph(), nullptr, 0, &loop), "making a loop");
#endif
    // Relaxed: storage is allocated on the thread's own stream meanwhile, and other threads do as they like.
    check(cudaStreamBeginCaptureToGraph(capturing_, loop.conditional.phGraph_out[0], nullptr, nullptr, 0, cudaStreamCaptureModeRelaxed), "recording a loop");
    is_capturing_ = true;
    return;
  }
#endif
  check(cudaStreamBeginCapture(capturing_, cudaStreamCaptureModeRelaxed), "recording a loop");
  is_capturing_ = true;
}

CudaLoop::~CudaLoop() {
  if (is_capturing_) {
    cudaGraph_t unused = nullptr;
    cudaStreamEndCapture(capturing_, &unused);
    if (unused && !conditional_) cudaGraphDestroy(unused);
    cudaGetLastError();
  }
  if (capturing_) cudaStreamDestroy(capturing_);
}

void CudaLoop::close(const LoopEnd& end, const LoopCommit& commit, uint32_t words) {
#if defined(KNEAD_CONDITIONAL_NODES)
  if (conditional_) {
    end_round<<<1, 1, 0, capturing_>>>(end, handle_);
    check(cudaGetLastError(), "loop_end");
  } else
#endif
    launch(kernel_of<LoopEnd>(), &end, 1);
  if (words > 0) launch(kernel_of<LoopCommit>(), &commit, words);
  cudaGraph_t captured = nullptr;
  is_capturing_ = false;
  check(cudaStreamEndCapture(capturing_, &captured), "recording a loop");
  if (!conditional_) graph_.graph() = captured;
  graph_.make_ready();
  ready_ = true;
}

void CudaLoop::run(const LoopEnd& end, const LoopCommit& commit, uint32_t words) {
  const cudaStream_t stream = device_.use().stream();
  if (!ready_) close(end, commit, words);
  if (conditional_)
    graph_.launch(stream);
  else
    run_in_batches(end, stream);
}

// While a batch runs, the next is on its way already: the device does not wait for the host. Two batches too many are the price.
void CudaLoop::run_in_batches(const LoopEnd& end, cudaStream_t stream) {
  struct Look {
    LoopProgress* progress = nullptr;
    cudaEvent_t seen = nullptr;
    Look() {
      check(cudaMallocHost(reinterpret_cast<void**>(&progress), sizeof(LoopProgress)), "pinning memory");
      check(cudaEventCreateWithFlags(&seen, cudaEventDisableTiming), "making an event");
    }
    ~Look() {
      if (seen) cudaEventDestroy(seen);
      if (progress) cudaFreeHost(progress);
    }
  } looks[2];
  const auto launch = [&](Look& look) {
    for (int round = 0; round < kRoundsPerBatch; ++round) graph_.launch(stream);
    check(cudaMemcpyAsync(look.progress, end.progress, sizeof(LoopProgress), cudaMemcpyDeviceToHost, stream), "looking at a loop");
    check(cudaEventRecord(look.seen, stream), "looking at a loop");
  };
  launch(looks[0]);
  for (int batch = 1;; ++batch) {
    launch(looks[batch % 2]);
    const Look& before = looks[(batch - 1) % 2];
    check(cudaEventSynchronize(before.seen), "waiting for a loop");
    if (!before.progress->going || before.progress->left <= 0) break;
  }
  check(cudaStreamSynchronize(stream), "waiting for a loop");
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
    if (cudaGetDeviceProperties(&properties, index) != cudaSuccess) continue;
    found.names.push_back(std::string(properties.name) + ", " + in_gigabytes(properties.totalGlobalMem) + ", compute capability " +
                          std::to_string(properties.major) + "." + std::to_string(properties.minor));
  }
  return found;
}

std::unique_ptr<Executor> make_cuda_executor(int index) {
  int count = 0;
  if (const std::string missing = missing_cuda(count); !missing.empty())
    throw Error(ErrorCode::kDevice, "there is no CUDA device: " + missing, "take --device cpu");
  if (index < 0 || index >= count)
    throw Error(ErrorCode::kDevice, "there is no CUDA device " + std::to_string(index), "there are " + std::to_string(count) + ", counted from 0");
  return std::make_unique<DeviceExecutor>(std::make_unique<CudaBackend>(index));
}

}  // namespace knead
