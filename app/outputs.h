// The files that a run makes, found in the plan: every node with an effect that has a `path`.
#pragma once
#include <string>
#include <vector>

#include "graph/evaluator.h"
#include "graph/plan.h"
#include "io/stats.h"

namespace knead::app {

std::string path_of(const Node& node);  // its parameter `path`, or ""
std::vector<std::string> files_of(const Plan& plan, int frame);

// True when the frame was made from what its inputs are now and its files are as they were written then.
bool is_complete(const Evaluator& evaluator, const std::vector<std::string>& outputs, const FrameRecord& record);

// A contact sheet beside each numbered sequence of pictures; their names.
std::vector<std::string> write_sheets(const Plan& plan, const std::vector<int>& frames);

}  // namespace knead::app
