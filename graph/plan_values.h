// Internal: one pass over a plan's nodes. The evaluator makes one per frame, a loop one for all of its rounds.
#pragma once
#include <vector>

#include "graph/plan.h"

namespace knead {

struct PlanValues {
  const Plan& plan;
  std::vector<std::vector<Value>> values;  // [node][output]
  std::vector<Value> externals;

  explicit PlanValues(const Plan& p) : plan(p), values(p.nodes.size()), externals(p.externals.size()) {
    for (size_t i = 0; i < p.nodes.size(); ++i) values[i].resize(p.nodes[i].node->outputs().size());
  }
  Value& at(Source source) {
    return source.node == Source::kExternal ? externals[static_cast<size_t>(source.output)]
                                            : values[static_cast<size_t>(source.node)][static_cast<size_t>(source.output)];
  }
};

// The part of a Context that reads a node's inputs from a round and puts its outputs there. A source without a value (a loop's state before its first
// round) counts as not connected.
class PlanContext : public Context {
 public:
  PlanContext(PlanValues& values, int node) : values_(values), node_(node) {}

  size_t input_count(int port) const override;
  const Value& input(int port, size_t i) const override;
  void set_output(int port, Value value) override { outputs()[static_cast<size_t>(port)] = std::move(value); }
  int frame() const final;

  // Runs the node: fresh outputs, all of them set, and in checked mode the inputs as they were. Throws Errors that know the node.
  void evaluate();

  const PlanNode& plan_node() const { return values_.plan.nodes[static_cast<size_t>(node_)]; }
  std::vector<Value>& outputs() { return values_.values[static_cast<size_t>(node_)]; }

 protected:
  virtual int frame_number() const = 0;
  const std::vector<Source>& sources(int port) const { return plan_node().inputs[static_cast<size_t>(port)]; }
  PlanValues& values_;
  int node_;

 private:
  Key content_of_inputs() const;
};

}  // namespace knead
