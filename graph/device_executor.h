// Internal: what executors of devices have in common: counting, errors, and loops that stay on the device. What differs is a DeviceBackend: CUDA's,
// and in tests one that is host memory which the host may not touch.
#pragma once
#include <atomic>
#include <condition_variable>
#include <exception>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "graph/loop.h"

namespace knead {

// One round of a loop: the steps in their order, then `end`, then `commit`.
struct RecordedLoop {
  struct Step {
    const Kernel* kernel;
    uint32_t n;
    std::vector<char> body;
  };
  std::vector<Step> steps;
  LoopEnd end{};
  LoopCommit commit{};
  uint32_t words = 0;  // indices of `commit`

  // The same kernels over the same numbers of indices: loops of one body in several frames.
  bool is_like(const RecordedLoop& other) const;
};

// Calls that are ordered: each thread's own, one after the other.
class DeviceBackend {
 public:
  virtual ~DeviceBackend() = default;
  virtual const char* name() const = 0;
  virtual Device device() const = 0;
  virtual std::string describe() const = 0;
  virtual void* allocate(size_t bytes) = 0;  // null when there is too little
  virtual void release(void* storage) noexcept = 0;
  virtual std::string free_memory() = 0;  // for people
  virtual void copy_here(const void* host, void* here, size_t bytes) = 0;
  virtual void copy_to_host(const void* here, void* host, size_t bytes) = 0;  // may be used once synchronised
  virtual void launch(const Kernel& kernel, const void* body, uint32_t n) = 0;
  virtual void synchronise() = 0;
  virtual void thread_ends() {}  // the calling thread needs the device no more
  // Runs loops that are alike, round by round, each while its end.running(), and waits. What they read must be complete. Returns how often the host
  // had to start something: once where the device goes on by itself.
  virtual int run_loops(const std::vector<const RecordedLoop*>& loops) = 0;
};

struct DeviceFigures {
  uint64_t allocations = 0, copies = 0, copied_bytes = 0, launches = 0, loops = 0, recorded = 0;
  uint64_t joined = 0;               // loops that were run together with others
  uint64_t loop_launches = 0;        // what the host has started for loops: once for all that run together, where the device goes on by itself
  size_t bytes = 0, most_bytes = 0;  // allocated now, and at most
};

class DeviceExecutor final : public Executor, private MemoryResource {
 public:
  explicit DeviceExecutor(std::unique_ptr<DeviceBackend> backend) : backend_(std::move(backend)) {}

  const char* name() const override { return backend_->name(); }
  Device device() const override { return backend_->device(); }
  MemoryResource& memory() override { return *this; }
  void parallel_ranges(size_t n, size_t grain, FunctionRef<void(size_t, size_t)> range) override;
  void run_graph(const std::vector<std::vector<int>>&, const std::vector<int>&, FunctionRef<void(int)>) override;
  void copy(const void* from, Device from_device, void* to, Device to_device, size_t bytes) override;
  void synchronise() override { backend_->synchronise(); }
  using Executor::launch;
  void launch(const Kernel& kernel, const void* body, uint32_t n) override;
  int frames_at_once() const override { return kFramesAtOnce; }
  void begin_frames() override;
  void end_frames() override;
  void between_frames(bool between) override;
  std::unique_ptr<LoopRecorder> record_loop() override;

  Transfers transfers() const override { return {copies_, copied_bytes_}; }
  DeviceFigures figures() const;
  DeviceBackend& backend() { return *backend_; }

 private:
  friend class DeviceLoopRecorder;
  void* allocate(size_t bytes) override;
  void release(void* storage, size_t bytes) noexcept override;

  // Threads with frames bring their loops here. When each of them waits, one runs all.
  struct Waiting {
    const RecordedLoop* loop;
    bool taken = false, done = false;
    std::exception_ptr error;
  };
  void run(const RecordedLoop& loop);
  void run_together(const std::vector<Waiting*>& all);

  static constexpr int kFramesAtOnce = 32;
  std::unique_ptr<DeviceBackend> backend_;
  std::mutex mutex_;
  std::condition_variable changed_;
  size_t with_frames_ = 0;  // threads
  bool leading_ = false;
  std::vector<Waiting*> waiting_;
  std::atomic<uint64_t> allocations_{0}, copies_{0}, copied_bytes_{0}, launches_{0}, loops_{0}, recorded_{0}, joined_{0}, loop_launches_{0};
  std::atomic<size_t> bytes_{0}, most_bytes_{0};
};

}  // namespace knead
