// Where kernels run. An executor is a device, its memory and a parallel loop; kernels (kernels/parallel.h) are written against it once.
#pragma once
#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "graph/buffer.h"

namespace knead {

// A borrowed callable: no allocation, valid for the call only.
template <class>
class FunctionRef;
template <class R, class... A>
class FunctionRef<R(A...)> {
 public:
  template <class F>
  FunctionRef(const F& f) : object_(&f), call_([](const void* o, A... a) -> R { return (*static_cast<const F*>(o))(a...); }) {}
  R operator()(A... a) const { return call_(object_, a...); }

 private:
  const void* object_;
  R (*call_)(const void*, A...);
};

class Executor {
 public:
  virtual ~Executor() = default;
  virtual const char* name() const = 0;  // "serial", "cpu", "cuda"
  virtual Device device() const = 0;
  virtual int threads() const { return 1; }
  virtual MemoryResource& memory() = 0;

  // Calls range(begin, end) over [0, n) in pieces of `grain`, in any order, perhaps at once. The pieces depend on n and grain alone, never on the
  // number of threads, so that a reduction over them is the same bits everywhere. Exceptions come out on the calling thread. Host executors only.
  virtual void parallel_ranges(size_t n, size_t grain, FunctionRef<void(size_t begin, size_t end)> range) = 0;

  // Runs task(i) for every i once all of its predecessors have run: `successors[i]` and `waits_for[i]` describe the graph. Independent tasks run at
  // once.
  virtual void run_graph(const std::vector<std::vector<int>>& successors, const std::vector<int>& waits_for, FunctionRef<void(int)> task) = 0;

  // Copies bytes between devices; both ends must be the host or this executor's device. Only the scheduler calls it.
  virtual void copy(const void* from, Device from_device, void* to, Device to_device, size_t bytes) = 0;
  virtual void synchronise() {}
};

// One thread, in order: the debugger.
std::unique_ptr<Executor> make_serial_executor();

// TBB in an arena of its own with `threads` threads (0, or more than the machine has: all of them), isolated from the host application's tasks.
std::unique_ptr<Executor> make_cpu_executor(int threads = 0);

}  // namespace knead
