// The loop's kernels on one thread, per instruction set: time, and the bytes and entries of the tables that a pass must read.
#include <benchmark/benchmark.h>

#include <cmath>
#include <map>

#include "graph/executor.h"
#include "kernels/enforce_stiffness.h"
#include "kernels/hold.h"
#include "kernels/lattice_map.h"
#include "kernels/primitives.h"
#include "kernels/restore_volume.h"
#include "kernels/simd_level.h"
#include "kernels/tet_build.h"

namespace knead {
namespace {

struct Body {
  TetBuild built;
  Buffer<Vec3f> points;        // H, gently bent
  Buffer<Vec3f> displacement;  // of M
};

// The head of 2,400 vertices in H of the given depth.
const Body& body(int depth) {
  static std::map<int, Body> bodies;
  const auto found = bodies.find(depth);
  if (found != bodies.end()) return found->second;
  const auto executor = make_cpu_executor(1);
  Body& made = bodies[depth];
  std::vector<std::string> warnings;
  made.built = build_tets(make_head(2, 2400), {.max_depth = depth, .min_depth = depth - 3}, *executor, warnings);
  std::vector<Vec3f> bent;
  for (const Vec3f& p : made.built.tets.rest.host()) bent.push_back(p + Vec3f{0.2f * std::sin(0.3f * p.y), 0.2f * std::sin(0.3f * p.z), 0});
  made.points = Buffer<Vec3f>(bent);
  made.displacement = Buffer<Vec3f>(std::vector<Vec3f>(made.built.lattice.rest.vertices(), Vec3f{0.01f, 0, 0}));
  return made;
}

template <class Run>
void measure(benchmark::State& state, const NeighbourTable& table, const Run& run) {
  const auto level = static_cast<SimdLevel>(state.range(1));
  const std::vector<SimdLevel> levels = simd_levels();
  if (std::find(levels.begin(), levels.end(), level) == levels.end()) return state.SkipWithError("not on this processor");
  use_simd_level(level);
  const auto executor = make_cpu_executor(1);
  for (auto _ : state) benchmark::DoNotOptimize(run(*executor));
  use_simd_level(levels.back());
  state.SetLabel(name_of(level));
  const double entries = static_cast<double>(table.entries()) * static_cast<double>(state.iterations());
  state.SetItemsProcessed(static_cast<int64_t>(entries));
  state.SetBytesProcessed(static_cast<int64_t>(entries * 4 * (table.columns + 1)));
}

void volume(benchmark::State& state) {
  const Body& b = body(static_cast<int>(state.range(0)));
  RestoreVolumeSettings settings;
  settings.sweeps = 1;
  measure(state, b.built.tets.vertex_strips, [&](Executor& executor) { return restore_volume(executor, b.points, b.built.tets, settings); });
  state.counters["tets"] = static_cast<double>(b.built.tets.tets.size());
}

void stiffness(benchmark::State& state) {
  const Body& b = body(static_cast<int>(state.range(0)));
  measure(state, b.built.tets.vertex_edges, [&](Executor& executor) { return enforce_stiffness(executor, b.points, b.built.tets, {}); });
}

void held(benchmark::State& state) {
  const Body& b = body(static_cast<int>(state.range(0)));
  measure(state, b.built.tets.vertex_tets, [&](Executor& executor) { return hold(executor, b.points, b.built.tets, nullptr, {}); });
}

void to_tets(benchmark::State& state) {
  const Body& b = body(static_cast<int>(state.range(0)));
  measure(state, b.built.lattice.gather, [&](Executor& executor) { return map_to_tets(executor, b.displacement, b.points, b.built.lattice, {}); });
}

void to_surface(benchmark::State& state) {
  const Body& b = body(static_cast<int>(state.range(0)));
  measure(state, b.built.lattice.map, [&](Executor& executor) { return map_to_surface(executor, b.points, b.built.lattice); });
}

void cases(benchmark::internal::Benchmark* benchmark) {
  benchmark->ArgNames({"depth", "simd"})->ArgsProduct({{6, 8, 9}, {0, 1, 2, 3}})->Unit(benchmark::kMicrosecond);
}
BENCHMARK(volume)->Apply(cases);
BENCHMARK(stiffness)->Apply(cases);
BENCHMARK(held)->Apply(cases);
BENCHMARK(to_tets)->Apply(cases);
BENCHMARK(to_surface)->Apply(cases);

}  // namespace
}  // namespace knead
