// Toy port types, nodes and devices for tests of the engine: no geometry.
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

// { value } -> Numbers
class ValueNode : public Node {
 public:
  Param<double> value{this, "value", 1, {.min = -1e9, .max = 1e9, .doc = "the number"}};
  Param<int> size{this, "size", 1, {.min = 1, .doc = "how many of it"}};
  Out<Numbers> out{this, "value", {.doc = "the number"}};
  void evaluate(Context& context) const override { context.set(out, numbers(value(), host_memory(), static_cast<size_t>(size()))); }
};

// a + b + offset, element by element
class Add : public Node {
 public:
  In<Numbers> a{this, "a", {.doc = "first"}};
  OptionalIn<Numbers> b{this, "b", {.doc = "second"}};
  Param<double> offset{this, "offset", 0, {.doc = "added too"}};
  Out<Numbers> out{this, "sum", {.doc = "the sum"}};
  void evaluate(Context& context) const override {
    const auto in = context.get(a).values.host();
    const Numbers* more = context.get(b);
    Numbers sum{Buffer<double>(in.size())};
    double* to = sum.values.data_for_write();
    for (size_t i = 0; i < in.size(); ++i) to[i] = in[i] + (more ? more->values.host()[i % more->values.size()] : 0) + offset();
    context.set(out, std::move(sum));
  }
};

class Sum : public Node {
 public:
  ManyIn<Numbers> of{this, "of", {.doc = "what to add up"}};
  Out<Numbers> out{this, "sum", {.doc = "the sum"}};
  void evaluate(Context& context) const override {
    double total = 0;
    for (size_t i = 0; i < context.count(of); ++i) total += first(context.get(of, i));
    context.set(out, numbers(total));
  }
};

// Passes on, and counts under its label.
class Count : public Node {
 public:
  In<Numbers> in{this, "in", {.doc = "anything"}};
  Param<std::string> label{this, "label", "", {.doc = "counted under"}};
  Param<std::string> mood{this, "mood", "calm", {.choices = {"calm", "hasty"}, .doc = "of no effect"}};
  Out<Numbers> out{this, "out", {.doc = "the same"}};
  void evaluate(Context& context) const override {
    count_run(label());
    context.set(out, context.get(in));
  }
};

class FrameNode : public Node {
 public:
  Param<double> scale{this, "scale", 1, {.doc = "a frame"}};
  Out<Numbers> out{this, "value", {.doc = "frame times scale"}};
  bool depends_on_frame() const override { return true; }
  void evaluate(Context& context) const override { context.set(out, numbers(context.frame() * scale())); }
};

// The word is first: a reference to the node alone is a Word.
class Spell : public Node {
 public:
  In<Numbers> in{this, "in", {.doc = "a number"}};
  Out<Word> word{this, "word", {.doc = "as a word"}};
  Out<Numbers> number{this, "number", {.doc = "as it was"}};
  void evaluate(Context& context) const override {
    context.set(word, Word{std::to_string(first(context.get(in)))});
    context.set(number, context.get(in));
  }
};

class FileNode : public Node {
 public:
  Param<std::string> path{this, "path", "a", {.doc = "in the world's files; # is the frame"}};
  Out<Numbers> out{this, "value", {.doc = "what it holds"}};
  bool depends_on_frame() const override { return path().find('#') != std::string::npos; }
  void add_to_key(Hasher& hasher, int frame) const override { hasher.add(read(frame)); }
  void evaluate(Context& context) const override { context.set(out, numbers(read(depends_on_frame() ? context.frame() : 0))); }

 private:
  double read(int frame) const {
    std::string name = path();
    if (const size_t at = name.find('#'); at != std::string::npos) name.replace(at, 1, std::to_string(frame));
    std::lock_guard lock(world().mutex);
    const auto found = world().files.find(name);
    if (found == world().files.end()) throw Error(ErrorCode::kFile, {name, 0, 0, {}, {}}, "there is no such file");
    return found->second;
  }
};

class WriteNode : public Node {
 public:
  In<Numbers> in{this, "in", {.doc = "what to write"}};
  bool has_effect() const override { return true; }
  bool depends_on_frame() const override { return true; }
  void evaluate(Context& context) const override {
    std::lock_guard lock(world().mutex);
    world().written.emplace_back(context.frame(), first(context.get(in)));
  }
};

// Fails when its input is `when`.
class Failing : public Node {
 public:
  In<Numbers> in{this, "in", {.doc = "a number"}};
  Param<double> when{this, "when", 0, {.doc = "it fails at"}};
  Param<std::string> how{this, "how", "error", {.choices = {"error", "standard", "strange", "memory"}, .doc = "what it throws"}};
  Out<Numbers> out{this, "out", {.doc = "the same"}};
  void evaluate(Context& context) const override {
    if (first(context.get(in)) == when()) {
      if (how() == "standard") throw std::runtime_error("a standard exception");
      if (how() == "strange") throw 42;
      if (how() == "memory") throw std::bad_alloc();
      throw Error(ErrorCode::kInput, "a number that fails", "use another");
    }
    context.set(out, context.get(in));
  }
};

// Needs all the memory there is: fails when another one runs.
class Greedy : public Node {
 public:
  In<Numbers> in{this, "in", {.doc = "anything"}};
  Out<Numbers> out{this, "out", {.doc = "the same"}};
  void evaluate(Context& context) const override {
    const int others = world().greedy++;
    std::this_thread::sleep_for(std::chrono::milliseconds(3));
    --world().greedy;
    if (others > 0) throw std::bad_alloc();
    context.set(out, context.get(in));
  }
};

// Waits until it is cancelled, at most ten seconds.
class Sleepy : public Node {
 public:
  In<Numbers> in{this, "in", {.doc = "anything"}};
  Out<Numbers> out{this, "out", {.doc = "the same"}};
  void evaluate(Context& context) const override {
    ++world().asleep;
    for (int i = 0; i < 10000; ++i) {
      context.check_cancelled();
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    context.set(out, context.get(in));
  }
};

class Warns : public Node {
 public:
  In<Numbers> in{this, "in", {.doc = "anything"}};
  Out<Numbers> out{this, "out", {.doc = "the same"}};
  void evaluate(Context& context) const override {
    context.warn("a curious number");
    context.warn("a curious number");
    context.set(out, context.get(in));
  }
};

// A part that all frames share, by `once`.
class Shares : public Node {
 public:
  Param<int> name{this, "name", 0, {.doc = "of the part"}};
  Out<Numbers> out{this, "value", {.doc = "name + frame"}};
  bool depends_on_frame() const override { return true; }
  bool shares_parts() const override { return true; }
  void evaluate(Context& context) const override {
    const Value part = context.once(Hasher().add(name()).key(), [&] {
      count_run("shared part");
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
      if (runs_of("beside") > 0) count_run("shared part made beside others");
      return Value::of(numbers(name()));
    });
    context.set(out, numbers(first(part.as<Numbers>()) + context.frame()));
  }
};

class SlyFrame : public Node {
 public:
  Out<Numbers> out{this, "value", {.doc = "the frame, undeclared"}};
  void evaluate(Context& context) const override { context.set(out, numbers(context.frame())); }
};
class SlyGlobal : public Node {
 public:
  Out<Numbers> out{this, "value", {.doc = "something that no key names"}};
  void evaluate(Context& context) const override { context.set(out, numbers(world().hidden)); }
};
class SlyOnce : public Node {
 public:
  Out<Numbers> out{this, "value", {.doc = "something that no key names"}};
  void evaluate(Context& context) const override {
    context.set(out, context.once(Key{1, 2}, [] { return Value::of(numbers(world().hidden)); }).as<Numbers>());
  }
};
class SlyWrite : public Node {
 public:
  In<Numbers> in{this, "in", {.doc = "what it changes"}};
  Out<Numbers> out{this, "out", {.doc = "the same"}};
  void evaluate(Context& context) const override {
    const_cast<double&>(context.get(in).values.host()[0]) += 1;
    context.set(out, context.get(in));
  }
};
class Forgets : public Node {
 public:
  Out<Numbers> out{this, "value", {.doc = "never set"}};
  void evaluate(Context&) const override {}
};

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

namespace toys {

// The device's part: in + offset, where the executor is.
class DeviceAdd : public Node {
 public:
  In<Numbers> in{this, "in", {.doc = "a number"}};
  Param<double> offset{this, "offset", 1, {.doc = "added"}};
  Out<Numbers> out{this, "sum", {.doc = "the sum"}};
  Runs runs() const override { return Runs::kAnyDevice; }
  void evaluate(Context& context) const override {
    const auto from = context.get(in).values.view(context.executor().device());  // throws unless it has been brought
    Numbers sum{Buffer<double>(from.size(), context.memory())};
    run_body(context.executor(), from.size(), AddOffset{from.data(), sum.values.data_for_write(), offset()});
    context.set(out, std::move(sum));
  }
};

// Decides on the host by a number that is on the device: what a solver's step length is.
class DevicePeek : public Node {
 public:
  In<Numbers> in{this, "in", {.doc = "a number"}};
  Out<Numbers> out{this, "out", {.doc = "the same, where it is not negative"}};
  Runs runs() const override { return Runs::kAnyDevice; }
  void evaluate(Context& context) const override {
    Executor& executor = context.executor();
    double seen = 0;
    executor.copy(context.get(in).values.view(executor.device()).data(), executor.device(), &seen, Device{}, sizeof seen);
    executor.synchronise();
    if (seen < 0) throw Error(ErrorCode::kInput, "a negative number");
    context.set(out, context.get(in));
  }
};

// x + rate (target - x): comes to rest at the target.
class Relax : public Node {
 public:
  In<Numbers> x{this, "x", {.doc = "goes round"}};
  In<Numbers> target{this, "target", {.doc = "where it goes"}};
  Param<double> rate{this, "rate", 0.5, {.doc = "share of the way in a round"}};
  Out<Numbers> out{this, "x", {.doc = "a round further"}};
  Runs runs() const override { return Runs::kAnyDevice; }
  void evaluate(Context& context) const override {
    const Device device = context.executor().device();
    const auto at = context.get(x).values.view(device), to = context.get(target).values.view(device);
    Numbers next{Buffer<double>(at.size(), context.memory())};
    run_body(context.executor(), at.size(), GoTo{at.data(), to.data(), static_cast<uint32_t>(to.size()), next.values.data_for_write(), rate()});
    context.set(out, std::move(next));
  }
};

// Adds one to a memory that starts empty.
class Tally : public Node {
 public:
  OptionalIn<Numbers> memory{this, "memory", {.doc = "of the rounds before"}};
  In<Numbers> of{this, "of", {.doc = "anything"}};
  Out<Numbers> out{this, "memory", {.doc = "rounds so far"}};
  void evaluate(Context& context) const override {
    const Numbers* before = context.get(memory);
    context.set(out, numbers(before ? first(*before) + 1 : 1));
  }
};

// The same, made in parallel pieces of one element.
class Spread : public Node {
 public:
  In<Numbers> in{this, "in", {.doc = "numbers"}};
  Out<Numbers> out{this, "out", {.doc = "the same"}};
  void evaluate(Context& context) const override {
    const auto from = context.get(in).values.host();
    Numbers made{Buffer<double>(from.size())};
    double* to = made.values.data_for_write();
    context.executor().parallel_ranges(from.size(), 1, [&](size_t begin, size_t end) {
      std::copy(from.begin() + static_cast<long>(begin), from.begin() + static_cast<long>(end), to + begin);
    });
    context.set(out, std::move(made));
  }
};

// The same storage in a value that is new wherever `at` is.
class DeviceTables : public Node {
 public:
  In<Numbers> in{this, "in", {.doc = "numbers"}};
  In<Numbers> at{this, "at", {.doc = "anything"}};
  Out<Numbers> out{this, "out", {.doc = "the same"}};
  void evaluate(Context& context) const override { context.set(out, context.get(in)); }
};

// As many numbers as half the frame.
class Grow : public Node {
 public:
  Out<Numbers> out{this, "value", {.doc = "zeros"}};
  bool depends_on_frame() const override { return true; }
  void evaluate(Context& context) const override { context.set(out, numbers(0, host_memory(), static_cast<size_t>((context.frame() + 1) / 2))); }
};

// Looks at its input from the host, wherever it runs.
class Peek : public Node {
 public:
  In<Numbers> in{this, "in", {.doc = "numbers"}};
  Out<Numbers> out{this, "out", {.doc = "the same"}};
  Runs runs() const override { return Runs::kAnyDevice; }
  void evaluate(Context& context) const override {
    world().hidden = context.on_host(context.get(in).values).host()[0];
    context.set(out, context.get(in));
  }
};

// x + 1 for as long as x is below `until`, then no number.
class Break : public Node {
 public:
  In<Numbers> x{this, "x", {.doc = "goes round"}};
  Param<double> until{this, "until", 5, {.doc = "the last good number"}};
  Out<Numbers> out{this, "x", {.doc = "one more"}};
  Runs runs() const override { return Runs::kAnyDevice; }
  void evaluate(Context& context) const override {
    const auto from = context.get(x).values.view(context.executor().device());
    Numbers next{Buffer<double>(from.size(), context.memory())};
    run_body(context.executor(), from.size(), CountUntil{from.data(), next.values.data_for_write(), until()});
    context.set(out, std::move(next));
  }
};

// 1 / 0 - 1 / 0 after a while
class Explode : public Node {
 public:
  In<Numbers> x{this, "x", {.doc = "goes round"}};
  Out<Numbers> out{this, "x", {.doc = "its square, times a lot"}};
  void evaluate(Context& context) const override {
    const double value = first(context.get(x));
    context.set(out, numbers(value > 1e100 ? std::nan("") : value * value * 1e6));
  }
};

template <class T>
void put(Registry& registry, const char* name, int version = 1) {
  registry.add({name, version, "A toy.", [] { return std::unique_ptr<Node>(std::make_unique<T>()); }, {}});
}

inline const Registry& registry() {
  static const Registry all = [] {
    Registry r;
    register_iterate(r);
    register_group(r);
    put<ValueNode>(r, "value");
    put<Add>(r, "add");
    put<Sum>(r, "sum");
    put<Count>(r, "count");
    put<FrameNode>(r, "frame");
    put<Spell>(r, "spell");
    put<FileNode>(r, "file");
    put<WriteNode>(r, "write");
    put<Failing>(r, "failing");
    put<Greedy>(r, "greedy");
    put<Sleepy>(r, "sleepy");
    put<Warns>(r, "warns");
    put<Shares>(r, "shares");
    put<SlyFrame>(r, "sly_frame");
    put<SlyGlobal>(r, "sly_global");
    put<SlyOnce>(r, "sly_once");
    put<SlyWrite>(r, "sly_write");
    put<Forgets>(r, "forgets");
    put<DeviceAdd>(r, "device_add");
    put<DevicePeek>(r, "device_peek");
    put<Relax>(r, "relax");
    put<Tally>(r, "tally");
    put<Explode>(r, "explode");
    put<Spread>(r, "spread");
    put<DeviceTables>(r, "placed");
    put<Grow>(r, "grow");
    put<Peek>(r, "peek");
    put<Break>(r, "break");
    return r;
  }();
  return all;
}

inline CompileOptions options() {
  CompileOptions made;
  made.registry = &registry();
  return made;
}

}  // namespace toys
}  // namespace knead
