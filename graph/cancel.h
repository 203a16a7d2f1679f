// Cancellation of long work that knows nothing of nodes. The evaluator names, for the thread that runs a node, whom to ask; host executors hand this on to the
// threads of their loops and ask between two pieces of a loop; long work in one piece asks by itself.
#pragma once
#include <atomic>
#include <cstdint>

#include "graph/executor.h"

namespace knead {

// Asks at most once in two milliseconds, whatever the number of threads, and then remembers a yes. Shared by the threads that work for one node.
class KNEAD_API Cancellation {
 public:
  // `cancelled` must outlive this.
  explicit Cancellation(FunctionRef<bool()> cancelled) : cancelled_(cancelled) {}
  bool operator()() const;

 private:
  FunctionRef<bool()> cancelled_;
  mutable std::atomic<int64_t> ask_again_{0};  // nanoseconds of the steady clock
  mutable std::atomic<bool> was_cancelled_{false};
};

// While it lives, `check_cancelled` on this thread asks this one; null asks nobody.
class KNEAD_API CancellationScope {
 public:
  explicit CancellationScope(const Cancellation* cancellation);
  ~CancellationScope();
  CancellationScope(const CancellationScope&) = delete;
  CancellationScope& operator=(const CancellationScope&) = delete;

 private:
  const Cancellation* before_;
};

KNEAD_API const Cancellation* current_cancellation();  // of this thread; null: none
KNEAD_API void check_cancelled();                      // throws Error(kCancelled)

}  // namespace knead
