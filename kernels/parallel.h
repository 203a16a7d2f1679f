// The only code that differs between executors: how a kernel's body is run (with run_lanes, kernels/loop/loop_simd.h). A body is a trivially copyable struct of
// pointers and constants with `void operator()(uint32_t i) const`; those that devices run too are marked (graph/device_code.h). Reductions keep a fixed
// partition so that the result is the same bits for any number of threads.
#pragma once
#include <algorithm>
#include <array>
#include <cstdint>
#include <type_traits>
#include <utility>

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
  if constexpr (DeviceBody<Body>)
    if (executor.device() != Device{}) return executor.launch(body, n);
  require_host(executor, label);
  executor.parallel_ranges(n, grain, [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) body(static_cast<uint32_t>(i));
  });
}

// The same for a body that names its kernel.
template <class Body>
requires requires {
  Body::kKernel;
}
void parallel_for(Executor& executor, size_t n, const Body& body, size_t grain = kGrain) {
  parallel_for(executor, n, Body::kKernel, body, grain);
}

// Of piece(begin, end) over fixed pieces of n indices, one after the other, to `start`. At most kMostPieces partial results, on the stack.
template <class T, class Piece, class Combine>
T reduce_pieces(Executor& executor, size_t n, const char* label, T start, const Piece& piece, const Combine& combine, size_t least_grain = kGrain) {
  require_host(executor, label);
  constexpr size_t kMostPieces = 256;
  const size_t grain = std::max(least_grain, (n + kMostPieces - 1) / kMostPieces);
  std::array<T, kMostPieces> partial;
  executor.parallel_ranges(n, grain, [&](size_t begin, size_t end) { partial[begin / grain] = piece(begin, end); });
  T sum = start;
  for (size_t k = 0; k * grain < n; ++k) sum = combine(sum, partial[k]);
  return sum;
}

// combine(...combine(combine(start, body(0)), body(1))..., body(n - 1)), associated by fixed pieces.
template <class T, class Body, class Combine>
T parallel_reduce(Executor& executor, size_t n, const char* label, T start, const Body& body, const Combine& combine, size_t least_grain = kGrain) {
  const auto piece = [&](size_t begin, size_t end) {
    T sum = start;
    for (size_t i = begin; i < end; ++i) sum = combine(sum, body(static_cast<uint32_t>(i)));
    return sum;
  };
  return reduce_pieces(executor, n, label, start, piece, combine, least_grain);
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

// A reduction that stays where it is made. Its body gives a part for every index, `Sum operator()(uint32_t i) const`, and has `static Sum combine(Sum, Sum)`,
// for which Sum{} is the identity, and `void finish(const Sum&) const`, which is called once and puts the result, or what is made of it, where the next
// kernel reads it. A body may bring a faster way for the host, `Sum sum_on_host(Executor&, size_t n) const` or, for the indices of a piece,
// `Sum over(size_t begin, size_t end) const`, or the least indices of a piece there, `kGrain`.
template <class Body>
using SumOf = decltype(std::declval<const Body&>()(uint32_t{0}));

template <class Body>
void reduce_on_host(Executor& executor, size_t n, const Body& body) {
  if constexpr (requires { body.sum_on_host(executor, n); })
    body.finish(body.sum_on_host(executor, n));
  else if constexpr (requires { body.over(n, n); })
    body.finish(reduce_pieces(
        executor, n, Body::kKernel, SumOf<Body>{}, [&](size_t begin, size_t end) { return body.over(begin, end); }, Body::combine));
  else if constexpr (requires { Body::kGrain; })
    body.finish(parallel_reduce(executor, n, Body::kKernel, SumOf<Body>{}, body, Body::combine, Body::kGrain));
  else
    body.finish(parallel_reduce(executor, n, Body::kKernel, SumOf<Body>{}, body, [](const auto& a, const auto& b) { return Body::combine(a, b); }));
}

// The body as devices run it: blocks of indices to `partial`, which depend on n alone, then these to one.
template <class Body>
struct Reduction {
  static constexpr const char* kKernel = Body::kKernel;
  static constexpr uint32_t kMostPieces = 1024;
  Body body;
  SumOf<Body>* partial;  // [kMostPieces]
};

// The serial executor that stands in for a device's (graph/device_code.h, Kernel::host).
KNEAD_API Executor& stand_in();

template <class Body>
const Kernel& kernel_of_reduction() {
  static_assert(std::is_trivially_copyable_v<Reduction<Body>> && sizeof(Reduction<Body>) <= 4000);
  static const Kernel kernel{Body::kKernel, sizeof(Reduction<Body>),
                             [](const void* body, uint32_t n) { reduce_on_host(stand_in(), n, static_cast<const Reduction<Body>*>(body)->body); },
                             cuda_code<Reduction<Body>>()};
  return kernel;
}

template <DeviceBody Body>
void reduce(Executor& executor, size_t n, const Body& body) {
  if (executor.device() == Device{}) return reduce_on_host(executor, n, body);
  Buffer<SumOf<Body>> partial(Reduction<Body>::kMostPieces, executor.memory());
  const Reduction<Body> reduction{body, partial.data_for_write()};
  executor.launch(kernel_of_reduction<Body>(), &reduction, static_cast<uint32_t>(n));
}

}  // namespace knead
