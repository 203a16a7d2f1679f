// Whole frames of the examples, beside the plain reference; and what a run of loop_bench is told.
#pragma once
#include <string>
#include <vector>

#include "graph/executor.h"
#include "tests/bench/bodies.h"

namespace knead::bench {

struct Setting {
  std::string device = "cpu";
  std::vector<const Size*> sizes;
  std::vector<int> threads;
};

// Made once for each device and number of threads.
Executor& executor_of(const std::string& device, int threads);

void add_frames(const Setting& setting);

}  // namespace knead::bench
