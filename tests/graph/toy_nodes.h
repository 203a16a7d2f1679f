// Toy nodes that run on the host, well-behaved and others.
#pragma once
#include <algorithm>
#include <chrono>
#include <mutex>
#include <new>
#include <stdexcept>
#include <string>
#include <thread>

#include "graph/evaluator.h"
#include "tests/graph/toy_values.h"

namespace knead {
namespace toys {

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
}  // namespace knead
