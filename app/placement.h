// Where the meshes and fields of a graph lie, as far as that is known without solving anything, and what can meet what.
#pragma once
#include <cstddef>
#include <limits>
#include <string>
#include <vector>

#include "graph/evaluator.h"
#include "io/shape.h"

namespace knead::app {

struct Shape {
  std::string name;  // "motion", or "tets.surface" for an output that is not the node's first
  int frame = 0;
  Box box;
  std::string contents;  // "mesh of 2562 vertices, 5120 triangles, 1 piece"
};

// Whether a collider can press a body, by their boxes.
struct Reach {
  std::string body, collider;
  std::vector<int> frames;    // where the boxes meet
  std::vector<int> enclosed;  // of these, where one box lies in the other
  int nearest_frame = 0;      // of those where they do not
  double nearest_gap = std::numeric_limits<double>::infinity();
};

struct Placement {
  std::vector<Shape> shapes;  // of the first frame, and of the last where it is another
  std::vector<Reach> reaches;
  std::vector<std::string> warnings, errors;
  size_t frames_looked_at = 0;
};

// Evaluates every mesh and field that does not wait for a solver, at `frames`, or at kMostFrames of them, spread evenly.
Placement find_placement(Evaluator& evaluator, const std::vector<int>& frames);

// Lines for people.
std::string placement_text(const Placement& placement, size_t frames);

}  // namespace knead::app
