#include "graph/iterate.h"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "graph/ended.h"
#include "graph/loop.h"
#include "graph/plan_values.h"
#include "graph/report.h"

namespace knead {
namespace {

constexpr const char* kManual = R"(Runs a body of nodes again and again until it is at rest.

`state` names what goes round and where it starts; `none` starts a state empty, for nodes whose input is optional. `body` holds nodes as at the top of
a graph file. They read the state as `state.NAME` and may use any node outside the loop. `next` says, for every state, what it is in the next round.
The outputs are the states after the last round, by name, and `report`.

The loop ends when no state is further from rest than `threshold`, or after `max_iterations` rounds. Each type says how far from rest it is: a Surface
by its largest displacement in the round over its diagonal, Contacts by their deepest penetration over the diagonal; the others do not count, and
where no state counts, all rounds are made. The report says which: `iterations`, `ended` (`at rest` or `iteration limit`) and `unrest`, the last
round's distance from rest. A state that is no longer a number is an error.

Body nodes that do not depend on the state run once. A round allocates nothing new: storage is used again as soon as its last reader has run.

On a device the first round is run from the host, and the next one is recorded and then repeated on the device alone: nothing is transferred, allocated or
decided by the host until the loop ends. What changes from round to round must therefore be in the state's buffers. A body with a node of the host runs on the
host as a whole.)";

// A body node sees its round, and through it what the loop's own context says of frame, executor, cancellation and cache.
class BodyContext final : public PlanContext {
 public:
  BodyContext(PlanValues& round, int node, const std::vector<Source>& dies, Context& outer, LoopRecorder* recorder)
      : PlanContext(round, node), dies_(dies), outer_(outer), recorder_(recorder) {}
  // What dies with its own maker has no reader.
  bool wants_output(int port) const override { return std::find(dies_.begin(), dies_.end(), Source{node_, port}) == dies_.end(); }
  Executor& executor() const override { return recorder_ ? *recorder_ : outer_.executor(); }
  bool checked() const override { return outer_.checked(); }
  bool cancelled() const override { return outer_.cancelled(); }
  void warn(const std::string& message) override { outer_.warn(message); }
  Value once(const Key& key, FunctionRef<Value()> make) override {
    if (recorder_) recorder_->give_up("a part that frames share");  // it would outlive the recording
    return outer_.once(Hasher().add(plan_node().static_key).add(key).key(), make);
  }
  void add_time(const std::string& part, double seconds) override { outer_.add_time(part, seconds); }
  Buffer<std::byte> host_copy(const Buffer<std::byte>& buffer) override {
    if (recorder_) recorder_->give_up("a transfer");
    return outer_.host_copy(buffer);
  }

 protected:
  int frame_number() const override { return outer_.frame(); }

 private:
  const std::vector<Source>& dies_;
  Context& outer_;
  LoopRecorder* recorder_;  // null: rounds are run one by one
};

void run_body(PlanValues& round, bool first, const std::vector<std::vector<Source>>& dies_after, std::vector<double>& seconds, Context& outer,
              LoopRecorder* recorder = nullptr) {
  for (size_t i = 0; i < round.plan.nodes.size(); ++i) {
    if (!first && !round.plan.nodes[i].state_dependent) continue;
    const auto start = std::chrono::steady_clock::now();
    BodyContext(round, static_cast<int>(i), dies_after[i], outer, recorder).evaluate();
    for (const Source source : dies_after[i]) round.at(source) = Value();
    seconds[i] += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  }
}

constexpr int kRoundsOnDevice = 512;  // until the host looks whether it was cancelled

const uint32_t* words(const Buffer<std::byte>& buffer) {
  return reinterpret_cast<const uint32_t*>(buffer.view(buffer.device()).data());
}

// What has to be written over what, for the next state to be the state. False when the two differ in shape, or when one state becomes another.
bool find_ranges(const std::vector<Value>& state, const std::vector<Value>& next, Device device, LoopCommit& commit, size_t& longest) {
  std::vector<Buffer<std::byte>> to, from;
  for (const auto& [values, buffers] : {std::pair{&state, &to}, {&next, &from}})
    for (const Value& value : *values) {
      if (!value) return false;
      value.type()->with_buffers(value, [&](const Buffer<std::byte>& buffer) {
        buffers->push_back(buffer);
        return buffer;
      });
      buffers->emplace_back();  // parts states from each other
    }
  if (to.size() != from.size()) return false;
  for (size_t b = 0; b < to.size(); ++b) {
    if (to[b].size() != from[b].size()) return false;
    if (to[b].id() == from[b].id() || to[b].empty()) continue;
    if (to[b].device() != device || from[b].device() != device || commit.count == LoopCommit::kMostRanges) return false;
    for (const Buffer<std::byte>& other : to)
      if (other.id() == from[b].id()) return false;
    const size_t size = words_of(to[b].bytes());
    longest = std::max(longest, size);
    commit.ranges[commit.count++] = {words(from[b]), const_cast<uint32_t*>(words(to[b])), static_cast<uint32_t>(size)};
  }
  return true;
}

}  // namespace

void Iterate::set_body(Plan body, std::vector<State> states) {
  body_ = std::move(body);
  states_ = std::move(states);
  for (PlanNode& node : body_.nodes)
    for (const std::vector<Source>& sources : node.inputs)
      for (const Source source : sources)
        node.state_dependent |= source.node == Source::kExternal ? source.output < static_cast<int>(states_.size())
                                                                 : body_.nodes[static_cast<size_t>(source.node)].state_dependent;
  for (const State& state : states_) outputs_.push_back({state.name, state.type, {.doc = "the state after the last round"}});
  outputs_.push_back({"report", &port_type<Report>(), {.doc = "iterations, ended, unrest"}});
  find_last_readers();
}

// Storage is free for the next node as soon as its last reader has run, so that a round works in as little memory, and as much cache, as it can. What
// is made in the first round only stays, and so does what goes into the next round.
void Iterate::find_last_readers() {
  dies_after_.resize(body_.nodes.size());
  std::vector<std::vector<size_t>> last(body_.nodes.size());
  for (size_t i = 0; i < body_.nodes.size(); ++i) {
    last[i].assign(body_.nodes[i].node->outputs().size(), i);
    for (const std::vector<Source>& sources : body_.nodes[i].inputs)
      for (const Source source : sources)
        if (source.node != Source::kExternal) last[static_cast<size_t>(source.node)][static_cast<size_t>(source.output)] = i;
  }
  for (size_t i = 0; i < body_.nodes.size(); ++i)
    for (size_t k = 0; k < last[i].size(); ++k) {
      const Source source{static_cast<int>(i), static_cast<int>(k)};
      const bool goes_on = std::any_of(states_.begin(), states_.end(), [&](const State& state) { return state.next == source; });
      if (body_.nodes[i].state_dependent && !goes_on) dies_after_[last[i][k]].push_back(source);
    }
}

void Iterate::hash_body(Hasher& hasher) const {
  const auto add = [&](Source source) { hasher.add(source.node).add(source.output); };
  for (const PlanNode& node : body_.nodes) {
    hasher.add(node.static_key);
    for (const std::vector<Source>& sources : node.inputs) {
      hasher.add(sources.size());
      for (const Source source : sources) add(source);
    }
  }
  for (const State& state : states_) {
    hasher.add(state.name);
    add(state.next);
  }
}

bool Iterate::depends_on_frame() const {
  for (const PlanNode& node : body_.nodes)
    if (node.node->depends_on_frame()) return true;
  return false;
}

Runs Iterate::runs() const {
  for (const PlanNode& node : body_.nodes)
    if (node.node->runs() == Runs::kHost) return Runs::kHost;
  return Runs::kAnyDevice;
}

void Iterate::add_to_key(Hasher& hasher, int frame) const {
  for (const PlanNode& node : body_.nodes) node.node->add_to_key(hasher, frame);
}

void Iterate::evaluate(Context& context) const {
  PlanValues round(body_);
  for (size_t i = 0; i < body_.externals.size(); ++i)
    if (context.input_count(static_cast<int>(i))) round.externals[i] = context.input(static_cast<int>(i), 0);
  std::vector<double> seconds(body_.nodes.size());
  std::vector<Value> next(states_.size());
  LoopProgress progress;
  while (progress.iterations < max_iterations() && !progress.at_rest) {
    context.check_cancelled();
    run_body(round, progress.iterations == 0, dies_after_, seconds, context);
    for (size_t s = 0; s < states_.size(); ++s) next[s] = round.at(states_[s].next);
    if (progress.iterations == 0 && max_iterations() > 1 && stay_on_device(context, round, next, seconds, progress)) break;
    ++progress.iterations;
    progress.unrest = 0;
    bool measured = false;
    for (size_t s = 0; s < states_.size(); ++s) {
      if (!next[s] || !next[s].type()->unrest) continue;
      const Value& before = round.externals[s];
      const double change = context.on_host(next[s].type()->unrest(before ? before : next[s], next[s], context.executor())).host()[0];
      if (!std::isfinite(change)) throw_broken(s, progress.iterations);
      progress.unrest = std::max(progress.unrest, change);
      measured = true;
    }
    for (size_t s = 0; s < states_.size(); ++s) round.externals[s] = std::move(next[s]);
    progress.at_rest = measured && progress.iterations >= min_iterations() && progress.unrest <= threshold();
  }
  for (size_t i = 0; i < body_.nodes.size(); ++i) context.add_time(body_.nodes[i].name, seconds[i]);
  for (size_t s = 0; s < states_.size(); ++s) {
    if (!round.externals[s])
      throw Error(ErrorCode::kInput, "state '" + states_[s].name + "' has no value: it starts with none and no round was made",
                  "raise max_iterations");
    context.set_output(static_cast<int>(s), std::move(round.externals[s]));
  }
  Report report;
  report.set("iterations", progress.iterations);
  report.set("ended", text_of(progress.at_rest ? Ended::kAtRest : Ended::kIterationLimit));
  report.set("unrest", progress.unrest);
  context.set_output(static_cast<int>(states_.size()), Value::of(std::move(report)));
}

// The states in storage of their own, which is the same in every round.
static std::vector<Value> with_own_storage(const std::vector<Value>& states, Executor& executor) {
  std::vector<Value> own;
  for (const Value& value : states)
    own.push_back(value.type()->with_buffers(value, [&](const Buffer<std::byte>& from) {
      if (from.device() != executor.device()) return from;
      Buffer<std::byte> copy(from.size(), executor.memory());
      executor.launch(CopyWords{words(from), reinterpret_cast<uint32_t*>(copy.data_for_write())}, words_of(from.bytes()));
      return copy;
    }));
  return own;
}

// Makes the rounds after the first on the device, if the device can and nothing in the body needs the host. `round` and `next` are as the first round
// left them, not yet counted; where this is true the states are in round.externals and `progress` says how the loop ended.
bool Iterate::stay_on_device(Context& context, PlanValues& round, const std::vector<Value>& next, std::vector<double>& seconds,
                             LoopProgress& progress) const {
  Executor& executor = context.executor();
  const std::unique_ptr<LoopRecorder> recorder = executor.record_loop();
  if (!recorder) return false;

  if (std::any_of(next.begin(), next.end(), [](const Value& value) { return !value; })) return false;
  std::vector<Value> state = with_own_storage(next, executor);
  Buffer<LoopProgress> on_device(1, executor.memory());
  LoopEnd end{};
  end.progress = on_device.data_for_write();
  end.threshold = threshold();
  end.min_iterations = min_iterations();
  end.max_iterations = max_iterations();
  const auto measure = [&](const std::vector<Value>& before, const std::vector<Value>& after, Executor& on, std::vector<Buffer<double>>& kept) {
    end.count = 0;
    for (size_t s = 0; s < after.size(); ++s) {
      if (!after[s].type()->unrest) continue;
      if (end.count == LoopEnd::kMostStates) return false;
      kept.push_back(after[s].type()->unrest(before[s] ? before[s] : after[s], after[s], on));
      end.state[end.count] = static_cast<int32_t>(s);
      end.unrest[end.count++] = kept.back().view(on.device()).data();
    }
    return true;
  };
  std::vector<Buffer<double>> unrest;
  if (!measure(round.externals, next, executor, unrest)) return false;
  executor.launch(LoopBegin{end.progress}, 1);
  executor.launch(LoopGo{end.progress, 1}, 1);
  executor.launch(end, 1);

  // Recorded storage dies before the recorder does.
  PlanValues recorded = round;
  std::vector<Value> after(states_.size());
  std::vector<Buffer<double>> recorded_unrest;
  LoopCommit commit{};
  commit.progress = end.progress;
  size_t longest = 0;
  std::copy(state.begin(), state.end(), recorded.externals.begin());
  try {
    run_body(recorded, false, dies_after_, seconds, context, recorder.get());
    for (size_t s = 0; s < states_.size(); ++s) after[s] = recorded.at(states_[s].next);
    if (!measure(state, after, *recorder, recorded_unrest) || !find_ranges(state, after, executor.device(), commit, longest)) return false;
  } catch (const Error&) {
    if (recorder->gave_up()) return false;
    throw;
  }
  do {
    context.check_cancelled();
    progress = recorder->run(end, commit, longest, kRoundsOnDevice);
  } while (progress.going);
  if (progress.broken >= 0) throw_broken(static_cast<size_t>(progress.broken), progress.iterations);
  std::move(state.begin(), state.end(), round.externals.begin());
  return true;
}

void Iterate::throw_broken(size_t state, int rounds) const {
  throw Error(ErrorCode::kInput, "state '" + states_[state].name + "' is no longer a number after " + std::to_string(rounds) + " rounds",
              "lower the relaxation or the stiffness");
}

KNEAD_REGISTER(iterate, Iterate, 1, kManual)

}  // namespace knead
