#include "graph/cancel.h"

#include <chrono>
#include <utility>

#include "graph/error.h"

namespace knead {
namespace {

constexpr int64_t kInterval = 2'000'000;  // nanoseconds: a host may take a lock to answer

thread_local const Cancellation* current = nullptr;

}  // namespace

bool Cancellation::operator()() const {
  if (was_cancelled_.load(std::memory_order_relaxed)) return true;
  const int64_t now = std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch()).count();
  int64_t due = ask_again_.load(std::memory_order_relaxed);
  if (now < due || !ask_again_.compare_exchange_strong(due, now + kInterval, std::memory_order_relaxed)) return false;
  if (!cancelled_()) return false;
  was_cancelled_.store(true, std::memory_order_relaxed);
  return true;
}

CancellationScope::CancellationScope(const Cancellation* cancellation) : before_(std::exchange(current, cancellation)) {}
CancellationScope::~CancellationScope() {
  current = before_;
}

const Cancellation* current_cancellation() {
  return current;
}

void check_cancelled() {
  if (current && (*current)()) throw Error(ErrorCode::kCancelled, "cancelled");
}

}  // namespace knead
