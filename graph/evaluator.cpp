#include "graph/evaluator.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <mutex>
#include <set>

#include "graph/round.h"

namespace knead {

namespace {

double seconds_since(std::chrono::steady_clock::time_point start) { return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count(); }

// What the nodes of one frame share while they run, perhaps at once.
struct FrameState {
  int frame;
  const EvaluatorOptions& options;
  Cache& cache;
  std::mutex mutex;
  std::vector<std::string> warnings;
  std::vector<std::vector<NodeTime>> times;  // per plan node: itself, then its parts
};

class FrameContext final : public RoundContext {
 public:
  FrameContext(Round& round, int node, FrameState& state, Executor& executor) : RoundContext(round, node), state_(state), executor_(executor) {}

  int frame() const override {
    if (state_.options.checked && !plan_node().node->depends_on_frame())
      throw Error(ErrorCode::kInternal, "node type '" + plan_node().type->name + "' reads the frame without saying so", "override depends_on_frame()");
    return state_.frame;
  }
  Executor& executor() const override { return executor_; }
  bool cancelled() const override { return state_.options.cancelled && state_.options.cancelled(); }
  void warn(const std::string& message) override {
    std::lock_guard lock(state_.mutex);
    const std::string line = "node '" + plan_node().name + "': " + message;
    if (std::find(warnings.begin(), warnings.end(), line) == warnings.end()) warnings.push_back(line);
  }
  Value once(const Key& key, FunctionRef<Value()> make) override {
    return state_.cache.once(Hasher().add("once").add(plan_node().type->name).add(plan_node().type->version).add(key).key(), make);
  }
  void add_time(const std::string& part, double seconds) override { parts.push_back({part, seconds, false}); }

  const Value& input(int port, size_t i) const override { return moved_.empty() ? RoundContext::input(port, i) : moved_[static_cast<size_t>(port)][i]; }

  // Copies of the inputs whose buffers are on another device than the node's. The only place where data moves.
  void bring_inputs(Executor& device, std::atomic<uint64_t>& transfers, std::atomic<uint64_t>& bytes) {
    const Device here = executor_.device();
    bool all_here = true;
    for (const auto& port : plan_node().inputs)
      for (const Source source : port) all_here = all_here && (!round_.at(source) || round_.at(source).type()->on_device(round_.at(source), here));
    if (all_here) return;
    moved_.resize(plan_node().inputs.size());
    for (size_t port = 0; port < moved_.size(); ++port)
      for (const Source source : plan_node().inputs[port]) {
        Value value = round_.at(source);
        if (!value) continue;
        if (!value.type()->on_device(value, here)) {
          bytes += value.type()->bytes(value);
          ++transfers;
          value = here == Device{} ? value.type()->to_host(value, device) : value.type()->moved(value, device);
        }
        moved_[port].push_back(std::move(value));
      }
  }

  std::vector<std::string> warnings;
  std::vector<NodeTime> parts;

 private:
  FrameState& state_;
  Executor& executor_;
  std::vector<std::vector<Value>> moved_;
};

}  // namespace

struct Evaluator::Impl {
  std::shared_ptr<const Plan> plan;
  EvaluatorOptions options;
  std::unique_ptr<Executor> own_executor, own_host;
  Executor* device = nullptr;
  Executor* host = nullptr;
  std::shared_ptr<Cache> cache;
  std::vector<std::atomic<uint64_t>> evaluations;
  std::atomic<uint64_t> transfers{0}, transferred_bytes{0};

  Executor& executor_of(const PlanNode& node) const { return node.node->runs() == Runs::kHost ? *host : *device; }

  std::vector<Source> targets_of(const std::vector<std::string>& outputs, bool effects) const {
    std::vector<Source> targets;
    for (const std::string& output : outputs) targets.push_back(plan->find(output));
    if (effects)
      for (const int sink : plan->sinks()) targets.push_back({sink, 0});
    return targets;
  }

  std::vector<bool> reached_from(const std::vector<Source>& targets) const {
    std::vector<bool> reached(plan->nodes.size());
    for (const Source target : targets) reached[static_cast<size_t>(target.node)] = true;
    for (size_t i = plan->nodes.size(); i-- > 0;)
      if (reached[i])
        for (const auto& port : plan->nodes[i].inputs)
          for (const Source source : port) reached[static_cast<size_t>(source.node)] = true;
    return reached;
  }

  // Keys of the nodes reached, in plan order. Throws when a node cannot say what it depends on (a missing file).
  void keys_of(int frame, const std::vector<bool>& reached, std::vector<Key>& keys) const {
    keys.resize(plan->nodes.size());
    for (size_t i = 0; i < plan->nodes.size(); ++i) {
      if (!reached[i]) continue;
      const PlanNode& node = plan->nodes[i];
      Hasher hasher;
      hasher.add(node.static_key).add(executor_of(node).device().kind);
      if (node.node->depends_on_frame()) hasher.add(frame);
      try {
        node.node->add_to_key(hasher, frame);
      } catch (const Error& error) {
        throw error.at(node.where);
      }
      for (const auto& port : node.inputs) {
        hasher.add(port.size());
        for (const Source source : port) hasher.add(keys[static_cast<size_t>(source.node)]).add(source.output);
      }
      keys[i] = hasher.key();
    }
  }

  void run_node(int i, const Key& key, Round& round, FrameState& state) {
    const PlanNode& node = plan->nodes[static_cast<size_t>(i)];
    const auto start = std::chrono::steady_clock::now();
    FrameContext context(round, i, state, executor_of(node));
    try {
      context.check_cancelled();
      context.bring_inputs(*device, transfers, transferred_bytes);
      ++evaluations[static_cast<size_t>(i)];
      node.node->evaluate(context);
      for (size_t k = 0; k < node.node->outputs().size(); ++k)
        if (!round.values[static_cast<size_t>(i)][k])
          throw Error(ErrorCode::kInternal, "node type '" + node.type->name + "' did not set its output '" + node.node->outputs()[k].name + "'");
    } catch (const Error& error) {
      throw error.at(node.where);
    } catch (const std::bad_alloc&) {
      throw Error(ErrorCode::kMemory, node.where, "out of memory");
    } catch (const std::exception& error) {
      throw Error(ErrorCode::kInternal, node.where, error.what());
    }
    auto& times = state.times[static_cast<size_t>(i)];
    times.push_back({node.name, seconds_since(start), false});
    for (NodeTime& part : context.parts) times.push_back(std::move(part));
    if (!node.node->has_effect()) cache->store(key, {round.values[static_cast<size_t>(i)], context.warnings});
    keep_warnings(state, context.warnings);
  }

  static void keep_warnings(FrameState& state, const std::vector<std::string>& warnings) {
    std::lock_guard lock(state.mutex);
    state.warnings.insert(state.warnings.end(), warnings.begin(), warnings.end());
  }

  // Fills the round for the targets: from the cache, and by running what it lacks.
  void fill(Round& round, const std::vector<Source>& targets, FrameState& state) {
    const size_t n = plan->nodes.size();
    const std::vector<bool> reached = reached_from(targets);
    std::vector<Key> keys;
    keys_of(state.frame, reached, keys);
    std::vector<bool> wanted(n), runs(n);
    for (const Source target : targets) wanted[static_cast<size_t>(target.node)] = true;
    for (size_t i = n; i-- > 0;) {
      if (!wanted[i]) continue;
      Cache::Result result;
      if (!plan->nodes[i].node->has_effect() && cache->find(keys[i], result)) {
        if (options.checked) check_cached(static_cast<int>(i), result, state);
        round.values[i] = result.outputs;
        state.times[i].push_back({plan->nodes[i].name, 0, true});
        keep_warnings(state, result.warnings);
        continue;
      }
      runs[i] = true;
      for (const auto& port : plan->nodes[i].inputs)
        for (const Source source : port) wanted[static_cast<size_t>(source.node)] = true;
    }
    run_wanted(round, runs, keys, state);
  }

  void run_wanted(Round& round, const std::vector<bool>& runs, const std::vector<Key>& keys, FrameState& state) {
    std::vector<int> tasks;
    std::vector<int> task_of(runs.size(), -1);
    for (size_t i = 0; i < runs.size(); ++i)
      if (runs[i]) {
        task_of[i] = static_cast<int>(tasks.size());
        tasks.push_back(static_cast<int>(i));
      }
    std::vector<std::vector<int>> successors(tasks.size());
    std::vector<int> waits_for(tasks.size());
    for (size_t t = 0; t < tasks.size(); ++t)
      for (const auto& port : plan->nodes[static_cast<size_t>(tasks[t])].inputs)
        for (const Source source : port)
          if (const int before = task_of[static_cast<size_t>(source.node)]; before >= 0) {
            successors[static_cast<size_t>(before)].push_back(static_cast<int>(t));
            ++waits_for[t];
          }
    host->run_graph(successors, waits_for, [&](int t) {
      const int i = tasks[static_cast<size_t>(t)];
      run_node(i, keys[static_cast<size_t>(i)], round, state);
    });
  }

  // Checked mode: a cached result must be what would be computed again.
  void check_cached(int i, const Cache::Result& cached, FrameState& state) {
    const PlanNode& node = plan->nodes[static_cast<size_t>(i)];
    Round again(*plan);
    std::vector<Source> inputs;
    for (const auto& port : node.inputs) inputs.insert(inputs.end(), port.begin(), port.end());
    fill(again, inputs, state);
    FrameContext context(again, i, state, executor_of(node));
    context.bring_inputs(*device, transfers, transferred_bytes);
    node.node->evaluate(context);
    for (size_t k = 0; k < cached.outputs.size(); ++k) {
      const Value& was = cached.outputs[k];
      const Value& is = again.values[static_cast<size_t>(i)][k];
      if (was.type()->content(was) != is.type()->content(is))
        throw Error(ErrorCode::kInternal, node.where, "output '" + node.node->outputs()[k].name + "' differs from its cached result",
                    "the node depends on something that its key does not name, or its version was not raised");
    }
  }
};

Evaluator::Evaluator(std::shared_ptr<const Plan> plan, EvaluatorOptions options) : impl_(std::make_unique<Impl>()) {
  impl_->plan = std::move(plan);
  impl_->options = options;
  if (!options.executor) impl_->own_executor = make_cpu_executor();
  impl_->device = options.executor ? options.executor : impl_->own_executor.get();
  if (!options.host_executor && impl_->device->device() != Device{}) impl_->own_host = make_cpu_executor();
  impl_->host = options.host_executor ? options.host_executor : impl_->own_host ? impl_->own_host.get() : impl_->device;
  impl_->cache = options.cache ? options.cache : std::make_shared<Cache>();
  impl_->evaluations = std::vector<std::atomic<uint64_t>>(impl_->plan->nodes.size());
}
Evaluator::~Evaluator() = default;

const Plan& Evaluator::plan() const { return *impl_->plan; }
Executor& Evaluator::executor() const { return *impl_->device; }

FrameResult Evaluator::evaluate(int frame, const std::vector<std::string>& outputs, bool effects) {
  const std::vector<Source> targets = impl_->targets_of(outputs, effects);
  const auto start = std::chrono::steady_clock::now();
  FrameResult result;
  result.frame = frame;
  FrameState state{frame, impl_->options, *impl_->cache, {}, {}, {}};
  state.times.resize(impl_->plan->nodes.size());
  Round round(*impl_->plan);
  try {
    impl_->fill(round, targets, state);
    for (size_t i = 0; i < outputs.size(); ++i) {
      const Value& value = round.at(targets[i]);
      result.values[outputs[i]] = value.type()->on_device(value, Device{}) ? value : value.type()->to_host(value, *impl_->device);
    }
  } catch (const Error& error) {
    result.error = error;
  } catch (const std::bad_alloc&) {
    result.error = Error(ErrorCode::kMemory, "out of memory");
  }
  for (auto& times : state.times)
    for (NodeTime& time : times) result.times.push_back(std::move(time));
  std::sort(state.warnings.begin(), state.warnings.end());
  state.warnings.erase(std::unique(state.warnings.begin(), state.warnings.end()), state.warnings.end());
  result.warnings = std::move(state.warnings);
  result.seconds = seconds_since(start);
  return result;
}

void Evaluator::evaluate_frames(const std::vector<int>& frames, const std::vector<std::string>& outputs, bool effects,
                                const std::function<void(FrameResult)>& done) {
  const auto cancelled = [&] { return impl_->options.cancelled && impl_->options.cancelled(); };
  if (frames.empty()) return;
  prepare(frames, outputs, effects);
  const size_t n = frames.size();
  std::mutex mutex;
  impl_->host->run_graph(std::vector<std::vector<int>>(n), std::vector<int>(n), [&](int i) {
    if (cancelled()) return;
    FrameResult result = evaluate(frames[static_cast<size_t>(i)], outputs, effects);
    if (result.error && result.error->code() == ErrorCode::kCancelled) return;
    std::lock_guard lock(mutex);
    done(std::move(result));
  });
}

void Evaluator::prepare(const std::vector<int>& frames, const std::vector<std::string>& outputs, bool effects) {
  const std::vector<bool> reached = impl_->reached_from(impl_->targets_of(outputs, effects));
  std::vector<Source> still;
  for (size_t i = 0; i < reached.size(); ++i) {
    const PlanNode& node = impl_->plan->nodes[i];
    if (reached[i] && !node.frame_dependent && !node.node->has_effect() && !node.node->outputs().empty()) still.push_back({static_cast<int>(i), 0});
  }
  FrameState state{frames.front(), impl_->options, *impl_->cache, {}, {}, {}};
  state.times.resize(impl_->plan->nodes.size());
  Round round(*impl_->plan);
  try {
    impl_->fill(round, still, state);
  } catch (const Error&) {
    // Every frame that needs the failed node meets the same error and reports it.
  }
}

Key Evaluator::frame_key(int frame, const std::vector<std::string>& outputs, bool effects) const {
  const std::vector<Source> targets = impl_->targets_of(outputs, effects);
  std::vector<Key> keys;
  impl_->keys_of(frame, impl_->reached_from(targets), keys);
  Hasher hasher;
  hasher.add(frame);
  for (const Source target : targets) hasher.add(keys[static_cast<size_t>(target.node)]);
  return hasher.key();
}

EvaluatorFigures Evaluator::figures() const {
  EvaluatorFigures figures;
  figures.cache = impl_->cache->figures();
  for (size_t i = 0; i < impl_->evaluations.size(); ++i)
    if (const uint64_t count = impl_->evaluations[i]) figures.evaluations[impl_->plan->nodes[i].type->name] += count;
  figures.transfers = impl_->transfers;
  figures.transferred_bytes = impl_->transferred_bytes;
  return figures;
}

}  // namespace knead
