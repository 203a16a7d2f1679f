// The engine's own cost: compiling and evaluating graphs whose nodes do next to nothing.
#include <benchmark/benchmark.h>

#include "tests/graph/toys.h"

namespace knead {
namespace {

GraphSpec chain(int nodes) {
  GraphSpec graph;
  graph.add("n0", "value", {{"value", 2.5}});
  graph.add("f", "frame", {{"scale", 0.5}});
  for (int i = 1; i + 1 < nodes; ++i) {
    const std::string before = "n" + std::to_string(i - 1), other = i % 10 == 0 ? "f" : "n" + std::to_string(i / 2);
    graph.add("n" + std::to_string(i), "add", {{"a", before}, {"b", other + (i % 10 == 0 ? ".value" : "")}, {"offset", 0.5 * i}});
  }
  return graph;
}

std::string last(int nodes) {
  return "n" + std::to_string(nodes - 2);
}

void compile_graph(benchmark::State& state) {
  const int nodes = static_cast<int>(state.range(0));
  const GraphSpec graph = chain(nodes);
  const CompileOptions options = toys::options();
  for (auto _ : state) benchmark::DoNotOptimize(compile(graph, options));
}
BENCHMARK(compile_graph)->Arg(10)->Arg(100)->Arg(1000)->Unit(benchmark::kMicrosecond);

// What a host does after a change that changes nothing: compile, and evaluate with the cache that it kept.
void compile_and_evaluate_unchanged(benchmark::State& state) {
  const int nodes = static_cast<int>(state.range(0));
  const GraphSpec graph = chain(nodes);
  const CompileOptions options = toys::options();
  const auto executor = make_cpu_executor();
  EvaluatorOptions evaluator_options;
  evaluator_options.executor = executor.get();
  evaluator_options.cache = std::make_shared<Cache>();
  for (auto _ : state) {
    Evaluator evaluator(compile(graph, options), evaluator_options);
    const FrameResult result = evaluator.evaluate(1, {last(nodes)});
    if (result.error) state.SkipWithError(result.error->what());
  }
}
BENCHMARK(compile_and_evaluate_unchanged)->Arg(10)->Arg(100)->Arg(1000)->Unit(benchmark::kMicrosecond);

void evaluate_unchanged(benchmark::State& state) {
  const int nodes = static_cast<int>(state.range(0));
  Evaluator evaluator(compile(chain(nodes), toys::options()));
  for (auto _ : state) benchmark::DoNotOptimize(evaluator.evaluate(1, {last(nodes)}));
}
BENCHMARK(evaluate_unchanged)->Arg(100)->Unit(benchmark::kMicrosecond);

// Every node runs: a new frame each time.
void evaluate_new_frame(benchmark::State& state) {
  const int nodes = static_cast<int>(state.range(0));
  EvaluatorOptions options;
  options.cache = std::make_shared<Cache>(size_t{1} << 20);
  Evaluator evaluator(compile(chain(nodes), toys::options()), options);
  int frame = 0;
  for (auto _ : state) benchmark::DoNotOptimize(evaluator.evaluate(++frame, {last(nodes)}));
}
BENCHMARK(evaluate_new_frame)->Arg(100)->Unit(benchmark::kMicrosecond);

void loop_round(benchmark::State& state) {
  GraphSpec graph;
  graph.add("v", "value", {{"value", 0}}).add("t", "value", {{"value", 8}});
  graph.add("l", "iterate",
            {{"max_iterations", 10000},
             {"min_iterations", 10000},
             {"state", Literal::Map{{"x", "v"}}},
             {"body", Literal::Map{{"r", Literal::Map{{"type", "relax"}, {"x", "state.x"}, {"target", "t"}}}}},
             {"next", Literal::Map{{"x", "r"}}}});
  EvaluatorOptions options;
  options.cache = std::make_shared<Cache>(0);
  Evaluator evaluator(compile(graph, toys::options()), options);
  for (auto _ : state) benchmark::DoNotOptimize(evaluator.evaluate(1, {"l"}));
  state.counters["seconds_per_round"] = benchmark::Counter(10000, benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}
BENCHMARK(loop_round)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace knead
