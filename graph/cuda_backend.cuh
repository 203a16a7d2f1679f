// Internal, for the two files that talk to CUDA's runtime: cuda_executor.cu, where a device and its threads are, and cuda_loops.cu.
#pragma once
#include <atomic>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <unordered_map>
#include <vector>

#include "graph/device_executor.h"

namespace knead {

void check_cuda(cudaError_t status, const char* what);  // throws Error

// A thread's way to the device. What `open` has made when it fails goes with the lane.
class CudaLane {
 public:
  CudaLane() = default;
  CudaLane(const CudaLane&) = delete;
  CudaLane& operator=(const CudaLane&) = delete;
  void open();
  ~CudaLane();
  cudaStream_t stream() const { return stream_; }

  // Through pinned memory.
  void copy_here(const void* host, void* here, size_t bytes);
  void copy_to_host(const void* here, void* host, size_t bytes);

 private:
  static constexpr size_t kStagingBytes = size_t{1} << 20;
  struct Staging {
    void* memory = nullptr;
    cudaEvent_t done = nullptr;  // the last transfer through it
  };
  cudaStream_t stream_ = nullptr;
  Staging staging_[2];
};

class CudaBackend final : public DeviceBackend {
 public:
  CudaBackend(int index, bool graph_loops);
  ~CudaBackend() override;

  const char* name() const override { return "cuda"; }
  Device device() const override { return {DeviceKind::kCuda, index_}; }
  std::string describe() const override { return description_; }

  void* allocate(size_t bytes) override;
  void release(void* storage) noexcept override;
  std::string free_memory() override;

  void copy_here(const void* host, void* here, size_t bytes) override { use().copy_here(host, here, bytes); }
  void copy_to_host(const void* here, void* host, size_t bytes) override { use().copy_to_host(here, host, bytes); }
  void launch(const Kernel& kernel, const void* body, uint32_t n) override;
  void synchronise() override { check_cuda(cudaStreamSynchronize(use().stream()), "waiting for the device"); }
  int run_loops(const std::vector<const RecordedLoop*>& loops) override;

  // Makes the device the calling thread's, and finds the thread's lane.
  CudaLane& use();
  void thread_ends() override;

 private:
  // Gives back what the pool keeps, for another try.
  void trim(CudaLane& lane);

  int index_;
  std::atomic<bool> conditional_{false};
  size_t total_ = 0;
  std::string description_;
  cudaMemPool_t pool_ = nullptr;
  std::mutex mutex_;
  std::unordered_map<std::thread::id, std::unique_ptr<CudaLane>> lanes_;
  std::vector<std::unique_ptr<CudaLane>> idle_;  // of threads that have ended
};

}  // namespace knead
