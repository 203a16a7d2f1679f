// A device that is host memory which the host may not touch: pages are closed except while a kernel or a copy runs. What would break on a real device
// breaks here: the host reading device memory (the process gets SIGSEGV), a kernel that is given host memory, a result that is read before it has
// come, storage that is read before it was written (it is full of NaNs), more memory than there is.
#pragma once
#include <sys/mman.h>

#include <algorithm>
#include <cstring>
#include <map>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "graph/device_executor.h"
#include "graph/error.h"

namespace knead {
namespace fake_device {

class FakeBackend final : public DeviceBackend {
 public:
  // `batch`: rounds of a loop that are run before the device is asked whether they were needed; 0: it stops by itself.
  explicit FakeBackend(size_t capacity = kReserved, int batch = 0) : capacity_(capacity), batch_(batch) {
    void* reserved = mmap(nullptr, kReserved, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    if (reserved == MAP_FAILED) throw Error(ErrorCode::kMemory, "no address space for the fake device");
    base_ = static_cast<char*>(reserved);
  }
  ~FakeBackend() override { munmap(base_, kReserved); }

  const char* name() const override { return "fake"; }
  Device device() const override { return {DeviceKind::kFake, 0}; }
  std::string describe() const override { return "host memory"; }

  void* allocate(size_t bytes) override {
    const std::lock_guard lock(mutex_);
    const size_t rounded = (bytes + kAlignment - 1) / kAlignment * kAlignment;
    char* storage = nullptr;
    if (const auto kept = free_.find(rounded); kept != free_.end()) {
      storage = kept->second;
      free_.erase(kept);
    } else if (used_ + rounded <= capacity_) {
      storage = base_ + used_;
      used_ += rounded;
    } else {
      return nullptr;
    }
    sizes_[storage] = rounded;
    const Open open(*this);
    std::memset(storage, 0xff, rounded);
    return storage;
  }
  void release(void* storage) noexcept override {
    const std::lock_guard lock(mutex_);
    const auto known = sizes_.find(static_cast<char*>(storage));
    free_.emplace(known->second, known->first);
    sizes_.erase(known);
  }
  std::string free_memory() override { return std::to_string(capacity_ - used_) + " of " + std::to_string(capacity_) + " bytes are free"; }

  void copy_here(const void* host, void* here, size_t bytes) override {
    const std::lock_guard lock(mutex_);
    count(bytes);
    const Open open(*this);
    std::memcpy(here, host, bytes);
  }
  void copy_to_host(const void* here, void* host, size_t bytes) override {
    const std::lock_guard lock(mutex_);
    count(bytes);
    const Open open(*this);
    coming_.push_back({host, std::vector<char>(static_cast<const char*>(here), static_cast<const char*>(here) + bytes)});
  }
  void synchronise() override {
    const std::lock_guard lock(mutex_);
    for (const auto& [host, bytes] : coming_) std::memcpy(host, bytes.data(), bytes.size());
    coming_.clear();
  }
  void launch(const Kernel& kernel, const void* body, uint32_t n) override {
    check(kernel, body);
    const std::lock_guard lock(mutex_);
    const Open open(*this);
    kernel.host(body, n);
  }
  int run_loops(const std::vector<const RecordedLoop*>& loops) override {
    const std::lock_guard lock(mutex_);
    const Open open(*this);
    for (const RecordedLoop* loop : loops)
      for (const RecordedLoop::Step& step : loop->steps) check(*step.kernel, step.body.data());
    bool running = true;
    int launches = 0;
    while (running) {
      launches += std::max(1, batch_);
      for (int round = 0; round < std::max(1, batch_); ++round) {
        for (const RecordedLoop* loop : loops) {
          for (const RecordedLoop::Step& step : loop->steps) step.kernel->host(step.body.data(), step.n);
          loop->end(0);
          kernel_of<LoopCommit>().host(&loop->commit, loop->words);
        }
        ++rounds_run;
      }
      running = false;
      for (const RecordedLoop* loop : loops) running = running || loop->end.running();
    }
    return batch_ == 0 ? 1 : launches;
  }

  int rounds_run = 0;   // of loops, needed or not
  Transfers transfers;  // as they came

 private:
  void count(size_t bytes) {
    ++transfers.count;
    transfers.bytes += bytes;
  }

  static constexpr size_t kReserved = size_t{4} << 30, kAlignment = 256;

  // The device at work: its memory may be touched.
  class Open {
   public:
    explicit Open(FakeBackend& device) : device_(device), bytes_(device.used_) {
      if (device_.open_++ == 0 && bytes_ > 0) mprotect(device_.base_, bytes_, PROT_READ | PROT_WRITE);
    }
    ~Open() {
      if (--device_.open_ == 0 && bytes_ > 0) mprotect(device_.base_, bytes_, PROT_NONE);
    }

   private:
    FakeBackend& device_;
    size_t bytes_;
  };

  // A word of the body that is an address, and not one of the device's: something of the host. A small number beside padding may look like an address
  // too; and under AddressSanitizer, whose shadow is mapped nearly everywhere, any number may: there it is not looked for.
  void check([[maybe_unused]] const Kernel& kernel, [[maybe_unused]] const void* body) const {
#if !defined(__SANITIZE_ADDRESS__)
    for (size_t at = 0; at + 8 <= kernel.body_bytes; at += 8) {
      uintptr_t word;
      std::memcpy(&word, static_cast<const char*>(body) + at, sizeof word);
      const bool here = word >= reinterpret_cast<uintptr_t>(base_) && word < reinterpret_cast<uintptr_t>(base_) + kReserved;
      if (here || (word & 0xffffffffu) < (uintptr_t{1} << 20) || word >= (uintptr_t{1} << 47)) continue;
      if (msync(reinterpret_cast<void*>(word & ~uintptr_t{4095}), 1, MS_ASYNC) == 0)
        throw Error(ErrorCode::kDevice, std::string("kernel ") + kernel.name + " was given memory of the host");
    }
#endif
  }

  char* base_ = nullptr;
  size_t capacity_, used_ = 0;
  int batch_;
  int open_ = 0;
  std::recursive_mutex mutex_;
  std::map<char*, size_t> sizes_;
  std::multimap<size_t, char*> free_;
  std::vector<std::pair<void*, std::vector<char>>> coming_;
};

struct FakeDevice {
  explicit FakeDevice(size_t capacity = size_t{4} << 30, int batch = 0) : FakeDevice(new FakeBackend(capacity, batch)) {}
  FakeBackend& backend;
  DeviceExecutor executor;

 private:
  explicit FakeDevice(FakeBackend* made) : backend(*made), executor(std::unique_ptr<DeviceBackend>(made)) {}
};

}  // namespace fake_device
}  // namespace knead
