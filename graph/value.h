// A type-erased, shared, immutable value that travels between ports.
//
// A type becomes a port type by specialising PortTraits<T> (see kernels/port_types.h for Knead's own, tests/graph for toys, graph/opaque_value.h for
// what no port carries):
//   static constexpr const char* name;                              "Surface"
//   template <class F> static void each_buffer(T&, F&& f);          calls f(Buffer<U>&) on every buffer that a device transfer must move
//   and optionally
//   template <class F> static void each_device_buffer(T& v, F&& f);  of these, the ones that nodes on devices read; the others stay on the host
//   static void hash(const T&, Hasher&)                              what the buffers do not hold, for checked mode's comparisons
//   static Buffer<double> unrest(const T& before, const T& after, Executor&)
//                                                                   how far from rest a loop's state is, over its own size, as one number on the
//                                                                   executor's device; `iterate` stops on it. No number, or infinite: a broken state
#pragma once
#include <atomic>
#include <memory>
#include <new>
#include <utility>

#include "graph/buffer.h"
#include "graph/executor.h"
#include "graph/hash.h"

namespace knead {

template <class T>
struct PortTraits;

class Value;

struct PortType {
  const char* name;
  size_t (*bytes)(const Value&);                                                                  // of all its buffers
  bool (*on_device)(const Value&, Device);                                                        // every buffer that devices read lives there
  Value (*with_buffers)(const Value&, FunctionRef<Buffer<std::byte>(const Buffer<std::byte>&)>);  // a copy with these replaced
  Key (*content)(const Value&);                                                  // hash of all host buffers and of PortTraits<T>::hash; checked mode
  Buffer<double> (*unrest)(const Value& before, const Value& after, Executor&);  // null when the type has none
};

template <class T>
const PortType& port_type();

// By name when the addresses differ: a host program and the library may each have an instance.
inline bool same_type(const PortType& a, const PortType& b) {
  return &a == &b || std::strcmp(a.name, b.name) == 0;
}

class Value {
 public:
  Value() = default;
  template <class T>
  static Value of(T value, MemoryResource& memory = host_memory());

  Value(const Value& other) : held_(other.held_) {
    if (held_) held_->references.fetch_add(1, std::memory_order_relaxed);
  }
  Value(Value&& other) noexcept : held_(std::exchange(other.held_, nullptr)) {}
  Value& operator=(Value other) noexcept {
    std::swap(held_, other.held_);
    return *this;
  }
  ~Value() {
    if (held_ && held_->references.fetch_sub(1, std::memory_order_acq_rel) == 1) held_->destroy(held_);
  }

  explicit operator bool() const { return held_ != nullptr; }
  const PortType* type() const { return held_ ? held_->type : nullptr; }
  template <class T>
  const T* get_if() const {
    return held_ && same_type(*held_->type, port_type<T>()) ? &static_cast<const Held<T>*>(held_)->value : nullptr;
  }
  template <class T>
  const T& as() const;  // throws Error(kInternal) on a type mismatch

 private:
  struct Base {
    std::atomic<uint32_t> references{1};
    const PortType* type = nullptr;
    void (*destroy)(Base*) = nullptr;
    MemoryResource* memory = nullptr;
  };
  template <class T>
  struct Held : Base {
    T value;
    explicit Held(T v) : value(std::move(v)) {}
  };
  Base* held_ = nullptr;
};

namespace detail {
[[noreturn]] KNEAD_API void throw_type_mismatch(const PortType* is, const PortType& asked);
}  // namespace detail

template <class T>
Value Value::of(T value, MemoryResource& memory) {
  void* storage = memory.allocate(sizeof(Held<T>));
  auto* held = new (storage) Held<T>(std::move(value));
  held->type = &port_type<T>();
  held->memory = &memory;
  held->destroy = [](Base* base) {
    MemoryResource* from = base->memory;
    static_cast<Held<T>*>(base)->~Held<T>();
    from->release(base, sizeof(Held<T>));
  };
  Value result;
  result.held_ = held;
  return result;
}

template <class T>
const T& Value::as() const {
  const T* value = get_if<T>();
  if (!value) detail::throw_type_mismatch(type(), port_type<T>());
  return *value;
}

namespace detail {
template <class T, class F>
void each_device_buffer(T& value, F&& f) {
  if constexpr (requires { PortTraits<T>::each_device_buffer(value, f); })
    PortTraits<T>::each_device_buffer(value, f);
  else
    PortTraits<T>::each_buffer(value, f);
}
}  // namespace detail

template <class T>
const PortType& port_type() {
  static const PortType type = [] {
    PortType t{};
    t.name = PortTraits<T>::name;
    t.bytes = [](const Value& value) {
      size_t bytes = 0;
      PortTraits<T>::each_buffer(const_cast<T&>(value.as<T>()), [&](auto& buffer) { bytes += buffer.bytes(); });
      return bytes;
    };
    t.on_device = [](const Value& value, Device device) {
      bool all = true;
      detail::each_device_buffer(const_cast<T&>(value.as<T>()), [&](auto& buffer) { all = all && (!buffer || buffer.device() == device); });
      return all;
    };
    t.with_buffers = [](const Value& value, FunctionRef<Buffer<std::byte>(const Buffer<std::byte>&)> replace) {
      T copy = value.as<T>();
      detail::each_device_buffer(copy, [&]<class U>(Buffer<U>& buffer) {
        if (buffer) buffer = replace(buffer.template as<std::byte>()).template as<U>();
      });
      return Value::of<T>(std::move(copy));
    };
    t.content = [](const Value& value) {
      Hasher hasher;
      if constexpr (requires(const T& v, Hasher& h) { PortTraits<T>::hash(v, h); }) PortTraits<T>::hash(value.as<T>(), hasher);
      PortTraits<T>::each_buffer(const_cast<T&>(value.as<T>()), [&](auto& buffer) {
        hasher.add(buffer.size());
        if (buffer && buffer.device() == Device{}) hasher.bytes(buffer.host().data(), buffer.bytes());
      });
      return hasher.key();
    };
    if constexpr (requires(const T& v, Executor& e) { PortTraits<T>::unrest(v, v, e); })
      t.unrest = [](const Value& before, const Value& after, Executor& e) { return PortTraits<T>::unrest(before.as<T>(), after.as<T>(), e); };
    return t;
  }();
  return type;
}

}  // namespace knead
