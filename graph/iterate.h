// Internal: the loop node. The compiler fills in its body; see iterate.cpp for the manual page.
#pragma once
#include <vector>

#include "graph/api.h"
#include "graph/plan.h"

namespace knead {

struct LoopProgress;
struct PlanValues;

class KNEAD_API Iterate : public Node {  // the program looks into loops
 public:
  Param<int> max_iterations{this, "max_iterations", 250, {.min = 0, .max = 1000000, .doc = "rounds after which the loop ends in any case"}};
  Param<int> min_iterations{this, "min_iterations", 1, {.min = 0, .max = 1000000, .doc = "rounds that are always made"}};
  Param<double> threshold{
      this, "threshold", 1e-4, {.min = 0, .unit = "fraction of the state's size", .doc = "at rest when the state changes less than this in a round"}};

  struct State {
    std::string name;
    const PortType* type = nullptr;
    Source next;
  };

  // `body.externals` begins with the states, in order; the rest are captured from outside and follow the states among this node's inputs.
  void set_body(Plan body, std::vector<State> states);
  void add_input(InputDeclaration declaration) { inputs_.push_back(std::move(declaration)); }
  const Plan& body() const { return body_; }
  const std::vector<State>& states() const { return states_; }
  void hash_body(Hasher& hasher) const;

  void evaluate(Context& context) const override;
  bool depends_on_frame() const override;
  Runs runs() const override;
  void add_to_key(Hasher& hasher, int frame) const override;

 private:
  void find_last_readers();
  bool stay_on_device(Context& context, PlanValues& round, const std::vector<Value>& next, std::vector<double>& seconds,
                      LoopProgress& progress) const;
  [[noreturn]] void throw_broken(size_t state, int rounds) const;

  Plan body_;
  std::vector<State> states_;
  std::vector<std::vector<Source>> dies_after_;  // per body node: outputs that nothing reads any more in a round once it has run
};

}  // namespace knead
