#include "graph/frame_context.h"

#include <algorithm>
#include <chrono>

#include "graph/opaque_value.h"

namespace knead {
namespace {

// A buffer's copy on another device, as the cache keeps it.
struct CopiedBuffer {
  static constexpr const char* kOpaqueName = "CopiedBuffer";
  Buffer<std::byte> bytes;
  void each_buffer(auto&& f) { f(bytes); }
};

}  // namespace

FrameContext::FrameContext(Evaluator::Impl& evaluator, FrameState& state, int node)
    : PlanContext(state.values, node), evaluator_(evaluator), state_(state), executor_(evaluator.executor_of(plan_node())) {}

void FrameContext::warn(const std::string& message) {
  const std::string line = "node '" + plan_node().name + "': " + message;
  std::lock_guard lock(mutex_);
  if (std::find(warnings.begin(), warnings.end(), line) == warnings.end()) warnings.push_back(line);
}

void FrameContext::add_time(const std::string& part, double seconds) {
  std::lock_guard lock(mutex_);
  const auto known = std::find_if(parts.begin(), parts.end(), [&](const NodeTime& time) { return time.name == part; });
  if (known == parts.end())
    parts.push_back({part, seconds, false});
  else
    known->seconds += seconds;
}

Value FrameContext::once(const Key& key, FunctionRef<Value()> make) {
  const Device device = executor_.device();
  Hasher hasher;
  hasher.add("once").add(plan_node().type->name).add(plan_node().type->version).add(device.kind).add(device.index).add(key);
  const auto seconds_since = [](auto start) { return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count(); };
  const auto start = std::chrono::steady_clock::now();
  double making = 0;
  const Value value = evaluator_.cache->once(hasher.key(), [&] {
    const auto making_start = std::chrono::steady_clock::now();
    Value made = make();
    making = seconds_since(making_start);
    return made;
  });
  {
    const double all = seconds_since(start);
    std::lock_guard lock(mutex_);
    shared_seconds += making;
    waited_seconds += all - making;
  }
  if (checked() && value.type()->content(value) != value.type()->content(make())) throw_differs("a shared part");
  return value;
}

// Replaces the inputs whose buffers are on another device than the node's by copies.
void FrameContext::bring_inputs() {
  const auto& ports = plan_node().inputs;
  const auto here = [&](const Value& value) { return !value || value.type()->on_device(value, executor_.device()); };
  const bool all_here = std::all_of(ports.begin(), ports.end(), [&](const std::vector<Source>& sources) {
    return std::all_of(sources.begin(), sources.end(), [&](Source source) { return here(values_.at(source)); });
  });
  if (all_here) return;
  moved_.resize(ports.size());
  for (size_t port = 0; port < ports.size(); ++port)
    for (const Source source : ports[port])
      if (const Value& value = values_.at(source)) moved_[port].push_back(evaluator_.brought(value, executor_.device()));
}

// What the node has just launched may not have written it yet, and the cache must not keep it: the node has not published it.
Buffer<std::byte> FrameContext::host_copy(const Buffer<std::byte>& buffer) {
  return evaluator_.copied(buffer, Device{});
}

void FrameContext::compare(const Cache::Result& cached) {
  for (size_t k = 0; k < cached.outputs.size(); ++k) {
    const Value &was = cached.outputs[k], &is = outputs()[k];
    if (was.type()->content(was) != is.type()->content(is)) throw_differs("output '" + plan_node().node->outputs()[k].name + "'");
  }
}

// The value, with its buffers on device `there`.
Value Evaluator::Impl::brought(const Value& value, Device there) {
  if (value.type()->on_device(value, there)) return value;
  return value.type()->with_buffers(value, [&](const Buffer<std::byte>& buffer) { return brought(buffer, there); });
}

// The cache keeps the copy under the buffer's own id, so that all readers of it share one: in all frames, and in values that are new in every frame
// but hold it, such as a field that moves with its collider.
Buffer<std::byte> Evaluator::Impl::brought(const Buffer<std::byte>& buffer, Device there) {
  if (buffer.device() == there) return buffer;
  const Key key = Hasher().add("copy").add(there.kind).add(there.index).add(buffer.id()).key();
  return cache->once(key, [&] { return Value::of(CopiedBuffer{copied(buffer, there)}); }).as<CopiedBuffer>().bytes;
}

// The only place where a buffer of a value moves.
Buffer<std::byte> Evaluator::Impl::copied(const Buffer<std::byte>& buffer, Device there) {
  Buffer<std::byte> copy(buffer.size(), there == Device{} ? host_memory() : device->memory());
  device->copy(buffer.view(buffer.device()).data(), buffer.device(), copy.data_for_write(), there, buffer.bytes());
  device->synchronise();
  if (buffer.bytes() > 0) ++moved, moved_bytes += buffer.bytes();
  return copy;
}

}  // namespace knead
