// Knead inside another program: a graph assembled by calls, and its frames made one by one in random order.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numeric>
#include <random>
#include <vector>

#include "graph/evaluator.h"
#include "kernels/port_types.h"

using knead::Literal;

int main() try {
  constexpr int kFrames = 12;

  // A ball comes down on a soft blob and goes up again.
  const Literal::Map above{{"translate", Literal::List{0.0, 2.2, 0.0}}}, pressed{{"translate", Literal::List{0.0, 1.1, 0.0}}};
  knead::GraphSpec graph;
  graph.add("body", "primitive", {{"shape", "blob"}, {"height", 2.0}})
      .add("ball", "primitive", {{"shape", "sphere"}, {"radius", 0.5}, {"resolution", 3}})
      .add("motion", "transform", {{"mesh", "ball"}, {"keys", Literal::Map{{1, above}, {kFrames / 2, pressed}, {kFrames, above}}}})
      .add("solid", "mesh_to_sdf", {{"mesh", "motion"}, {"voxel_size", 0.04}})
      .add("deform", "deform", {{"surface", "body"}, {"sdf", "solid"}, {"max_depth", 4}, {"max_iterations", 60}});

  // An evaluator keeps what frames share (the tet mesh, the distance field) and may be asked for any frame, from any thread.
  knead::Evaluator evaluator(knead::compile(graph));
  const auto rest = evaluator.get<knead::Surface>("body", 1);

  std::vector<int> frames(kFrames);
  std::iota(frames.begin(), frames.end(), 1);
  std::shuffle(frames.begin(), frames.end(), std::mt19937(7));
  std::vector<double> dents(kFrames + 1);
  for (const int frame : frames) {
    const auto surface = evaluator.get<knead::Surface>("deform.surface", frame);
    const auto points = surface.points.host(), rest_points = rest.points.host();
    for (size_t i = 0; i < points.size(); ++i) {
      const double moved = rest.placement.scale * length(to_double(points[i]) - to_double(rest_points[i]));
      dents[frame] = std::max(dents[frame], moved);
    }
  }
  for (int frame = 1; frame <= kFrames; ++frame) std::printf("frame %2d: a vertex moved by %.4f at most\n", frame, dents[frame]);

  const knead::EvaluatorFigures figures = evaluator.figures();
  std::printf("the tet mesh was built %d time(s) for %d frames\n", static_cast<int>(figures.evaluations.at("build_tets")), kFrames);
  const bool as_expected = dents[1] == 0 && dents[kFrames] == 0 && dents[kFrames / 2] > 0.1 && figures.evaluations.at("build_tets") == 1;
  std::puts(as_expected ? "as expected: untouched without contact, dented in the middle" : "NOT as expected");
  return as_expected ? 0 : 1;
} catch (const knead::Error& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
