// Toy port types for tests of the engine: what they hold, what is done to them on any device, and the world outside the graph. No geometry.
#pragma once
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstring>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "graph/evaluator.h"
#include "graph/registry.h"
#include "graph/report.h"

namespace knead {
namespace toys {

struct Numbers {
  Buffer<double> values;
};
struct Word {
  std::string text;
};

}  // namespace toys

template <>
struct PortTraits<toys::Numbers> {
  static constexpr const char* name = "Numbers";
  template <class F>
  static void each_buffer(toys::Numbers& v, F&& f) {
    f(v.values);
  }
  static Buffer<double> unrest(const toys::Numbers& before, const toys::Numbers& after, Executor& executor);
};
template <>
struct PortTraits<toys::Word> {
  static constexpr const char* name = "Word";
  template <class F>
  static void each_buffer(toys::Word&, F&&) {}
  static void hash(const toys::Word& v, Hasher& hasher) { hasher.add(v.text); }
};

namespace toys {

// What the toys do on any device. One index is enough for the largest change.
struct AddOffset {
  static constexpr const char* kKernel = "toy_add";
  const double* from;
  double* to;
  double offset;
  KNEAD_HD void operator()(uint32_t i) const { to[i] = from[i] + offset; }
};
struct GoTo {
  static constexpr const char* kKernel = "toy_relax";
  const double *at, *target;
  uint32_t targets;
  double* to;
  double rate;
  KNEAD_HD void operator()(uint32_t i) const { to[i] = at[i] + rate * (target[i % targets] - at[i]); }
};
struct LargestChange {
  static constexpr const char* kKernel = "toy_change";
  const double *before, *after;
  size_t n;
  double* to;
  KNEAD_HD void operator()(uint32_t) const {
    double most = 0;
    for (size_t i = 0; i < n; ++i)
      if (const double change = after[i] > before[i] ? after[i] - before[i] : before[i] - after[i]; !(change <= most)) most = change;
    *to = most;
  }
};
struct CountUntil {
  static constexpr const char* kKernel = "toy_count";
  const double* from;
  double* to;
  double until;
  KNEAD_HD void operator()(uint32_t i) const { to[i] = from[i] < until ? from[i] + 1 : std::nan(""); }
};
template <class Body>
void run_body(Executor& executor, size_t n, const Body& body) {
  if (executor.device() != Device{}) return executor.launch(body, n);
  for (size_t i = 0; i < n; ++i) body(static_cast<uint32_t>(i));
}

// What the toys do to the world outside the graph, and what they see of it.
struct World {
  std::mutex mutex;
  std::map<std::string, double> files;          // read by `file`
  std::vector<std::pair<int, double>> written;  // by `write`: frame and value
  std::map<std::string, int> runs;              // by `count`, per label
  std::atomic<double> hidden{1};                // read by `sly_global`, which does not say so
  std::atomic<int> greedy{0};                   // `greedy` nodes that run
  std::atomic<int> asleep{0};                   // `sleepy` nodes that have begun
};
inline World& world() {
  static World one;
  return one;
}
inline void begin_anew() {
  World& w = world();
  std::lock_guard lock(w.mutex);
  w.files.clear();
  w.written.clear();
  w.runs.clear();
  w.hidden = 1;
  w.asleep = 0;
}
inline int runs_of(const std::string& label) {
  std::lock_guard lock(world().mutex);
  return world().runs[label];
}
inline void count_run(const std::string& label) {
  std::lock_guard lock(world().mutex);
  ++world().runs[label];
}

inline Numbers numbers(double value, MemoryResource& memory = host_memory(), size_t size = 1) {
  Numbers made{Buffer<double>(size, memory)};
  std::fill_n(made.values.data_for_write(), size, value);
  return made;
}
inline double first(const Numbers& n) {
  return n.values.host()[0];
}

}  // namespace toys

inline Buffer<double> PortTraits<toys::Numbers>::unrest(const toys::Numbers& before, const toys::Numbers& after, Executor& executor) {
  Buffer<double> most(1, executor.memory());
  const auto a = before.values.view(executor.device()), b = after.values.view(executor.device());
  toys::run_body(executor, 1, toys::LargestChange{a.data(), b.data(), b.size(), most.data_for_write()});
  return most;
}
template <>
inline CudaCode cuda_code<toys::AddOffset>() {
  return {};
}
template <>
inline CudaCode cuda_code<toys::GoTo>() {
  return {};
}
template <>
inline CudaCode cuda_code<toys::CountUntil>() {
  return {};
}
template <>
inline CudaCode cuda_code<toys::LargestChange>() {
  return {};
}

}  // namespace knead
