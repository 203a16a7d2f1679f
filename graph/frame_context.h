// Internal: what a frame's evaluation is made of. evaluator.cpp decides what runs, frame_context.cpp serves the node that runs, frames.cpp runs many
// frames.
#pragma once
#include <atomic>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "graph/evaluator.h"
#include "graph/plan_values.h"

namespace knead {

// What the nodes of one frame share while they run, perhaps at once.
struct FrameState {
  FrameState(int f, const Plan& plan) : FrameState(f, plan, plan.nodes.size()) {}
  FrameState(int f, const Plan& plan, size_t n)
      : frame(f), values(plan), keys(n), times(n), shared_seconds(n), errors(n), failed(n), parts_only(n), warnings(n) {}

  int frame;
  PlanValues values;
  std::vector<Key> keys;                     // per plan node, as the rest
  std::vector<std::vector<NodeTime>> times;  // the node itself, then its parts
  std::vector<double> shared_seconds;        // of its time, what went into parts that frames share
  std::vector<std::optional<Error>> errors;
  std::vector<char> failed;      // it, or something that it needs
  std::vector<char> parts_only;  // makes the parts that frames share, and no outputs
  bool in_order = false;         // nodes one after the other, on the calling thread
  // Of the node and of all that it stands on: a frame that finds a node in the cache does not look at what is behind it.
  std::vector<std::vector<std::string>> warnings;
};

struct Evaluator::Impl {
  std::shared_ptr<const Plan> plan;
  EvaluatorOptions options;
  std::unique_ptr<Executor> own_executor, own_host;
  Executor* device = nullptr;
  Executor* host = nullptr;
  std::shared_ptr<Cache> cache;
  std::vector<std::atomic<uint64_t>> evaluations;
  std::vector<std::atomic<double>> seconds, set_up;
  std::atomic<double> set_up_seconds{0};
  Transfers before;  // the device's own count when this was made
  std::atomic<uint64_t> moved{0}, moved_bytes{0};

  const PlanNode& node_at(int i) const { return plan->nodes[static_cast<size_t>(i)]; }
  Executor& executor_of(const PlanNode& node) const { return node.node->runs() == Runs::kHost ? *host : *device; }
  bool cancelled() const { return options.cancelled && options.cancelled(); }

  std::vector<Source> targets_of(const std::vector<std::string>& outputs, bool effects) const;
  void find_keys(int frame, const std::vector<char>& reached, std::vector<Key>& keys) const;
  Value brought(const Value& value, Device there);
  Buffer<std::byte> brought(const Buffer<std::byte>& buffer, Device there);
  Buffer<std::byte> copied(const Buffer<std::byte>& buffer, Device there);
  FrameResult evaluate(int frame, const std::vector<std::string>& outputs, bool effects, bool in_order);
  void fill(FrameState& state, const std::vector<Source>& targets);
  void run_nodes(FrameState& state, const std::vector<int>& nodes);
  void run_node(FrameState& state, int i);
};

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
  double shared_seconds = 0;  // spent in what `once` made,
  double waited_seconds = 0;  // and in waiting for what it made for others

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

}  // namespace knead
