// The commands of the program, one file each. They return the exit status and throw knead::Error.
#pragma once
#include <string>
#include <vector>

namespace knead::app {

enum ExitStatus { kGood = 0, kGraphWrong = 1, kFrameFailed = 2, kUsage = 3, kStrict = 4, kInterrupted = 130 };

struct GraphArguments {
  std::string graph;
  std::vector<std::string> sets;  // "node.param=value"
  std::string out;                // where relative paths of write_* nodes begin; empty: the current directory
  std::vector<std::string> only;  // writers that run alone
};

struct DeviceArguments {
  std::string device = "auto";
  int threads = 0;
};

struct RunArguments {
  GraphArguments graph;
  DeviceArguments device;
  std::string frames, stats;
  std::string strict;  // "rest,penetration=1e-3"; empty: not strict
  bool resume = false, checked = false, quiet = false, sheet = false;
};

int run(const RunArguments& arguments);
int check(const GraphArguments& arguments);
int show_graph(const GraphArguments& arguments, const DeviceArguments& device, bool dot);
int show_nodes(const std::string& name, bool schema, bool stats_schema, bool markdown);
int show_info();

}  // namespace knead::app
