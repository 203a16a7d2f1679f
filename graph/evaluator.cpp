#include "graph/evaluator.h"

#include <algorithm>
#include <chrono>

#include "graph/cancel.h"
#include "graph/frame_context.h"

namespace knead {
namespace {

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

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

std::vector<Source> Evaluator::Impl::targets_of(const std::vector<std::string>& outputs, bool effects) const {
  std::vector<Source> targets;
  for (const std::string& output : outputs) targets.push_back(plan->find(output));
  if (effects)
    for (const int sink : plan->sinks()) targets.push_back({sink, 0});
  return targets;
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

// Fills the frame's values for the targets: from the cache, and by running what it lacks. Checked mode runs everything, to compare.
void Evaluator::Impl::fill(FrameState& state, const std::vector<Source>& targets) {
  find_keys(state.frame, plan->reached_from(targets), state.keys);
  std::vector<char> wanted(plan->nodes.size());
  for (const Source target : targets) wanted[static_cast<size_t>(target.node)] = true;
  std::vector<int> lacking;
  for (size_t i = wanted.size(); i-- > 0;) {
    if (!wanted[i]) continue;
    const PlanNode& node = plan->nodes[i];
    Cache::Result result;
    if (!options.checked && !node.node->has_effect() && cache->find(state.keys[i], result)) {
      state.values.values[i] = std::move(result.outputs);
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
    const auto asked = [this] { return cancelled(); };
    const Cancellation cancellation(asked);
    const CancellationScope scope(options.cancelled ? &cancellation : nullptr);
    FrameContext context(*this, state, i);
    context.check_cancelled();
    context.bring_inputs();
    const bool parts_only = state.parts_only[index];
    evaluations[index] += !parts_only;
    try {
      parts_only ? node.node->make_parts(context) : context.evaluate();
    } catch (...) {
      let_end(context.executor());  // what it has launched reads what other threads may free once it has failed
      throw;
    }
    context.executor().synchronise();  // what is published is complete, for every thread
    state.times[index].push_back({node.name, std::max(0.0, seconds_since(start) - context.waited_seconds), false});
    seconds[index] += state.times[index].back().seconds;
    state.shared_seconds[index] = parts_only ? state.times[index].back().seconds : context.shared_seconds;
    if (parts_only) return;
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
  impl_->before = impl_->device->transfers();
  if (!options.host_executor && impl_->device->device() != Device{}) impl_->own_host = make_cpu_executor();
  impl_->host = options.host_executor ? options.host_executor : impl_->own_host ? impl_->own_host.get() : impl_->device;
  impl_->cache = options.cache ? options.cache : std::make_shared<Cache>();
  impl_->evaluations = std::vector<std::atomic<uint64_t>>(impl_->plan->nodes.size());
  impl_->seconds = std::vector<std::atomic<double>>(impl_->plan->nodes.size());
  impl_->set_up = std::vector<std::atomic<double>>(impl_->plan->nodes.size());
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
    for (size_t i = 0; i < outputs.size(); ++i) result.values[outputs[i]] = brought(state.values.at(targets[i]), Device{});
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

Key Evaluator::frame_key(int frame, const std::vector<std::string>& outputs, bool effects) const {
  const std::vector<Source> targets = impl_->targets_of(outputs, effects);
  std::vector<Key> keys(impl_->plan->nodes.size());
  impl_->find_keys(frame, plan().reached_from(targets), keys);
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
    if (const double seconds = impl_->set_up[i]; seconds > 0) figures.set_up[node.name] = seconds;
  }
  figures.set_up_seconds = impl_->set_up_seconds;
  const Transfers all = impl_->device->transfers();
  figures.moved = {impl_->moved, impl_->moved_bytes};
  figures.by_nodes.count = all.count - impl_->before.count - figures.moved.count;
  figures.by_nodes.bytes = all.bytes - impl_->before.bytes - figures.moved.bytes;
  return figures;
}

}  // namespace knead
