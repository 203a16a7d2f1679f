#include "graph/executor.h"

#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>
#include <oneapi/tbb/task_group.h>

#include <algorithm>
#include <atomic>
#include <cstring>
#include <queue>

#include "graph/cancel.h"
#include "graph/error.h"
#include "graph/loop.h"

namespace knead {
namespace {

class HostExecutor : public Executor {
 public:
  Device device() const override { return {}; }
  MemoryResource& memory() override { return host_memory(); }
  void copy(const void* from, Device from_device, void* to, Device to_device, size_t bytes) override {
    if (from_device != Device{} || to_device != Device{})
      throw Error(ErrorCode::kDevice, std::string("the ") + name() + " executor sees host memory only");
    if (bytes > 0) std::memcpy(to, from, bytes);
  }

 protected:
  static void in_order(size_t n, size_t grain, FunctionRef<void(size_t, size_t)> range) {
    for (size_t begin = 0; begin < n; begin += grain) {
      if (n > grain) check_cancelled();
      range(begin, std::min(n, begin + grain));
    }
  }
};

class SerialExecutor : public HostExecutor {
 public:
  const char* name() const override { return "serial"; }

  void parallel_ranges(size_t n, size_t grain, FunctionRef<void(size_t, size_t)> range) override {
    grain = std::max<size_t>(grain, 1);
    in_order(n, grain, range);
  }

  void run_graph(const std::vector<std::vector<int>>& successors, const std::vector<int>& waits_for, FunctionRef<void(int)> task) override {
    std::vector<int> left = waits_for;
    std::queue<int> ready;
    for (size_t i = 0; i < left.size(); ++i)
      if (left[i] == 0) ready.push(static_cast<int>(i));
    for (; !ready.empty(); ready.pop()) {
      task(ready.front());
      for (const int next : successors[static_cast<size_t>(ready.front())])
        if (--left[static_cast<size_t>(next)] == 0) ready.push(next);
    }
  }
};

// Inner loops are isolated: a thread that waits for its own loop must not pick up another frame or node meanwhile, which could wait for the very
// result that this thread is making, and would hold twice the memory.
class CpuExecutor : public HostExecutor {
 public:
  explicit CpuExecutor(int threads) : arena_(threads_of(threads)) { arena_.initialize(); }
  const char* name() const override { return "cpu"; }
  int threads() const override { return arena_.max_concurrency(); }

  void parallel_ranges(size_t n, size_t grain, FunctionRef<void(size_t, size_t)> range) override {
    grain = std::max<size_t>(grain, 1);
    if (n <= grain || arena_.max_concurrency() == 1) {
      in_order(n, grain, range);
      return;
    }
    const Cancellation* cancellation = current_cancellation();
    arena_.execute([&] {
      tbb::this_task_arena::isolate([&] {
        const size_t pieces = (n + grain - 1) / grain;
        tbb::parallel_for(size_t{0}, pieces, [&](size_t piece) {
          const CancellationScope scope(cancellation);
          check_cancelled();
          range(piece * grain, std::min(n, (piece + 1) * grain));
        });
      });
    });
  }

  void run_graph(const std::vector<std::vector<int>>& successors, const std::vector<int>& waits_for, FunctionRef<void(int)> task) override {
    std::vector<std::atomic<int>> left(waits_for.size());
    for (size_t i = 0; i < left.size(); ++i) left[i].store(waits_for[i], std::memory_order_relaxed);
    arena_.execute([&] {
      tbb::task_group group;
      const auto run = [&](auto& self, int i) -> void {
        tbb::this_task_arena::isolate([&] { task(i); });
        for (const int next : successors[static_cast<size_t>(i)])
          if (left[static_cast<size_t>(next)].fetch_sub(1, std::memory_order_acq_rel) == 1) group.run([&self, next] { self(self, next); });
      };
      for (size_t i = 0; i < waits_for.size(); ++i)
        if (waits_for[i] == 0) group.run([&run, i] { run(run, static_cast<int>(i)); });
      group.wait();
    });
  }

 private:
  // No more than the machine has, or the host application allows: TBB would write a warning to stderr.
  static int threads_of(int asked) {
    const auto most = static_cast<int>(tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism));
    return asked > 0 ? std::min(asked, most) : most;
  }
  tbb::task_arena arena_;
};

}  // namespace

void Executor::launch(const Kernel& kernel, const void*, uint32_t) {
  throw Error(ErrorCode::kDevice, std::string("kernel ") + kernel.name + " was launched on the " + name() + " executor, which is no device");
}
std::unique_ptr<LoopRecorder> Executor::record_loop() {
  return nullptr;
}

std::unique_ptr<Executor> make_serial_executor() {
  return std::make_unique<SerialExecutor>();
}
std::unique_ptr<Executor> make_cpu_executor(int threads) {
  return std::make_unique<CpuExecutor>(threads);
}

}  // namespace knead
