// What several commands need.
#pragma once
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "app/commands.h"
#include "graph/executor.h"
#include "graph/plan.h"

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

// What every frame is asked for beside its files: the reports of all nodes, and where nothing is written the ends of the graph, so that it runs at
// all. Where some writers run alone, the reports of what these stand on, and of what measures that.
std::vector<std::string> wanted_outputs(const Plan& plan, bool some_alone);

// The sources behind `outputs` and the plan's writers.
std::vector<Source> targets_of(const Plan& plan, const std::vector<std::string>& outputs);

// Wall clock since the process began; what came before the first call is taken from the time that the processor spent.
double seconds_of_process();

// "1 frame", "3 frames"
std::string counted(size_t count, const char* what);
// "1-4, 7"
std::string frames_text(std::vector<int> frames);

}  // namespace knead::app
