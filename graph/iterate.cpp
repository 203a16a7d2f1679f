#include "graph/iterate.h"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "graph/report.h"
#include "graph/round.h"

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

Body nodes that do not depend on the state run once. A round allocates nothing new: storage is used again as soon as its last reader has run.)";

// A body node sees its round, and through it what the loop's own context says of frame, executor, cancellation and cache.
class BodyContext final : public RoundContext {
 public:
  BodyContext(Round& round, int node, const std::vector<Source>& dies, Context& outer) : RoundContext(round, node), dies_(dies), outer_(outer) {}
  // What dies with its own maker has no reader.
  bool wants_output(int port) const override { return std::find(dies_.begin(), dies_.end(), Source{node_, port}) == dies_.end(); }
  Executor& executor() const override { return outer_.executor(); }
  bool checked() const override { return outer_.checked(); }
  bool cancelled() const override { return outer_.cancelled(); }
  void warn(const std::string& message) override { outer_.warn(message); }
  Value once(const Key& key, FunctionRef<Value()> make) override { return outer_.once(Hasher().add(plan_node().static_key).add(key).key(), make); }
  void add_time(const std::string& part, double seconds) override { outer_.add_time(part, seconds); }

 protected:
  int frame_number() const override { return outer_.frame(); }

 private:
  const std::vector<Source>& dies_;
  Context& outer_;
};

void run_body(Round& round, bool first, const std::vector<std::vector<Source>>& dies_after, std::vector<double>& seconds, Context& outer) {
  for (size_t i = 0; i < round.plan.nodes.size(); ++i) {
    if (!first && !round.plan.nodes[i].state_dependent) continue;
    const auto start = std::chrono::steady_clock::now();
    BodyContext(round, static_cast<int>(i), dies_after[i], outer).evaluate();
    for (const Source source : dies_after[i]) round.at(source) = Value();
    seconds[i] += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  }
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
  Round round(body_);
  for (size_t i = 0; i < body_.externals.size(); ++i)
    if (context.input_count(static_cast<int>(i))) round.externals[i] = context.input(static_cast<int>(i), 0);
  std::vector<double> seconds(body_.nodes.size());
  std::vector<Value> next(states_.size());
  double unrest = 0;
  int iterations = 0;
  bool at_rest = false;
  while (iterations < max_iterations() && !at_rest) {
    context.check_cancelled();
    run_body(round, iterations == 0, dies_after_, seconds, context);
    ++iterations;
    unrest = 0;
    bool measured = false;
    for (size_t s = 0; s < states_.size(); ++s) {
      next[s] = round.at(states_[s].next);
      if (!next[s] || !next[s].type()->unrest) continue;
      const Value& before = round.externals[s];
      const double change = next[s].type()->unrest(before ? before : next[s], next[s], context.executor());
      if (!std::isfinite(change))
        throw Error(ErrorCode::kInput, "state '" + states_[s].name + "' is no longer a number after " + std::to_string(iterations) + " rounds",
                    "lower the relaxation or the stiffness");
      unrest = std::max(unrest, change);
      measured = true;
    }
    for (size_t s = 0; s < states_.size(); ++s) round.externals[s] = std::move(next[s]);
    at_rest = measured && iterations >= min_iterations() && unrest <= threshold();
  }
  for (size_t i = 0; i < body_.nodes.size(); ++i) context.add_time(body_.nodes[i].name, seconds[i]);
  for (size_t s = 0; s < states_.size(); ++s) {
    if (!round.externals[s])
      throw Error(ErrorCode::kInput, "state '" + states_[s].name + "' has no value: it starts with none and no round was made",
                  "raise max_iterations");
    context.set_output(static_cast<int>(s), std::move(round.externals[s]));
  }
  Report report;
  report.set("iterations", iterations);
  report.set("ended", at_rest ? "at rest" : "iteration limit");
  report.set("unrest", unrest);
  context.set_output(static_cast<int>(states_.size()), Value::of(std::move(report)));
}

KNEAD_REGISTER(iterate, Iterate, 1, kManual)

}  // namespace knead
