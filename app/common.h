// What several commands need.
#pragma once
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "app/commands.h"
#include "graph/executor.h"
#include "graph/plan.h"
#include "io/stats.h"

namespace knead::app {

// A mistake on the command line: exit status 3.
struct UsageError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// Reads, overrides and compiles. Throws GraphErrors and Error(kFile).
std::shared_ptr<const Plan> load_plan(const GraphArguments& arguments);

struct ExecutorChoice {
  std::string name;
  std::string description;  // "cpu, 8 threads"; for one that is absent, why
  bool present = false;
};
std::vector<ExecutorChoice> executor_choices();  // best first
std::unique_ptr<Executor> make_executor(const DeviceArguments& arguments);

// Nodes that make something nobody uses: probably a slip.
std::vector<std::string> unused_nodes(const Plan& plan);

// The plan's Report outputs, in plan order; those that another report takes in are left out.
std::vector<ReportOutput> report_outputs(const Plan& plan);

}  // namespace knead::app
