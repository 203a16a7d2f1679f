// A compiled graph: node objects in topological order, their inputs resolved, everything checked. Immutable and shared by evaluators.
#pragma once
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "graph/hash.h"
#include "graph/node.h"
#include "graph/registry.h"
#include "graph/spec.h"

namespace knead {

struct Source {
  static constexpr int kExternal = -1;
  int node = kExternal;  // index into Plan::nodes, or kExternal
  int output = 0;        // of that node, or index into Plan::externals
  friend bool operator==(const Source&, const Source&) = default;
};

struct PlanNode {
  std::string name;  // with the groups and loops it stands in: "press.volume"
  const NodeType* type = nullptr;
  std::unique_ptr<Node> node;
  std::vector<std::vector<Source>> inputs;  // per input port
  Where where;
  Key static_key;                // type, version, parameters
  bool frame_dependent = false;  // itself or through its inputs
  bool state_dependent = false;  // in a loop's body: changes from round to round
  bool left_out = false;         // has an effect, but not in this plan (CompileOptions::only)
};

struct External {
  std::string name;
  const PortType* type;  // null: any
};

struct KNEAD_API Plan {
  std::string file;
  std::vector<int> frames;
  std::vector<PlanNode> nodes;
  std::vector<External> externals;
  std::map<std::string, Source> names;  // "press", "press.surface", "deform.surface": what evaluators can be asked for

  // The source behind "node" or "node.output". Throws Error(kGraph) with the nearest name.
  Source find(const std::string& reference) const;
  const PortType* type_of(Source source) const;
  std::vector<int> sinks() const;                                            // nodes with an effect
  std::vector<char> reached_from(const std::vector<Source>& targets) const;  // per node: a target, or something that a target stands on
};

struct CompileOptions {
  const Registry* registry = nullptr;                            // null: Registry::builtin()
  std::function<GraphSpec(const std::string& path)> load_group;  // reads a group's file; relative paths come resolved
  std::vector<std::pair<std::string, Literal>> overrides;        // "press.volume.relaxation" -> value, as --set
  std::vector<std::string> only;                                 // nodes with an effect, or groups of them, that have it; empty: all
};

// Checks everything and throws GraphErrors with all errors at once: unknown types, ports, parameters and references (with the nearest valid name),
// type mismatches, missing inputs, cycles, values out of range.
KNEAD_API std::shared_ptr<const Plan> compile(const GraphSpec& spec, const CompileOptions& options = {});

// The graph and its schedule for people, and for Graphviz.
KNEAD_API std::string plan_text(const Plan& plan, const Executor& executor);
KNEAD_API std::string plan_dot(const Plan& plan);

}  // namespace knead
