// Internal: the compiler, from a GraphSpec to a Plan. compile.cpp makes the nodes, compile_references.cpp finds what a name means, compile_nested.cpp
// goes into loops and groups. An error marks what it makes unusable as failed, so that it does not cause others.
#pragma once
#include <deque>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <vector>

#include "graph/iterate.h"
#include "graph/plan.h"

namespace knead {

// "a Surface", "an EquilibriumState".
inline std::string with_article(const std::string& type) {
  return (type.find_first_of("AEIOU") == 0 ? "an " : "a ") + type;
}

// What a node of the file has become: a node of the plan, or (a group) a list of sources per output.
struct CompiledNode {
  enum { kUntouched, kUnderWay, kDone } state = kUntouched;
  bool failed = false;
  int node = -1;
  bool is_group = false;
  std::vector<std::pair<std::string, std::vector<Source>>> group_outputs;
};

struct Reference {
  std::vector<Source> sources;
  bool failed = false;
};

// An argument of a node with group parameters and --set put in.
struct Argument {
  std::string name;
  const Literal* key;
  const Literal* value;  // null when it names a parameter that is not there, which has been reported
};

// The nodes among which names are looked up: the graph, a group or a loop's body.
struct Scope {
  const std::vector<NodeSpec>* specs = nullptr;
  std::string file;
  std::string prefix;       // "press."
  Plan* plan = nullptr;     // where its nodes go; a group shares that of its user
  Scope* parent = nullptr;  // names not found here are looked up there and captured; null across a group's border
  std::unordered_map<std::string_view, size_t> by_name;
  std::vector<CompiledNode> compiled;                      // as specs
  std::optional<std::map<std::string, Source>> states;     // of the loop
  std::optional<std::map<std::string, Reference>> inputs;  // of the group
  std::map<std::string, Literal> parameters;
  std::map<std::string, Where> given;           // where the user of the group set them; defaults are not there
  std::map<std::pair<int, int>, int> captured;  // parent's source -> external of plan
  std::vector<std::string> groups;              // files of the groups it stands in, outermost first
};

class Compiler {
 public:
  explicit Compiler(const CompileOptions& options) : options_(options), registry_(options.registry ? *options.registry : Registry::builtin()) {}
  std::shared_ptr<const Plan> run(const GraphSpec& spec);

 private:
  // compile.cpp
  void compile_scope(Scope& scope);
  void check_names(Scope& scope);
  CompiledNode& compile_node(Scope& scope, size_t i);
  void compile_arguments(Scope& scope, const NodeSpec& spec, CompiledNode& compiled);
  template <class Takes>
  std::vector<Argument> arguments_of(Scope& scope, const NodeSpec& spec, const Takes& takes);
  const Literal* substituted(Scope& scope, const Literal& value, const std::string& node);
  void substitute(Scope& scope, Literal& value, const std::string& node);
  void assign(Scope& scope, const std::vector<Argument>& arguments, PlanNode& plan_node, CompiledNode& compiled);
  bool set_param(Scope& scope, Node& node, const std::string& full, const Argument& argument);
  void report_unused_overrides(const Plan& plan);
  void leave_out_others(Plan& plan);

  // compile_references.cpp
  struct Wanted {
    const std::string& name;     // of the input, for messages
    const char* type = nullptr;  // null: any
    bool many = false;
  };
  enum class Lookup { kNowhere, kHere, kBroken, kNoSuchOutput };
  struct Found {
    Lookup result = Lookup::kNowhere;
    std::vector<Source> sources;
    std::vector<std::string> outputs;  // those that are there, for kNoSuchOutput
  };
  std::string way_to_type(const Plan& plan, Source source, const std::string& written, const char* type) const;
  std::string makers_of(const std::string& word) const;
  Reference connect(Scope& scope, const Literal& value, const Wanted& wanted, const std::string& node);
  Reference resolve(Scope& scope, const Literal& value, const std::string& node, const std::string& member);
  Found find(Scope& scope, const std::string& name, const std::string& output);
  std::vector<Source> captured(Scope& scope, const Scope& owner, std::vector<Source> sources);

  // compile_nested.cpp
  bool compile_loop(Scope& scope, const std::vector<Argument>& arguments, PlanNode& plan_node);
  bool start_states(Scope& scope, Scope& inner, const Literal::Map& state, Iterate& loop, PlanNode& plan_node, std::vector<Iterate::State>& states);
  bool find_next(Scope& scope, Scope& inner, const Literal& next, std::vector<Iterate::State>& states, const PlanNode& plan_node);
  void expand_group(Scope& scope, const NodeSpec& spec, const NodeType& type, const std::vector<Argument>& arguments, CompiledNode& compiled);
  std::optional<GraphSpec> load_group(Scope& scope, const NodeType& type, const std::vector<Argument>& arguments, const Where& where);
  void bind_group(Scope& scope, const GraphSpec& group, const std::vector<Argument>& arguments, const Where& where, Scope& inner,
                  const std::string& own_parameter);

  void fail(Where where, const std::string& message, const std::string& hint = {}) {
    errors_.emplace_back(ErrorCode::kGraph, std::move(where), message, hint);
  }
  // For a group's parameter where it was given: its user does not know what is inside.
  Where where_of(const Scope& scope, const Literal& at, const std::string& node, const std::string& member = {}) const;
  static Where where_of(const Scope& scope, const NodeSpec& spec) { return {scope.file, spec.line, spec.column, scope.prefix + spec.name, {}}; }
  void take_errors(const Where& where);  // of the exception being handled
  // "did you mean 'b'?", or all that would have been right after `otherwise` where none is near.
  static std::string did_you_mean(const std::string& wrong, const std::vector<std::string>& known, const char* otherwise = nullptr);

  const CompileOptions& options_;
  const Registry& registry_;
  std::deque<Literal> substituted_;        // arguments that are not as they stand in the file
  std::map<const Literal*, Where> given_;  // of those in substituted_ that a group was given
  std::vector<std::string> stack_;         // names of the nodes under way
  std::vector<Error> errors_;
  std::set<size_t> used_overrides_;
  std::vector<std::string> opaque_;            // prefixes of what could not be looked into: --set for something in there is not blamed
  std::vector<std::string> group_parameters_;  // "deform.stiffness"
  int groups_expanded_ = 0;
};

}  // namespace knead
