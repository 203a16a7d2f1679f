// The CUDA executor. Kernels and their launchers are in kernels/device_bodies.cu, loops that stay on the device in cuda_loops.cu.
//
// Every thread that uses the device has a stream of its own, so that frames run side by side. Storage comes from a stream-ordered pool that keeps
// what it was given back. What a node publishes is complete (the evaluator synchronises), so buffers need no events.
#include <algorithm>
#include <cstdio>
#include <cstring>
#include <string>
#include <utility>

#include "graph/cuda_backend.cuh"
#include "graph/cuda_launch.cuh"
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

bool is_new_enough(const cudaDeviceProp& properties) {
  return properties.major > kLeastMajor || (properties.major == kLeastMajor && properties.minor >= kLeastMinor);
}

std::string in_gigabytes(size_t bytes) {
  char text[32];
  std::snprintf(text, sizeof text, "%.2f GB", static_cast<double>(bytes) / 1e9);
  return text;
}

}  // namespace

void check_cuda(cudaError_t status, const char* what) {
  if (status == cudaSuccess) return;
  cudaGetLastError();
  if (status == cudaErrorMemoryAllocation)  // CUDA's own: streams, graphs, code, the kernels' stacks
    throw Error(ErrorCode::kMemory, std::string("out of memory for CUDA itself: ") + what, "run fewer frames at once, or lower the resolution");
  throw Error(ErrorCode::kDevice, std::string("CUDA: ") + what + ": " + cudaGetErrorString(status),
              "run the frame again with --device cpu; a device that has failed serves no further frames of this run");
}

void CudaLane::open() {
  check_cuda(cudaStreamCreateWithFlags(&stream_, cudaStreamNonBlocking), "making a stream");
  for (Staging& one : staging_) {
    check_cuda(cudaMallocHost(&one.memory, kStagingBytes), "pinning memory for transfers");
    check_cuda(cudaEventCreateWithFlags(&one.done, cudaEventDisableTiming), "making an event");
  }
}

CudaLane::~CudaLane() {
  for (Staging& one : staging_) {
    if (one.done) cudaEventDestroy(one.done);
    if (one.memory) cudaFreeHost(one.memory);
  }
  if (stream_) cudaStreamDestroy(stream_);
}

// In pieces: one is filled while the other is on its way.
void CudaLane::copy_here(const void* host, void* here, size_t bytes) {
  for (size_t at = 0, piece = 0; at < bytes; at += kStagingBytes, ++piece) {
    Staging& one = staging_[piece % 2];
    const size_t size = std::min(kStagingBytes, bytes - at);
    check_cuda(cudaEventSynchronize(one.done), "waiting for a transfer");
    std::memcpy(one.memory, static_cast<const char*>(host) + at, size);
    check_cuda(cudaMemcpyAsync(static_cast<char*>(here) + at, one.memory, size, cudaMemcpyHostToDevice, stream_), "a transfer to the device");
    check_cuda(cudaEventRecord(one.done, stream_), "a transfer to the device");
  }
}

void CudaLane::copy_to_host(const void* here, void* host, size_t bytes) {
  const size_t pieces = (bytes + kStagingBytes - 1) / kStagingBytes;
  const auto size_of = [&](size_t piece) { return std::min(kStagingBytes, bytes - piece * kStagingBytes); };
  for (size_t piece = 0; piece <= pieces; ++piece) {
    if (piece < pieces) {
      Staging& one = staging_[piece % 2];
      check_cuda(cudaEventSynchronize(one.done), "waiting for a transfer");
      check_cuda(cudaMemcpyAsync(one.memory, static_cast<const char*>(here) + piece * kStagingBytes, size_of(piece), cudaMemcpyDeviceToHost, stream_),
                 "a transfer to the host");
      check_cuda(cudaEventRecord(one.done, stream_), "a transfer to the host");
    }
    if (piece > 0) {
      Staging& before = staging_[(piece - 1) % 2];
      check_cuda(cudaEventSynchronize(before.done), "waiting for a transfer");
      std::memcpy(static_cast<char*>(host) + (piece - 1) * kStagingBytes, before.memory, size_of(piece - 1));
    }
  }
}

CudaBackend::CudaBackend(int index, bool graph_loops) : index_(index) {
  use();
  cudaDeviceProp properties;
  check_cuda(cudaGetDeviceProperties(&properties, index), "asking for the device's properties");
  description_ = properties.name;
  if (!is_new_enough(properties))
    throw Error(ErrorCode::kDevice,
                description_ + " has compute capability " + std::to_string(properties.major) + "." + std::to_string(properties.minor),
                "7.5 or later is needed");
  if (!properties.memoryPoolsSupported) throw Error(ErrorCode::kDevice, description_ + " has no memory pools", "update the driver");
  cudaFuncAttributes attributes;
  check_cuda(cudaFuncGetAttributes(&attributes, run_body<LoopBegin>),
             "looking for code for this device: is its architecture in CMAKE_CUDA_ARCHITECTURES?");
  total_ = properties.totalGlobalMem;
  int driver = 0;
  check_cuda(cudaDriverGetVersion(&driver), "asking for the driver's version");
  conditional_ = graph_loops && driver >= kConditionalNodes;
  cudaMemPoolProps wanted{};
  wanted.allocType = cudaMemAllocationTypePinned;
  wanted.location.type = cudaMemLocationTypeDevice;
  wanted.location.id = index;
  check_cuda(cudaMemPoolCreate(&pool_, &wanted), "making a memory pool");
  uint64_t keep_all = UINT64_MAX;
  check_cuda(cudaMemPoolSetAttribute(pool_, cudaMemPoolAttrReleaseThreshold, &keep_all), "setting up the memory pool");
}

CudaBackend::~CudaBackend() {
  if (cudaSetDevice(index_) != cudaSuccess) return;  // the process is ending, and CUDA is gone
  // Stream by stream: waiting for the device as a whole would end what others in the process are recording.
  for (const auto& [thread, lane] : lanes_)
    if (lane) cudaStreamSynchronize(lane->stream());
  for (const auto& lane : idle_) cudaStreamSynchronize(lane->stream());
  lanes_.clear();
  idle_.clear();
  cudaMemPoolDestroy(pool_);
}

void* CudaBackend::allocate(size_t bytes) {
  if (bytes > total_) return nullptr;  // what CUDA calls a size beyond its address space is not said
  CudaLane& lane = use();
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
  check_cuda(status, "allocating memory");
  return storage;
}

void CudaBackend::release(void* storage) noexcept {
  try {
    if (cudaFreeAsync(storage, use().stream()) != cudaSuccess) cudaGetLastError();  // else the next launch would be blamed for it
  } catch (...) {
    cudaGetLastError();  // a device that has failed frees nothing
  }
}

std::string CudaBackend::free_memory() {
  size_t free = 0, all = 0;
  if (cudaMemGetInfo(&free, &all) != cudaSuccess) {
    cudaGetLastError();
    return "and the device does not say what is free";
  }
  return in_gigabytes(free) + " of " + in_gigabytes(all) + " are free";
}

void CudaBackend::launch(const Kernel& kernel, const void* body, uint32_t n) {
  if (!kernel.cuda.one) throw Error(ErrorCode::kDevice, std::string("kernel ") + kernel.name + " has no code for CUDA in this build");
  CudaLane& lane = use();
  kernel.cuda.one(body, n, lane.stream());
  cudaError_t status = cudaGetLastError();
  if (status == cudaErrorMemoryAllocation) {  // for its code or its stack, on its first launch
    trim(lane);
    kernel.cuda.one(body, n, lane.stream());
    status = cudaGetLastError();
  }
  check_cuda(status, kernel.name);
}

CudaLane& CudaBackend::use() {
  check_cuda(cudaSetDevice(index_), "choosing the device");
  const std::lock_guard lock(mutex_);
  std::unique_ptr<CudaLane>& lane = lanes_[std::this_thread::get_id()];
  if (!lane && !idle_.empty()) {
    lane = std::move(idle_.back());
    idle_.pop_back();
  }
  if (!lane) {
    auto made = std::make_unique<CudaLane>();
    made->open();
    lane = std::move(made);
  }
  return *lane;
}

void CudaBackend::thread_ends() {
  const std::lock_guard lock(mutex_);
  const auto mine = lanes_.find(std::this_thread::get_id());
  if (mine == lanes_.end()) return;
  idle_.push_back(std::move(mine->second));
  lanes_.erase(mine);
}

void CudaBackend::trim(CudaLane& lane) {
  cudaGetLastError();
  check_cuda(cudaStreamSynchronize(lane.stream()), "waiting for the device");
  if (cudaMemPoolTrimTo(pool_, 0) != cudaSuccess) cudaGetLastError();
}

namespace {

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
