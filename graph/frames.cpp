#include <algorithm>
#include <atomic>
#include <exception>
#include <latch>
#include <mutex>
#include <system_error>
#include <thread>

#include "graph/frame_context.h"

namespace knead {
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

// Computes what the frames share: else each of those that run side by side would find it lacking and compute it, or wait for the one that does.
// Returns the times of every node.
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

}  // namespace knead
