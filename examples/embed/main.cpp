// Knead inside another program: a mesh from its own arrays, node types of its own, frames made one by one in random order, and cancelling.
#include <knead/knead.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <numeric>
#include <random>
#include <vector>

#include "own_nodes.h"

namespace {

using knead::Literal;
constexpr int kFrames = 12;

// A cushion: a torus' arrays, as a program has them. Rows of points, and two triangles between four of them.
knead::Surface cushion() {
  constexpr int kAround = 96, kAcross = 48;
  std::vector<knead::Vec3f> points;
  std::vector<uint32_t> triangles;
  for (int i = 0; i < kAround; ++i)
    for (int j = 0; j < kAcross; ++j) {
      const double a = 2 * M_PI * i / kAround, b = 2 * M_PI * j / kAcross, r = 0.8 + 0.4 * std::cos(b);
      points.push_back({static_cast<float>(r * std::cos(a)), static_cast<float>(0.4 * std::sin(b)), static_cast<float>(-r * std::sin(a))});
      const auto at = [&](int m, int n) { return static_cast<uint32_t>((i + m) % kAround * kAcross + (j + n) % kAcross); };
      for (const uint32_t corner : {at(0, 0), at(1, 0), at(1, 1), at(0, 0), at(1, 1), at(0, 1)}) triangles.push_back(corner);
    }
  return knead::make_triangle_surface(points, triangles);
}

// A ball comes down on the cushion and goes up again; then waves run over what is left of it.
knead::GraphSpec pressed_cushion() {
  const auto at = [](double x, double y) { return Literal::Map{{"translate", Literal::List{x, y, 0.0}}}; };
  knead::GraphSpec graph;
  graph.add("cushion", "host_mesh")
      .add("ball", "primitive", {{"shape", "sphere"}, {"radius", 0.5}, {"resolution", 3}})
      .add("motion", "transform", {{"mesh", "ball"}, {"keys", Literal::Map{{1, at(0.8, 2.0)}, {kFrames / 2, at(0.8, 0.8)}, {kFrames, at(0.8, 2.0)}}}})
      .add("solid", "mesh_to_sdf", {{"mesh", "motion"}, {"voxel_size", 0.04}})
      .add("deform", "deform", {{"surface", "cushion"}, {"sdf", "solid"}, {"max_depth", 4}, {"max_iterations", 60}})
      .add("waves", "ripple", {{"surface", "deform.surface"}, {"height", 0.02}});
  return graph;
}

double largest_move(const knead::Surface& a, const knead::Surface& b) {
  const auto from = a.points.host(), to = b.points.host();
  double most = 0;
  for (size_t i = 0; i < from.size(); ++i) most = std::max(most, a.placement.scale * length(to_double(to[i]) - to_double(from[i])));
  return most;
}

// `cancelled` is asked often, from any thread: here it says yes from the third time on. What was begun ends with an error that says so.
bool cancelling_works(const std::shared_ptr<const knead::Plan>& plan) {
  std::atomic<int> asked{0};
  knead::EvaluatorOptions options;
  options.cancelled = [&] { return ++asked > 2; };
  knead::Evaluator evaluator(plan, options);
  const knead::FrameResult result = evaluator.evaluate(kFrames / 2, {"waves"});
  return result.error && result.error->code() == knead::ErrorCode::kCancelled;
}

bool run() {
  knead::Registry registry = knead::Registry::builtin();
  add_own_nodes(registry, cushion());
  knead::CompileOptions options;
  options.registry = &registry;  // must outlive the plan
  const std::shared_ptr<const knead::Plan> plan = knead::compile(pressed_cushion(), options);

  // An evaluator keeps what frames share (the tet mesh, the distance field) and may be asked for any frame, from any thread.
  knead::Evaluator evaluator(plan);
  const auto rest = evaluator.get<knead::Surface>("cushion", 1);
  std::vector<int> frames(kFrames);
  std::iota(frames.begin(), frames.end(), 1);
  std::shuffle(frames.begin(), frames.end(), std::mt19937(7));
  std::vector<double> dents(kFrames + 1), waves(kFrames + 1);
  for (const int frame : frames) {
    const auto pressed = evaluator.get<knead::Surface>("deform.surface", frame);
    dents[frame] = largest_move(rest, pressed);
    waves[frame] = largest_move(pressed, evaluator.get<knead::Surface>("waves", frame));
  }
  for (int frame = 1; frame <= kFrames; ++frame)
    std::printf("frame %2d: a vertex moved by %.4f at most, a wave by %.4f\n", frame, dents[frame], waves[frame]);

  const auto built = evaluator.figures().evaluations.at("build_tets");
  const bool cancelled = cancelling_works(plan);
  std::printf("the tet mesh was built %d time(s) for %d frames; cancelling %s\n", static_cast<int>(built), kFrames,
              cancelled ? "works" : "does NOT work");
  return dents[1] == 0 && dents[kFrames] == 0 && dents[kFrames / 2] > 0.05 && std::abs(waves[kFrames / 2] - 0.02) < 1e-3 && built == 1 && cancelled;
}

}  // namespace

int main() try {
  const bool as_expected = run();
  std::puts(as_expected ? "as expected: untouched without contact, dented in the middle" : "NOT as expected");
  return as_expected ? 0 : 1;
} catch (const knead::Error& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
