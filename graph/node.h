// The node contract. A node type is a class whose typed members declare everything once:
//
//   class Scale : public Node {
//    public:
//     In<Points> points{this, "points", {.unit = "cells", .doc = "positions of H"}};
//     Param<double> factor{this, "factor", 1.0, {.min = 0, .doc = "what to multiply by"}};
//     Out<Points> result{this, "points", {.doc = "scaled positions"}};
//     void evaluate(Context& context) const override;
//   };
//   KNEAD_REGISTER(scale, Scale, 1, "the manual page")
//
// From these members come the checks, the graph reader's errors, the JSON schema, the manual, the cache key and the dependency edges.
// `evaluate` is const and re-entrant: it reads only through its Context, checks context.check_cancelled() in long loops, and publishes whole results.
#pragma once
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "graph/error.h"
#include "graph/executor.h"
#include "graph/param.h"
#include "graph/value.h"

namespace knead {

class Node;
class Context;

struct PortSpec {
  const char* unit = "";
  const char* shape = "";
  const char* doc = "";
};

struct InputDeclaration {
  std::string name;
  const PortType* type;  // null: any
  PortSpec spec;
  bool optional = false;
  bool many = false;  // takes a list; order is kept
};
struct OutputDeclaration {
  std::string name;
  const PortType* type;
  PortSpec spec;
};

struct ParamSpec {
  std::optional<double> min = {}, max = {};
  std::vector<std::string> choices = {};
  const char* unit = "";
  const char* doc = "";
};

class KNEAD_API ParamBase {
 public:
  ParamBase(Node* owner, const char* name, ParamSpec spec);
  ParamBase(const ParamBase&) = delete;
  virtual ~ParamBase() = default;
  const std::string& name() const { return name_; }
  const ParamSpec& spec() const { return spec_; }
  bool is_set() const { return set_; }
  std::string assign(const Literal& literal);  // "" or what is wrong with it; keeps the old value then
  virtual Literal show() const = 0;
  virtual void hash(Hasher& hasher) const = 0;
  virtual Literal schema() const = 0;                  // with default, range and doc
  const Literal& written() const { return written_; }  // as assigned, with its place

 protected:
  virtual std::string parse(const Literal& literal) = 0;
  Literal decorated(Literal schema) const;
  std::string check_number(double value) const;
  std::string check_choice(const std::string& value) const;

 private:
  std::string name_;
  ParamSpec spec_;
  bool set_ = false;
  Literal written_;
};

template <class T>
class Param : public ParamBase {
 public:
  Param(Node* owner, const char* name, T value, ParamSpec spec) : ParamBase(owner, name, std::move(spec)), value_(std::move(value)) {}
  const T& operator()() const { return value_; }
  Literal show() const override { return ParamTraits<T>::show(value_); }
  void hash(Hasher& hasher) const override { ParamTraits<T>::hash(hasher, value_); }
  Literal schema() const override { return decorated(ParamTraits<T>::schema()); }

 protected:
  std::string parse(const Literal& literal) override {
    T parsed{};
    if (std::string wrong = ParamTraits<T>::parse(literal, parsed); !wrong.empty()) return wrong;
    if constexpr (std::is_same_v<T, int> || std::is_same_v<T, double>)
      if (std::string wrong = check_number(static_cast<double>(parsed)); !wrong.empty()) return wrong;
    if constexpr (std::is_same_v<T, std::string>)
      if (std::string wrong = check_choice(parsed); !wrong.empty()) return wrong;
    value_ = std::move(parsed);
    return {};
  }

 private:
  T value_;
};

// Input ports. `In` must be connected; `OptionalIn` may be left out or be `none`; `ManyIn` takes one or several values (several colliders), or none
// at all.
struct KNEAD_API InBase {
  int index;
  InBase(Node* owner, const char* name, const PortType& type, PortSpec spec, bool optional, bool many);
  InBase(const InBase&) = delete;
};
template <class T>
struct In : InBase {
  In(Node* owner, const char* name, PortSpec spec) : InBase(owner, name, port_type<T>(), spec, false, false) {}
};
template <class T>
struct OptionalIn : InBase {
  OptionalIn(Node* owner, const char* name, PortSpec spec) : InBase(owner, name, port_type<T>(), spec, true, false) {}
};
template <class T>
struct ManyIn : InBase {
  ManyIn(Node* owner, const char* name, PortSpec spec) : InBase(owner, name, port_type<T>(), spec, true, true) {}
};
// The first output is the node's default: `tets: build` means `tets: build.<first output>`.
struct KNEAD_API OutBase {
  int index;
  OutBase(Node* owner, const char* name, const PortType& type, PortSpec spec);
  OutBase(const OutBase&) = delete;
};
template <class T>
struct Out : OutBase {
  Out(Node* owner, const char* name, PortSpec spec) : OutBase(owner, name, port_type<T>(), spec) {}
};

// Where evaluate may be called; on kAnyDevice the scheduler brings every input's buffers to the executor's device.
enum class Runs { kHost, kAnyDevice };

class KNEAD_API Node {
 public:
  Node() = default;
  Node(const Node&) = delete;
  virtual ~Node() = default;

  virtual void evaluate(Context& context) const = 0;

  // Called once at compile time after every parameter is set; report what is wrong with them together. May throw Error.
  virtual void configure() {}
  // True when context.frame() may be read. Asked after configure().
  virtual bool depends_on_frame() const { return false; }
  // Writes something outside the graph (a file): always run, never cached.
  virtual bool has_effect() const { return false; }
  virtual Runs runs() const { return Runs::kHost; }
  // Much of its work is a part that all frames share (Context::once). It is made before frames run side by side, which would only wait for it, with all
  // threads to itself, and counts as no frame's work: by `make_parts`, or by the first frame's evaluation where another such node needs its outputs.
  virtual bool shares_parts() const { return false; }
  // Makes these parts, from the first frame's inputs; outputs are not kept.
  virtual void make_parts(Context& context) const { evaluate(context); }
  // What became of an input or parameter that an earlier version had, for the error about it; empty: there was none.
  virtual std::string what_became_of(const std::string& /*member*/) const { return {}; }
  // Adds what the result depends on beside parameters and inputs: the contents of files. Called before every evaluation.
  virtual void add_to_key(Hasher&, int /*frame*/) const {}

  const std::vector<InputDeclaration>& inputs() const { return inputs_; }
  const std::vector<OutputDeclaration>& outputs() const { return outputs_; }
  const std::vector<ParamBase*>& params() const { return params_; }

 protected:
  std::vector<InputDeclaration> inputs_;  // only `iterate` and its like change these by hand
  std::vector<OutputDeclaration> outputs_;

 private:
  friend class ParamBase;
  friend struct InBase;
  friend struct OutBase;
  std::vector<ParamBase*> params_;
};

// What one evaluation of a node may see and do.
class KNEAD_API Context {
 public:
  virtual ~Context() = default;

  template <class T>
  const T& get(const In<T>& port) const {
    return input(port.index, 0).template as<T>();
  }
  template <class T>
  const T* get(const OptionalIn<T>& port) const {
    return input_count(port.index) ? &input(port.index, 0).template as<T>() : nullptr;
  }
  template <class T>
  size_t count(const ManyIn<T>& port) const {
    return input_count(port.index);
  }
  template <class T>
  const T& get(const ManyIn<T>& port, size_t i) const {
    return input(port.index, i).template as<T>();
  }
  template <class T>
  void set(const Out<T>& port, T value) {
    set_output(port.index, Value::of<T>(std::move(value)));
  }

  // False where nobody reads the output, as of most reports inside a loop: then any value will do, and making one is a waste.
  template <class T>
  bool wants(const Out<T>& port) const {
    return wants_output(port.index);
  }

  virtual int frame() const = 0;  // throws in checked mode when the node did not say depends_on_frame()
  virtual Executor& executor() const = 0;
  MemoryResource& memory() const { return executor().memory(); }
  virtual bool checked() const { return false; }  // checked mode: what follows from the declarations is proved, at a cost
  virtual bool cancelled() const = 0;
  void check_cancelled() const;                       // throws Error(kCancelled)
  virtual void warn(const std::string& message) = 0;  // kept with the cached result and repeated to the host once per frame

  // A result that several frames share although the node itself depends on the frame (an SDF in the collider's own space): computed once per key,
  // then taken from the cache. The key must name everything the result depends on.
  virtual Value once(const Key& key, FunctionRef<Value()> make) = 0;

  // Time spent in a part of this node (the body of a loop), by the part's name; added up.
  virtual void add_time(const std::string& part, double seconds) = 0;

  virtual bool wants_output(int) const { return true; }

  // What a node on a device needs to see: the buffer where the host can read it. Counted as a transfer, and one that a loop on a device does not make
  // from round to round: there, the loop is run from the host instead.
  template <class T>
  Buffer<T> on_host(const Buffer<T>& buffer) {
    return buffer.device() == Device{} ? buffer : host_copy(buffer.template as<std::byte>()).template as<T>();
  }
  virtual Buffer<std::byte> host_copy(const Buffer<std::byte>& buffer);

  // For structural nodes.
  virtual const Value& input(int port, size_t i) const = 0;
  virtual size_t input_count(int port) const = 0;
  virtual void set_output(int port, Value value) = 0;
};

}  // namespace knead
