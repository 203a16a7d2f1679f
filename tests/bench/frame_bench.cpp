#include "tests/bench/frame_bench.h"

#include <benchmark/benchmark.h>

#include <map>

#include "graph/evaluator.h"
#include "io/graph_file.h"
#include "kernels/loop/restore_volume.h"
#include "tests/bench/plain_loop.h"
#include "tests/paths.h"

namespace knead::bench {

Executor& executor_of(const std::string& device, int threads) {
  static std::map<std::pair<std::string, int>, std::unique_ptr<Executor>> made;
  auto& executor = made[{device, threads}];
  if (!executor) executor = make_executor(device, threads);
  return *executor;
}

namespace {

// An example, and the same loop for the plain reference.
struct Example {
  const char* name;
  std::string file;
  std::vector<std::pair<std::string, Literal>> overrides;
  std::vector<int> frames;
  std::string result, tets, lattice;
  std::vector<std::string> colliders;
  int sweeps;
  double regularisation, stiffness, lift_step;
};

constexpr int kIterations = 120;

const std::vector<Example>& examples() {
  const auto endless = [](const std::string& loop) {
    return std::vector<std::pair<std::string, Literal>>{{loop + ".max_iterations", kIterations}, {loop + ".min_iterations", kIterations}};
  };
  static const std::vector<Example> all{{"head",
                                         "head/head.yaml",
                                         endless("soft.press"),
                                         parse_frames("21-44"),
                                         "soft.surface",
                                         "soft.tets",
                                         "soft.lattice",
                                         {"solid"},
                                         2,
                                         0.03,
                                         0.15,
                                         0.5},
                                        {"crush",
                                         "crush/crush.yaml",
                                         endless("press"),
                                         parse_frames("2-12"),
                                         "exact.surface",
                                         "tets.tets",
                                         "tets.lattice",
                                         {"upper_sdf", "lower_sdf"},
                                         6,
                                         0.05,
                                         0.2,
                                         0.1}};
  return all;
}

std::shared_ptr<const Plan> plan_of(const Example& example) {
  CompileOptions options = graph_file_options();
  options.overrides = example.overrides;
  return compile(read_graph_file(source_dir() + "/examples/" + example.file), options);
}

void run_frames(benchmark::State& state, const Example& example, Executor& executor) {
  const auto plan = plan_of(example);
  for (auto _ : state) {
    state.PauseTiming();
    EvaluatorOptions options;
    options.executor = &executor;
    options.cache = std::make_shared<Cache>();
    Evaluator evaluator(plan, options);
    benchmark::DoNotOptimize(evaluator.evaluate(example.frames.front() - 1, {example.result}));  // what the frames share
    state.ResumeTiming();
    evaluator.evaluate_frames(example.frames, {example.result}, false, [&](const FrameResult& result) {
      if (result.error) state.SkipWithError(result.error->what());
    });
  }
  state.counters["frames"] = static_cast<double>(example.frames.size());
  state.counters["iterations_per_frame"] = kIterations;
}

void run_plain_frame(benchmark::State& state, const Example& example) {
  Evaluator evaluator(plan_of(example));
  const int frame = example.frames[example.frames.size() / 2];
  const auto tets = evaluator.get<TetMesh>(example.tets, frame);
  const auto lattice = evaluator.get<Lattice>(example.lattice, frame);
  std::vector<PlainField> colliders;
  for (const std::string& name : example.colliders) colliders.emplace_back(evaluator.get<Sdf>(name, frame));
  PlainLoop loop(tets, lattice);
  for (auto _ : state) {
    loop.place(tets.rest);
    for (int round = 0; round < kIterations; ++round) {
      loop.collide(colliders);
      loop.map_to_tets(example.lift_step);
      for (int sweep = 0; sweep < example.sweeps; ++sweep)
        loop.restore_volume(sweep_relaxation(0.4, sweep, example.sweeps), example.regularisation, 0.5);
      loop.enforce_stiffness(example.stiffness, 0.5);
      loop.map_to_surface();
    }
  }
  state.counters["frames"] = 1;
  state.counters["tets"] = static_cast<double>(tets.tets.size());
  state.counters["vertices"] = static_cast<double>(tets.vertices());
}

}  // namespace

void add_frames(const Setting& setting) {
  for (const Example& example : examples()) {
    for (const int threads : setting.threads)
      benchmark::RegisterBenchmark(
          ("frames/" + std::string(example.name) + "/threads:" + std::to_string(threads)).c_str(),
          [&example, &setting, threads](benchmark::State& state) { run_frames(state, example, executor_of(setting.device, threads)); });
    benchmark::RegisterBenchmark(("plain/frames/" + std::string(example.name)).c_str(),
                                 [&example](benchmark::State& state) { run_plain_frame(state, example); });
  }
}

}  // namespace knead::bench
