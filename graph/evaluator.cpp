#include "graph/evaluator.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <exception>
#include <latch>
#include <mutex>
#include <set>
#include <system_error>
#include <thread>

#include "graph/plan_values.h"

namespace knead {
namespace {

// A buffer's copy on another device, as the cache keeps it.
struct CopiedBuffer {
  Buffer<std::byte> bytes;
};

}  // namespace

template <>
struct PortTraits<CopiedBuffer> {
  static constexpr const char* name = "CopiedBuffer";
  template <class F>
  static void each_buffer(CopiedBuffer& v, F&& f) {
    f(v.bytes);
  }
};

namespace {

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

// What the nodes of one frame share while they run, perhaps at once.
struct FrameState {
  FrameState(int f, const Plan& plan) : FrameState(f, plan, plan.nodes.size()) {}
  FrameState(int f, const Plan& plan, size_t n) : frame(f), round(plan), keys(n), times(n), errors(n), failed(n), warnings(n) {}

  int frame;
  PlanValues round;
  std::vector<Key> keys;                     // per plan node, as the rest
  std::vector<std::vector<NodeTime>> times;  // the node itself, then its parts
  std::vector<std::optional<Error>> errors;
  std::vector<char> failed;  // it, or something that it needs
  bool in_order = false;     // nodes one after the other, on the calling thread
  // Of the node and of all that it stands on: a frame that finds a node in the cache does not look at what is behind it.
  std::vector<std::vector<std::string>> warnings;
};

void let_end(Executor& executor) noexcept {
  try {
    executor.synchronise();
  } catch (...) {
    // The device has failed: nothing runs any more.
  }
}

void merge(std::vector<std::string>& into, const std::vector<std::string>& more) {
  into.insert(into.end(), more.begin(), more.end());
  std::sort(into.begin(), into.end());
  into.erase(std::unique(into.begin(), into.end()), into.end());
}

}  // namespace

struct Evaluator::Impl {
  std::shared_ptr<const Plan> plan;
  EvaluatorOptions options;
  std::unique_ptr<Executor> own_executor, own_host;
  Executor* device = nullptr;
  Executor* host = nullptr;
  std::shared_ptr<Cache> cache;
  std::vector<std::atomic<uint64_t>> evaluations;
  std::vector<std::atomic<double>> seconds;
  std::atomic<uint64_t> transfers{0}, transferred_bytes{0};

  const PlanNode& node_at(int i) const { return plan->nodes[static_cast<size_t>(i)]; }
  Executor& executor_of(const PlanNode& node) const { return node.node->runs() == Runs::kHost ? *host : *device; }
  bool cancelled() const { return options.cancelled && options.cancelled(); }

  std::vector<Source> targets_of(const std::vector<std::string>& outputs, bool effects) const;
  std::vector<char> reached_from(const std::vector<Source>& targets) const;
  void find_keys(int frame, const std::vector<char>& reached, std::vector<Key>& keys) const;
  Value brought(const Value& value, Device there);
  Buffer<std::byte> brought(const Buffer<std::byte>& buffer, Device there);
  Buffer<std::byte> copied(const Buffer<std::byte>& buffer, Device there);
  FrameResult evaluate(int frame, const std::vector<std::string>& outputs, bool effects, bool in_order);
  void fill(FrameState& state, const std::vector<Source>& targets);
  void run_nodes(FrameState& state, const std::vector<int>& nodes);
  void run_node(FrameState& state, int i);
};

namespace {

class FrameContext final : public PlanContext {
 public:
  FrameContext(Evaluator::Impl& evaluator, FrameState& state, int node);

  Executor& executor() const override { return executor_; }
  bool checked() const override { return evaluator_.options.checked; }
  bool cancelled() const override { return evaluator_.cancelled(); }
  const Value& input(int port, size_t i) const override {
    return moved_.empty() ? PlanContext::input(port, i) : moved_[static_cast<size_t>(port)].at(i);
  }
  void warn(const std::string& message) override;
  Value once(const Key& key, FunctionRef<Value()> make) override;
  void add_time(const std::string& part, double seconds) override;
  Buffer<std::byte> host_copy(const Buffer<std::byte>& buffer) override;

  void bring_inputs();
  void compare(const Cache::Result& cached);

  std::vector<std::string> warnings;
  std::vector<NodeTime> parts;

 protected:
  int frame_number() const override { return state_.frame; }

 private:
  [[noreturn]] void throw_differs(const std::string& what) const {
    throw Error(ErrorCode::kInternal, plan_node().where, what + " differs from its cached result",
                "node type '" + plan_node().type->name + "' depends on something that its key does not name, or its version was not raised");
  }

  Evaluator::Impl& evaluator_;
  FrameState& state_;
  Executor& executor_;
  std::mutex mutex_;  // a node may warn from its own parallel loops
  std::vector<std::vector<Value>> moved_;
};

FrameContext::FrameContext(Evaluator::Impl& evaluator, FrameState& state, int node)
    : PlanContext(state.round, node), evaluator_(evaluator), state_(state), executor_(evaluator.executor_of(plan_node())) {}

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
  const Value value = evaluator_.cache->once(hasher.key(), make);
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

}  // namespace

std::vector<Source> Evaluator::Impl::targets_of(const std::vector<std::string>& outputs, bool effects) const {
  std::vector<Source> targets;
  for (const std::string& output : outputs) targets.push_back(plan->find(output));
  if (effects)
    for (const int sink : plan->sinks()) targets.push_back({sink, 0});
  return targets;
}

std::vector<char> Evaluator::Impl::reached_from(const std::vector<Source>& targets) const {
  std::vector<char> reached(plan->nodes.size());
  for (const Source target : targets) reached[static_cast<size_t>(target.node)] = true;
  for (size_t i = plan->nodes.size(); i-- > 0;)
    if (reached[i])
      for (const auto& port : plan->nodes[i].inputs)
        for (const Source source : port) reached[static_cast<size_t>(source.node)] = true;
  return reached;
}

// Keys of the nodes reached. Throws when a node cannot say what it depends on (a missing file).
void Evaluator::Impl::find_keys(int frame, const std::vector<char>& reached, std::vector<Key>& keys) const {
  for (size_t i = 0; i < plan->nodes.size(); ++i) {
    if (!reached[i]) continue;
    const PlanNode& node = plan->nodes[i];
    const Device device = executor_of(node).device();
    Hasher hasher;
    hasher.add(node.static_key).add(device.kind).add(device.index);
    if (node.node->depends_on_frame()) hasher.add(frame);
    try {
      node.node->add_to_key(hasher, frame);
    } catch (...) {
      throw error_in_flight(node.where);
    }
    for (const auto& port : node.inputs) {
      hasher.add(port.size());
      for (const Source source : port) hasher.add(keys[static_cast<size_t>(source.node)]).add(source.output);
    }
    keys[i] = hasher.key();
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

// The only place where data moves.
Buffer<std::byte> Evaluator::Impl::copied(const Buffer<std::byte>& buffer, Device there) {
  ++transfers;
  transferred_bytes += buffer.bytes();
  Buffer<std::byte> copy(buffer.size(), there == Device{} ? host_memory() : device->memory());
  device->copy(buffer.view(buffer.device()).data(), buffer.device(), copy.data_for_write(), there, buffer.bytes());
  device->synchronise();
  return copy;
}

// Fills the round for the targets: from the cache, and by running what it lacks. Checked mode runs everything, to compare.
void Evaluator::Impl::fill(FrameState& state, const std::vector<Source>& targets) {
  find_keys(state.frame, reached_from(targets), state.keys);
  std::vector<char> wanted(plan->nodes.size());
  for (const Source target : targets) wanted[static_cast<size_t>(target.node)] = true;
  std::vector<int> lacking;
  for (size_t i = wanted.size(); i-- > 0;) {
    if (!wanted[i]) continue;
    const PlanNode& node = plan->nodes[i];
    Cache::Result result;
    if (!options.checked && !node.node->has_effect() && cache->find(state.keys[i], result)) {
      state.round.values[i] = std::move(result.outputs);
      state.times[i].push_back({node.name, 0, true});
      state.warnings[i] = std::move(result.warnings);
      continue;
    }
    lacking.push_back(static_cast<int>(i));
    for (const auto& port : node.inputs)
      for (const Source source : port) wanted[static_cast<size_t>(source.node)] = true;
  }
  std::reverse(lacking.begin(), lacking.end());
  run_nodes(state, lacking);
}

// Independent nodes at once. A node that fails stops only what needs it; then the first error in plan order is thrown, the same for any number of
// threads.
void Evaluator::Impl::run_nodes(FrameState& state, const std::vector<int>& nodes) {
  if (nodes.empty()) return;
  std::vector<int> task_of(plan->nodes.size(), -1);
  for (size_t t = 0; t < nodes.size(); ++t) task_of[static_cast<size_t>(nodes[t])] = static_cast<int>(t);
  std::vector<std::vector<int>> successors(nodes.size());
  std::vector<int> waits_for(nodes.size());
  for (size_t t = 0; t < nodes.size(); ++t)
    for (const auto& port : node_at(nodes[t]).inputs)
      for (const Source source : port)
        if (const int before = task_of[static_cast<size_t>(source.node)]; before >= 0) {
          successors[static_cast<size_t>(before)].push_back(static_cast<int>(t));
          ++waits_for[t];
        }
  if (state.in_order)
    for (const int node : nodes) run_node(state, node);
  else
    host->run_graph(successors, waits_for, [&](int t) { run_node(state, nodes[static_cast<size_t>(t)]); });
  const std::optional<Error>* first = nullptr;
  for (const std::optional<Error>& error : state.errors) {
    if (error && error->code() == ErrorCode::kCancelled) throw *error;
    if (error && !first) first = &error;
  }
  if (first) throw **first;
}

void Evaluator::Impl::run_node(FrameState& state, int i) {
  const PlanNode& node = node_at(i);
  const auto index = static_cast<size_t>(i);
  for (const auto& port : node.inputs)
    for (const Source source : port) {
      state.failed[index] |= state.failed[static_cast<size_t>(source.node)];
      merge(state.warnings[index], state.warnings[static_cast<size_t>(source.node)]);
    }
  if (state.failed[index]) return;
  try {
    const auto start = std::chrono::steady_clock::now();
    FrameContext context(*this, state, i);
    context.check_cancelled();
    context.bring_inputs();
    ++evaluations[index];
    try {
      context.evaluate();
    } catch (...) {
      let_end(context.executor());  // what it has launched reads what other threads may free once it has failed
      throw;
    }
    context.executor().synchronise();  // what is published is complete, for every thread
    state.times[index].push_back({node.name, seconds_since(start), false});
    seconds[index] += state.times[index].back().seconds;
    for (NodeTime& part : context.parts) state.times[index].push_back(std::move(part));
    merge(state.warnings[index], context.warnings);
    if (node.node->has_effect()) return;
    if (Cache::Result cached; options.checked && cache->find(state.keys[index], cached)) context.compare(cached);
    cache->store(state.keys[index], {context.outputs(), state.warnings[index]});
  } catch (...) {
    state.failed[index] = true;
    state.errors[index] = error_in_flight(node.where);
  }
}

Evaluator::Evaluator(std::shared_ptr<const Plan> plan, EvaluatorOptions options) : impl_(std::make_unique<Impl>()) {
  impl_->plan = std::move(plan);
  impl_->options = options;
  if (!options.executor) impl_->own_executor = make_cpu_executor();
  impl_->device = options.executor ? options.executor : impl_->own_executor.get();
  if (!options.host_executor && impl_->device->device() != Device{}) impl_->own_host = make_cpu_executor();
  impl_->host = options.host_executor ? options.host_executor : impl_->own_host ? impl_->own_host.get() : impl_->device;
  impl_->cache = options.cache ? options.cache : std::make_shared<Cache>();
  impl_->evaluations = std::vector<std::atomic<uint64_t>>(impl_->plan->nodes.size());
  impl_->seconds = std::vector<std::atomic<double>>(impl_->plan->nodes.size());
}
Evaluator::~Evaluator() = default;

const Plan& Evaluator::plan() const {
  return *impl_->plan;
}
Executor& Evaluator::executor() const {
  return *impl_->device;
}

FrameResult Evaluator::evaluate(int frame, const std::vector<std::string>& outputs, bool effects) {
  return impl_->evaluate(frame, outputs, effects, false);
}

FrameResult Evaluator::Impl::evaluate(int frame, const std::vector<std::string>& outputs, bool effects, bool in_order) {
  const std::vector<Source> targets = targets_of(outputs, effects);
  const auto start = std::chrono::steady_clock::now();
  FrameResult result;
  result.frame = frame;
  FrameState state(frame, *plan);
  state.in_order = in_order;
  try {
    fill(state, targets);
    for (size_t i = 0; i < outputs.size(); ++i) result.values[outputs[i]] = brought(state.round.at(targets[i]), Device{});
  } catch (...) {
    result.error = error_in_flight();
    result.values.clear();
  }
  for (auto& times : state.times)
    for (NodeTime& time : times) result.times.push_back(std::move(time));
  for (const auto& warnings : state.warnings) merge(result.warnings, warnings);
  result.seconds = seconds_since(start);
  return result;
}

namespace {

// A node that was run before its frame is in the cache when the frame asks for it: it gets its times back.
std::vector<NodeTime> in_place_of_cached(const std::vector<NodeTime>& times, const std::vector<std::vector<NodeTime>>& prepared) {
  std::vector<NodeTime> result;
  for (const NodeTime& time : times) {
    const auto known = std::find_if(prepared.begin(), prepared.end(),
                                    [&](const auto& parts) { return time.cached && !parts.empty() && parts.front().name == time.name; });
    if (known == prepared.end())
      result.push_back(time);
    else
      result.insert(result.end(), known->begin(), known->end());
  }
  return result;
}

}  // namespace

void Evaluator::evaluate_frames(const std::vector<int>& frames, const std::vector<std::string>& outputs, bool effects,
                                const std::function<void(FrameResult)>& done) {
  if (frames.empty()) return;
  const std::vector<std::vector<NodeTime>> prepared = prepare(frames, outputs, effects);
  const auto with_prepared = [&](FrameResult result) {
    if (result.frame == frames.front()) result.times = in_place_of_cached(result.times, prepared);
    done(std::move(result));
  };
  const std::vector<int> starved =
      run_frames(frames, std::max(impl_->host->threads(), impl_->device->frames_at_once()), outputs, effects, with_prepared);
  run_frames(starved, 1, outputs, effects, with_prepared);
}

namespace {

// Lanes on threads of their own, which may wait for each other at the device: a thread of the host executor's must not, for the others would wait for
// it.
void run_on_threads(Executor& device, size_t lanes, FunctionRef<void()> lane) {
  std::mutex mutex;
  std::exception_ptr error;
  std::vector<std::thread> threads;
  std::latch all(static_cast<std::ptrdiff_t>(lanes));
  const auto run = [&] {
    device.begin_frames();
    all.arrive_and_wait();  // the first to reach a loop waits for those that follow
    try {
      lane();
    } catch (...) {
      const std::lock_guard lock(mutex);
      error = std::current_exception();
    }
    device.end_frames();
  };
  try {
    while (threads.size() < lanes) threads.emplace_back(run);
  } catch (const std::system_error&) {  // no more threads: those that are there do it
    if (threads.empty()) throw;
    all.count_down(static_cast<std::ptrdiff_t>(lanes - threads.size()));
  }
  for (std::thread& thread : threads) thread.join();
  if (error) std::rethrow_exception(error);
}

}  // namespace

// Returns the frames that found too little memory beside others: each may have enough of it alone.
std::vector<int> Evaluator::run_frames(const std::vector<int>& frames, int at_once, const std::vector<std::string>& outputs, bool effects,
                                       const std::function<void(FrameResult)>& done) {
  const size_t lanes = std::min(frames.size(), static_cast<size_t>(at_once));
  std::vector<int> starved;
  std::atomic<size_t> next{0};
  std::mutex mutex;
  const auto run_lane = [&](bool in_order) {
    for (size_t i; !impl_->cancelled() && (i = next++) < frames.size();) {
      FrameResult result = impl_->evaluate(frames[i], outputs, effects, in_order);
      if (result.error && result.error->code() == ErrorCode::kCancelled && impl_->cancelled()) return;
      const std::lock_guard lock(mutex);
      if (result.error && result.error->code() == ErrorCode::kMemory && lanes > 1) {
        starved.push_back(frames[i]);
        continue;
      }
      try {
        if (in_order) impl_->device->between_frames(true);  // `done` may evaluate on this device, and other frames wait for the lock
        done(std::move(result));
        if (in_order) impl_->device->between_frames(false);
      } catch (...) {
        next = frames.size();
        throw;
      }
    }
  };
  if (lanes > 1 && impl_->device->frames_at_once() > 1)
    run_on_threads(*impl_->device, lanes, [&] { run_lane(true); });
  else
    impl_->host->run_graph(std::vector<std::vector<int>>(lanes), std::vector<int>(lanes), [&](int) { run_lane(false); });
  return starved;
}

// Computes what the frames share: else each of those that run side by side would find it lacking and compute it, or wait for the one that does. Returns the
// times of every node.
std::vector<std::vector<NodeTime>> Evaluator::prepare(const std::vector<int>& frames, const std::vector<std::string>& outputs, bool effects) {
  const std::vector<PlanNode>& nodes = impl_->plan->nodes;
  const std::vector<Source> targets = impl_->targets_of(outputs, effects);
  const std::vector<char> reached = impl_->reached_from(targets);
  std::vector<Source> shared;
  const auto share = [&](Source source) {
    const PlanNode& node = nodes[static_cast<size_t>(source.node)];
    if (!node.frame_dependent && !node.node->has_effect()) shared.push_back(source);
  };
  for (const Source target : targets) share(target);
  for (size_t i = 0; i < nodes.size(); ++i)
    if (reached[i] && (nodes[i].frame_dependent || nodes[i].node->has_effect()))
      for (const auto& port : nodes[i].inputs)
        for (const Source source : port) share(source);
  if (frames.size() > 1)
    for (size_t i = 0; i < nodes.size(); ++i)
      if (reached[i] && nodes[i].frame_dependent && nodes[i].node->shares_parts()) shared.push_back({static_cast<int>(i), 0});
  FrameState state(frames.front(), *impl_->plan);
  try {
    impl_->fill(state, shared);
  } catch (...) {
    // Every frame that needs the failed node meets the same error and reports it.
  }
  return state.times;
}

Key Evaluator::frame_key(int frame, const std::vector<std::string>& outputs, bool effects) const {
  const std::vector<Source> targets = impl_->targets_of(outputs, effects);
  std::vector<Key> keys(impl_->plan->nodes.size());
  impl_->find_keys(frame, impl_->reached_from(targets), keys);
  Hasher hasher;
  hasher.add(frame);
  for (const Source target : targets) hasher.add(keys[static_cast<size_t>(target.node)]).add(target.output);
  return hasher.key();
}

EvaluatorFigures Evaluator::figures() const {
  EvaluatorFigures figures;
  figures.cache = impl_->cache->figures();
  for (size_t i = 0; i < impl_->evaluations.size(); ++i) {
    const PlanNode& node = impl_->plan->nodes[i];
    if (const uint64_t count = impl_->evaluations[i]) figures.evaluations[node.type->name] += count;
    if (const double seconds = impl_->seconds[i]; seconds > 0) figures.seconds[node.name] = seconds;
  }
  figures.transfers = impl_->transfers;
  figures.transferred_bytes = impl_->transferred_bytes;
  return figures;
}

}  // namespace knead
