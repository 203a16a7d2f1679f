// What a frame came to, from its line of figures: in this run, or in an earlier one that --resume builds on.
#pragma once
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "graph/plan.h"
#include "io/stats.h"

namespace knead::app {

struct Verdict {
  std::vector<NodeFigures> nodes;
  std::vector<std::string> restless;  // nodes that ended before they were at rest
  std::optional<bool> touched;        // whether anything was pressed; none where no report tells
  bool enclosed = false;              // a collider lies in the body, or the body in it: nothing pressed says nothing about their places
  bool warned = false;
  std::string ended;  // "118 iterations, at rest", of the last node that tells
};

class Judge {
 public:
  explicit Judge(const Plan& plan);
  Verdict judge(const std::string& line) const;

 private:
  // Nodes whose end is where another one begins: they need not come to rest themselves.
  std::set<std::string> beginnings_;
  std::set<std::string> solvers_;
  bool has_colliders_ = false;  // else nothing can touch, and nobody asks whether it did
};

}  // namespace knead::app
