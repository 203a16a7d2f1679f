// Toy nodes that run on any device, and in loops.
#pragma once
#include <algorithm>
#include <cmath>
#include <limits>

#include "graph/evaluator.h"
#include "tests/graph/toy_values.h"

namespace knead {
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

}  // namespace toys
}  // namespace knead
