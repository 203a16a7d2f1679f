// Where kernels run. An executor is a device, its memory and a parallel loop; kernels (kernels/parallel.h) are written against it once.
#pragma once
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "graph/buffer.h"
#include "graph/device_code.h"

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

class LoopRecorder;

struct Transfers {
  uint64_t count = 0, bytes = 0;
};

class KNEAD_API Executor {
 public:
  virtual ~Executor() = default;
  virtual const char* name() const = 0;  // "serial", "cpu", "cuda"
  virtual Device device() const = 0;
  virtual int threads() const { return 1; }
  virtual MemoryResource& memory() = 0;

  // Calls range(begin, end) over [0, n) in pieces of `grain`, in any order, perhaps at once. The pieces depend on n and grain alone, never on the
  // number of threads, so that a reduction over them is the same bits everywhere. Exceptions come out on the calling thread, and Error(kCancelled) between
  // two pieces (graph/cancel.h). Host executors only.
  virtual void parallel_ranges(size_t n, size_t grain, FunctionRef<void(size_t begin, size_t end)> range) = 0;

  // Runs task(i) for every i once all of its predecessors have run: `successors[i]` and `waits_for[i]` describe the graph. Independent tasks run at
  // once.
  virtual void run_graph(const std::vector<std::vector<int>>& successors, const std::vector<int>& waits_for, FunctionRef<void(int)> task) = 0;

  // Copies bytes between devices; both ends must be the host or this executor's device. The evaluator calls it to move buffers, and kernels for
  // tables of their own and for figures to decide by.
  virtual void copy(const void* from, Device from_device, void* to, Device to_device, size_t bytes) = 0;
  virtual Transfers transfers() const { return {}; }  // all copies so far between the host and a device; none on the host
  virtual void synchronise() {}

  // Devices only: runs a kernel's body over [0, n), after everything that this thread has launched here before, and returns before it has ended. The
  // body is copied.
  virtual void launch(const Kernel& kernel, const void* body, uint32_t n);
  template <DeviceBody Body>
  void launch(const Body& body, size_t n) {
    if (n > 0) launch(kernel_of<Body>(), &body, static_cast<uint32_t>(n));
  }

  // How many frames it likes to be given at once, each by a thread of its own, so that it can run their loops as one; 1: no more than there are
  // threads. Such a thread says when it begins and when it has no further frame.
  virtual int frames_at_once() const { return 1; }
  virtual void begin_frames() {}
  virtual void end_frames() {}
  // What it does between frames is its own: loops of that are not run together with those of frames, which may be waiting for this thread.
  virtual void between_frames(bool) {}

  // An executor for one round of a loop, which it records to run it many times without the host (graph/loop.h). Null where loops run from the host.
  virtual std::unique_ptr<LoopRecorder> record_loop();
};

// One thread, in order: the debugger.
KNEAD_API std::unique_ptr<Executor> make_serial_executor();

// TBB in an arena of its own with `threads` threads (0, or more than the machine has: all of them), isolated from the host application's tasks.
KNEAD_API std::unique_ptr<Executor> make_cpu_executor(int threads = 0);

// A CUDA device, with a stream for every thread that uses it. Throws Error(kDevice) that says what is missing. `graph_loops`: loops run as one graph
// that repeats by itself where the driver can, else in batches of rounds.
KNEAD_API std::unique_ptr<Executor> make_cuda_executor(int index = 0, bool graph_loops = true);

struct CudaDevices {
  struct Device {
    int index;
    std::string name;  // with memory and architecture
  };
  std::vector<Device> devices;  // that can be used
  std::string missing;          // why there is none
};
KNEAD_API CudaDevices cuda_devices();

}  // namespace knead
