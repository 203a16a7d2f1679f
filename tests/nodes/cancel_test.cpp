// How long a node goes on after its host has cancelled: the process's time between two questions is measured, which other programs do not disturb.
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <ctime>
#include <filesystem>
#include <mutex>

#include "graph/evaluator.h"
#include "io/graph_file.h"
#include "kernels/port_types.h"

namespace knead {
namespace cancel_test {

double process_seconds() {
  timespec spent{};
  ::clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &spent);
  return static_cast<double>(spent.tv_sec) + 1e-9 * static_cast<double>(spent.tv_nsec);
}

struct Gaps {
  double longest = 0, total = 0;
};

// Of the last node alone: what it stands on is made before.
Gaps gaps_of(const std::string& nodes, const std::string& output) {
  const auto serial = make_serial_executor();
  std::mutex mutex;
  double last = 0, longest = 0;
  const auto ask = [&] {
    const std::lock_guard lock(mutex);
    const double now = process_seconds();
    longest = std::max(longest, now - last);
    last = now;
    return false;
  };
  EvaluatorOptions options;
  options.executor = serial.get();
  options.cancelled = ask;
  Evaluator evaluator(compile(read_graph_text("knead: 1\nnodes:\n" + nodes, "cancel.yaml"), graph_file_options()), options);
  const std::string name = output.substr(0, output.find('.'));
  for (const auto& port : evaluator.plan().nodes[static_cast<size_t>(evaluator.plan().find(output).node)].inputs)
    for (const Source source : port) evaluator.evaluate(1, {evaluator.plan().nodes[static_cast<size_t>(source.node)].name});
  const double start = last = process_seconds();
  longest = 0;
  const FrameResult result = evaluator.evaluate(1, {output});
  EXPECT_FALSE(result.error) << result.error->what();
  ask();
  return {longest, process_seconds() - start};
}

// Seconds between two questions that are no matter; sanitizers make single steps, such as giving a tree back, several times as long.
#if defined(__SANITIZE_ADDRESS__)
constexpr double kLeastGap = 0.4;
#else
constexpr double kLeastGap = 0.05;
#endif

void expect_short(const std::string& nodes, const std::string& output) {
  const Gaps gaps = gaps_of(nodes, output);
  EXPECT_LT(gaps.longest, std::max(kLeastGap, 0.2 * gaps.total)) << output << " of " << gaps.total << " s";
}

TEST(Cancel, EndsLongNodesSoon) {
  const std::string ball = "  ball: {type: primitive, shape: sphere, resolution: 5}\n";
  expect_short(ball + "  field: {type: mesh_to_sdf, mesh: ball, resolution: 128}\n", "field.sdf");
  expect_short(ball +
                   "  other: {type: transform, mesh: ball, translate: [0.4, 0, 0]}\n  a: {type: mesh_to_sdf, mesh: ball, resolution: 48}\n"
                   "  b: {type: mesh_to_sdf, mesh: other, resolution: 48}\n  both: {type: union_sdf, sdf: [a, b]}\n",
               "both.sdf");
  expect_short(ball + "  tets: {type: build_tets, surface: ball, max_depth: 6}\n", "tets.tets");
  const std::string body =
      "  body: {type: primitive, shape: sphere, resolution: 4}\n  tets: {type: build_tets, surface: body, max_depth: 5}\n"
      "  cube: {type: primitive, shape: box, size: [1, 1, 1]}\n  above: {type: transform, mesh: cube, translate: [0, 0.9, 0]}\n"
      "  field: {type: mesh_to_sdf, mesh: above}\n";
  expect_short(body + "  press: {type: equilibrium, surface: body, tets: tets, lattice: tets.lattice, sdf: field}\n", "press.surface");
}

TEST(Cancel, EndsReadingSoon) {
  const std::filesystem::path folder = std::filesystem::temp_directory_path() / ("knead_cancel_" + std::to_string(::getpid()));
  std::filesystem::create_directories(folder);
  const auto path = [&](const char* file) { return "\"" + (folder / file).string() + "\""; };
  std::string write = "knead: 1\nnodes:\n  ball: {type: primitive, shape: sphere, resolution: 7}\n";
  for (const char* file : {"a.obj", "a.ply", "a.stl"})
    write += std::string("  ") + file[2] + ": {type: write_mesh, surface: ball, path: " + path(file) + "}\n";
  write += "  field: {type: mesh_to_sdf, mesh: ball, resolution: 96}\n";
  for (const char* file : {"a.vdb", "a.nvdb"})
    write += std::string("  ") + (file[2] == 'v' ? "w" : "n") + ": {type: write_vdb, sdf: field, path: " + path(file) + "}\n";
  Evaluator evaluator(compile(read_graph_text(write, "write.yaml"), graph_file_options()));
  const FrameResult written = evaluator.evaluate(1, {}, true);
  ASSERT_FALSE(written.error) << written.error->what();
  for (const char* file : {"a.obj", "a.ply", "a.stl"}) expect_short("  m: {type: read_mesh, path: " + path(file) + "}\n", "m.surface");
  for (const char* file : {"a.vdb", "a.nvdb"}) expect_short("  v: {type: read_vdb, path: " + path(file) + "}\n", "v.sdf");
  std::filesystem::remove_all(folder);
}

}  // namespace cancel_test
}  // namespace knead
