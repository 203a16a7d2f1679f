// The only code that differs between executors: how a kernel's body is run. A body is a trivially copyable struct of pointers and constants with
// `void operator()(uint32_t i) const`; reductions keep a fixed partition so that the result is the same bits for any number of threads.
#pragma once
#include <algorithm>
#include <array>
#include <cstdint>
#include <type_traits>

#include "graph/error.h"
#include "graph/executor.h"

namespace knead {

inline constexpr size_t kGrain = 512;  // indices per piece: tens of microseconds of kernel work, well above the cost of a task

inline void require_host(const Executor& executor, const char* label) {
  if (executor.device() != Device{})
    throw Error(ErrorCode::kDevice, std::string("kernel ") + label + " has no " + executor.name() + " launcher in this build");
}

// Calls body(i) for every i < n. The label names the kernel in profiles and in errors.
template <class Body>
void parallel_for(Executor& executor, size_t n, const char* label, const Body& body, size_t grain = kGrain) {
  require_host(executor, label);
  executor.parallel_ranges(n, grain, [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) body(static_cast<uint32_t>(i));
  });
}

// combine(...combine(combine(start, body(0)), body(1))..., body(n - 1)), associated by fixed pieces. At most kMostPieces partial results, on the stack.
template <class T, class Body, class Combine>
T parallel_reduce(Executor& executor, size_t n, const char* label, T start, const Body& body, const Combine& combine, size_t least_grain = kGrain) {
  require_host(executor, label);
  constexpr size_t kMostPieces = 256;
  const size_t grain = std::max(least_grain, (n + kMostPieces - 1) / kMostPieces);
  std::array<T, kMostPieces> partial;
  executor.parallel_ranges(n, grain, [&](size_t begin, size_t end) {
    T sum = start;
    for (size_t i = begin; i < end; ++i) sum = combine(sum, body(static_cast<uint32_t>(i)));
    partial[begin / grain] = sum;
  });
  T sum = start;
  for (size_t piece = 0; piece * grain < n; ++piece) sum = combine(sum, partial[piece]);
  return sum;
}

template <class Body>
auto reduce_max(Executor& executor, size_t n, const char* label, const Body& body) {
  using T = std::remove_cvref_t<decltype(body(uint32_t{0}))>;
  return parallel_reduce(executor, n, label, T{0}, body, [](T a, T b) { return a < b ? b : a; });
}

template <class Body>
auto reduce_sum(Executor& executor, size_t n, const char* label, const Body& body) {
  using T = std::remove_cvref_t<decltype(body(uint32_t{0}))>;
  return parallel_reduce(executor, n, label, T{0}, body, [](T a, T b) { return a + b; });
}

}  // namespace knead
