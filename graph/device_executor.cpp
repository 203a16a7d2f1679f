#include "graph/device_executor.h"

#include "graph/error.h"

namespace knead {

// The executor of a round that is recorded.
class DeviceLoopRecorder final : public LoopRecorder {
 public:
  explicit DeviceLoopRecorder(DeviceExecutor& executor)
      : executor_(executor), memory_(executor.memory()), loop_(executor.backend_->begin_loop()) {}

  const char* name() const override { return executor_.name(); }
  Device device() const override { return executor_.device(); }
  MemoryResource& memory() override { return memory_; }
  void parallel_ranges(size_t n, size_t grain, FunctionRef<void(size_t, size_t)> range) override { executor_.parallel_ranges(n, grain, range); }
  void run_graph(const std::vector<std::vector<int>>& successors, const std::vector<int>& waits_for, FunctionRef<void(int)> task) override {
    executor_.run_graph(successors, waits_for, task);
  }
  void copy(const void*, Device, void*, Device, size_t) override { give_up("a transfer"); }
  void synchronise() override { give_up("waiting for the device"); }
  using Executor::launch;
  void launch(const Kernel& kernel, const void* body, uint32_t n) override {
    ++executor_.recorded_;
    loop_->launch(kernel, body, n);
  }

  LoopProgress run(const LoopEnd& end, const LoopCommit& commit, size_t words, int rounds) override {
    ++executor_.loops_;
    executor_.launch(LoopGo{end.progress, rounds}, 1);
    loop_->run(end, commit, static_cast<uint32_t>(words));
    LoopProgress progress;
    executor_.copy(end.progress, device(), &progress, Device{}, sizeof progress);
    executor_.synchronise();
    return progress;
  }

 private:
  DeviceExecutor& executor_;
  LoopMemory memory_;
  std::unique_ptr<DeviceLoop> loop_;
};

void DeviceExecutor::parallel_ranges(size_t, size_t, FunctionRef<void(size_t, size_t)>) {
  throw Error(ErrorCode::kDevice, std::string("a loop of the host cannot run on ") + device().text(), "give the kernel a body (graph/device_code.h)");
}
void DeviceExecutor::run_graph(const std::vector<std::vector<int>>&, const std::vector<int>&, FunctionRef<void(int)>) {
  throw Error(ErrorCode::kDevice, device().text() + " cannot schedule nodes", "pass the evaluator a host executor too");
}

void DeviceExecutor::copy(const void* from, Device from_device, void* to, Device to_device, size_t bytes) {
  const bool here = from_device == Device{} && to_device == device(), there = from_device == device() && to_device == Device{};
  if (!here && !there) throw Error(ErrorCode::kDevice, std::string(name()) + " cannot copy from " + from_device.text() + " to " + to_device.text());
  ++copies_;
  copied_bytes_ += bytes;
  if (bytes == 0) return;
  if (here)
    backend_->copy_here(from, to, bytes);
  else
    backend_->copy_to_host(from, to, bytes);
}

void DeviceExecutor::launch(const Kernel& kernel, const void* body, uint32_t n) {
  ++launches_;
  backend_->launch(kernel, body, n);
}

std::unique_ptr<LoopRecorder> DeviceExecutor::record_loop() {
  return std::make_unique<DeviceLoopRecorder>(*this);
}

void* DeviceExecutor::allocate(size_t bytes) {
  void* storage = backend_->allocate(bytes);
  if (!storage)
    throw Error(ErrorCode::kMemory,
                "out of memory on " + device().text() + " (" + backend_->describe() + "): " + std::to_string(bytes) + " bytes were asked for, " +
                    backend_->free_memory(),
                "lower the resolution, or take --device cpu");
  ++allocations_;
  const size_t now = bytes_ += bytes;
  for (size_t most = most_bytes_; most < now && !most_bytes_.compare_exchange_weak(most, now);) {
  }
  return storage;
}
void DeviceExecutor::release(void* storage, size_t bytes) noexcept {
  bytes_ -= bytes;
  backend_->release(storage);
}

DeviceFigures DeviceExecutor::figures() const {
  DeviceFigures figures{allocations_, copies_, copied_bytes_, launches_, loops_, recorded_, bytes_, most_bytes_};
  return figures;
}

}  // namespace knead
