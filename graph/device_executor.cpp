#include "graph/device_executor.h"

#include <algorithm>
#include <cstring>

#include "graph/error.h"

namespace knead {
namespace {

thread_local const DeviceExecutor* frames_for = nullptr;  // the device that this thread gives frames to

}  // namespace

bool RecordedLoop::is_like(const RecordedLoop& other) const {
  return words == other.words && std::equal(steps.begin(), steps.end(), other.steps.begin(), other.steps.end(),
                                            [](const Step& a, const Step& b) { return a.kernel == b.kernel && a.n == b.n; });
}

// The executor of a round that is recorded.
class DeviceLoopRecorder final : public LoopRecorder {
 public:
  explicit DeviceLoopRecorder(DeviceExecutor& executor) : executor_(executor), memory_(executor.memory()) {}

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
    const auto* bytes = static_cast<const char*>(body);
    loop_.steps.push_back({&kernel, n, std::vector<char>(bytes, bytes + kernel.body_bytes)});
  }

  LoopProgress run(const LoopEnd& end, const LoopCommit& commit, size_t words, int rounds) override {
    ++executor_.loops_;
    executor_.launch(LoopGo{end.progress, rounds}, 1);
    loop_.end = end;
    loop_.commit = commit;
    loop_.words = static_cast<uint32_t>(words);
    executor_.run(loop_);
    LoopProgress progress;
    executor_.copy(end.progress, device(), &progress, Device{}, sizeof progress);
    executor_.synchronise();
    return progress;
  }

 private:
  DeviceExecutor& executor_;
  LoopMemory memory_;
  RecordedLoop loop_;
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
  if (bytes == 0) return;
  ++copies_;
  copied_bytes_ += bytes;
  if (here)
    backend_->copy_here(from, to, bytes);
  else
    backend_->copy_to_host(from, to, bytes);
}

void DeviceExecutor::launch(const Kernel& kernel, const void* body, uint32_t n) {
  ++launches_;
  backend_->launch(kernel, body, n);
}

void DeviceExecutor::begin_frames() {
  const std::lock_guard lock(mutex_);
  frames_for = this;
  ++with_frames_;
}
void DeviceExecutor::end_frames() {
  backend_->thread_ends();
  const std::lock_guard lock(mutex_);
  frames_for = nullptr;
  --with_frames_;
  changed_.notify_all();
}

void DeviceExecutor::between_frames(bool between) {
  frames_for = between ? nullptr : this;
}

void DeviceExecutor::run(const RecordedLoop& loop) {
  backend_->synchronise();  // what it reads may be on its way, and another thread may run it
  if (frames_for != this) {
    loop_launches_ += static_cast<uint64_t>(backend_->run_loops({&loop}));
    return;
  }
  Waiting mine{&loop, false, false, {}};
  std::unique_lock lock(mutex_);
  waiting_.push_back(&mine);
  for (;;) {
    changed_.wait(lock, [&] { return mine.done || (!mine.taken && !leading_ && waiting_.size() == with_frames_); });
    if (mine.done) break;
    leading_ = true;
    const std::vector<Waiting*> all = waiting_;
    for (Waiting* one : all) one->taken = true;
    lock.unlock();
    try {
      run_together(all);
    } catch (...) {
      for (Waiting* one : all) one->error = std::current_exception();
    }
    lock.lock();
    leading_ = false;
    std::erase_if(waiting_, [](const Waiting* one) { return one->taken; });
    for (Waiting* one : all) one->done = true;
    changed_.notify_all();
  }
  if (mine.error) std::rethrow_exception(mine.error);
}

void DeviceExecutor::run_together(const std::vector<Waiting*>& all) {
  std::vector<Waiting*> left = all;
  while (!left.empty()) {
    std::vector<const RecordedLoop*> alike;
    std::vector<Waiting*> group;
    for (Waiting* one : left)
      if (one->loop->is_like(*left.front()->loop)) group.push_back(one), alike.push_back(one->loop);
    std::erase_if(left, [&](Waiting* one) { return std::find(group.begin(), group.end(), one) != group.end(); });
    if (group.size() > 1) joined_ += group.size();
    try {
      loop_launches_ += static_cast<uint64_t>(backend_->run_loops(alike));
    } catch (...) {
      for (Waiting* one : group) one->error = std::current_exception();
    }
  }
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
  return {allocations_, copies_, copied_bytes_, launches_, loops_, recorded_, joined_, loop_launches_, bytes_, most_bytes_};
}

}  // namespace knead
