#include <algorithm>
#include <atomic>
#include <chrono>
#include <exception>
#include <latch>
#include <mutex>
#include <optional>
#include <system_error>
#include <thread>

#include "graph/frame_context.h"

namespace knead {
namespace {

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace

// What the set-up found, per plan node.
struct Evaluator::Prepared {
  std::vector<std::vector<NodeTime>> times;  // the first frame's own work: empty for a node that does not depend on the frame
  std::vector<double> set_up;
  double first_frame_seconds = 0;  // wall clock, of that work

  // Nodes that the frame found in the cache get their set-up; in the first frame they also get their own times back.
  void complete(FrameResult& result, const Plan& plan, bool is_first) const {
    std::vector<NodeTime> completed;
    size_t at = 0;
    for (size_t i = 0; i < plan.nodes.size(); ++i) {
      const bool looked_at = at < result.times.size() && result.times[at].name == plan.nodes[i].name;
      const bool cached = looked_at && result.times[at].cached;
      const size_t first = completed.size();
      if (is_first && !times[i].empty() && (cached || !looked_at)) {
        completed.insert(completed.end(), times[i].begin(), times[i].end());
        at += looked_at;
      } else if (looked_at) {
        do completed.push_back(std::move(result.times[at++]));
        while (at < result.times.size() && (i + 1 == plan.nodes.size() || !starts_node(plan, i + 1, result.times[at].name)));
      } else if (set_up[i] > 0) {
        completed.push_back({plan.nodes[i].name, 0, true});
      }
      if (completed.size() > first) completed[first].set_up = set_up[i];
    }
    result.times = std::move(completed);
    if (is_first) result.seconds += first_frame_seconds;
  }

 private:
  // Parts of a loop follow it, under names that no plan node has.
  static bool starts_node(const Plan& plan, size_t from, const std::string& name) {
    return std::any_of(plan.nodes.begin() + static_cast<std::ptrdiff_t>(from), plan.nodes.end(),
                       [&](const PlanNode& node) { return node.name == name; });
  }
};

void Evaluator::evaluate_frames(const std::vector<int>& frames, const std::vector<std::string>& outputs, bool effects,
                                const std::function<void(FrameResult)>& done) {
  if (frames.empty()) return;
  std::optional<Prepared> prepared;
  if (frames.size() > 1) prepared = prepare(frames.front(), outputs, effects);
  const auto with_prepared = [&](FrameResult result) {
    if (prepared) prepared->complete(result, plan(), result.frame == frames.front());
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

namespace {

// Per plan node: of these, which share parts, it need not be evaluated for them, since no other one stands on it.
std::vector<char> made_without_outputs(const Plan& plan, const std::vector<Source>& sharing) {
  std::vector<char> without(plan.nodes.size());
  for (const Source source : sharing) {
    std::vector<Source> others = sharing;
    std::erase(others, source);
    without[static_cast<size_t>(source.node)] = !plan.reached_from(others)[static_cast<size_t>(source.node)];
  }
  return without;
}

}  // namespace

// Computes what the frames share: else each of those that run side by side would find it lacking and compute it, or wait for the one that does. What
// does not depend on the frame comes first, then those nodes of the first frame that make parts for all.
Evaluator::Prepared Evaluator::prepare(int first, const std::vector<std::string>& outputs, bool effects) {
  const std::vector<PlanNode>& nodes = plan().nodes;
  const std::vector<Source> targets = impl_->targets_of(outputs, effects);
  const std::vector<char> reached = plan().reached_from(targets);
  std::vector<Source> still, moving;
  const auto share = [&](Source source) {
    const PlanNode& node = nodes[static_cast<size_t>(source.node)];
    if (!node.frame_dependent && !node.node->has_effect()) still.push_back(source);
  };
  for (const Source target : targets) share(target);
  for (size_t i = 0; i < nodes.size(); ++i)
    if (reached[i] && (nodes[i].frame_dependent || nodes[i].node->has_effect())) {
      for (const auto& port : nodes[i].inputs)
        for (const Source source : port) share(source);
      if (nodes[i].frame_dependent && nodes[i].node->shares_parts()) moving.push_back({static_cast<int>(i), 0});
    }
  Prepared prepared;
  prepared.times.resize(nodes.size());
  prepared.set_up.resize(nodes.size());
  const auto start = std::chrono::steady_clock::now();
  double shared_parts = 0, moving_seconds = 0;
  for (const std::vector<Source>* part : {&still, &moving}) {
    const auto part_start = std::chrono::steady_clock::now();
    FrameState state(first, plan());
    if (part == &moving) state.parts_only = made_without_outputs(plan(), moving);
    try {
      impl_->fill(state, *part);
    } catch (...) {
      // Every frame that needs the failed node meets the same error and reports it.
    }
    if (part == &moving) moving_seconds = seconds_since(part_start);
    for (size_t i = 0; i < nodes.size(); ++i) {
      std::vector<NodeTime>& times = state.times[i];
      if (times.empty() || times.front().cached) continue;
      const double shared = nodes[i].frame_dependent ? state.shared_seconds[i] : times.front().seconds;
      prepared.set_up[i] += shared;
      impl_->set_up[i] += shared;
      if (!nodes[i].frame_dependent) continue;
      shared_parts += shared;
      if (state.parts_only[i]) continue;
      times.front().seconds -= shared;
      prepared.times[i] = std::move(times);
    }
  }
  prepared.first_frame_seconds = std::max(0.0, moving_seconds - shared_parts);
  impl_->set_up_seconds += seconds_since(start) - prepared.first_frame_seconds;
  return prepared;
}

}  // namespace knead
