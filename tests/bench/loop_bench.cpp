// The loop's kernels, other structures for its tables, and whole frames, beside what the machine can do and beside a plain reference, so that every
// figure is a ratio of one run. tests/bench/run.sh runs it and prints the table. Options besides Google Benchmark's:
//   --device=cpu|serial|cuda  where the kernels run
//   --sizes=5k,50k,500k,5M    of H, in tets; 5M takes minutes and 4 GB
#include <benchmark/benchmark.h>

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <map>
#include <sstream>

#include "graph/error.h"
#include "kernels/loop/collide.h"
#include "kernels/loop/enforce_stiffness.h"
#include "kernels/loop/hold.h"
#include "kernels/loop/lattice_map.h"
#include "kernels/loop/loop_points.h"
#include "kernels/loop/restore_volume.h"
#include "kernels/simd_level.h"
#include "tests/bench/bodies.h"
#include "tests/bench/counted.h"
#include "tests/bench/frame_bench.h"
#include "tests/bench/machine.h"
#include "tests/bench/plain_loop.h"
#include "tests/bench/table_simd.h"

namespace knead::bench {
namespace {

// The body where the executor works; kept.
const Body& body_on(Executor& executor, const Size& size) {
  if (executor.device() == Device{}) return host_body(size);
  static std::map<std::string, Body> placed;
  const auto found = placed.find(size.name);
  if (found != placed.end()) return found->second;
  Body body = host_body(size);
  body.tets = on_device(executor, body.tets);
  body.lattice = on_device(executor, body.lattice);
  body.points = on_device(executor, body.points);
  body.bent = on_device(executor, body.bent);
  body.push = on_device(executor, body.push);
  body.solid = on_device(executor, body.solid);
  return placed.emplace(size.name, std::move(body)).first->second;
}

size_t bytes_of(const NeighbourTable& t) {
  return t.order.bytes() + t.valence.bytes() + t.block_offsets.bytes() + t.indices.bytes() + t.values.bytes();
}
// Of what a pass reads of the table: the valences only serve to build it.
size_t bytes_read(const NeighbourTable& t) {
  return bytes_of(t) - t.valence.bytes();
}

RestoreVolume volume_body(Executor& executor, const Body& body, Vec3f* to) {
  const RestoreVolumeSettings settings;
  RestoreVolume made{};
  made.from = body.points.values.view(executor.device()).data();
  made.to = to;
  made.strips = lane_table(body.tets.vertex_strips, executor.device());
  made.regularisation = static_cast<float>(settings.regularisation);
  made.relaxation = static_cast<float>(settings.relaxation);
  made.ignored = kRestRounding;
  made.max_step = static_cast<float>(settings.max_step) * body.tets.mean_edge;
  made.relative = settings.relative;
  return made;
}

EnforceStiffness stiffness_body(Executor& executor, const Body& body, Vec3f* to) {
  const EnforceStiffnessSettings settings;
  EnforceStiffness made{};
  made.from = body.points.values.view(executor.device()).data();
  made.to = to;
  made.edges = lane_table(body.tets.vertex_edges, executor.device());
  made.stiffness = static_cast<float>(settings.stiffness);
  made.ignored = kRestRounding;
  made.max_step = static_cast<float>(settings.max_step) * body.tets.mean_edge;
  return made;
}

// Arithmetic operations of a pass: those of some ten thousand lanes, spread over the table, times what share of the lanes they are.
template <class Body>
double operations(const Body& body, uint32_t lanes) {
  const uint32_t stride = std::max(1u, lanes / 10007);
  uint32_t counted = 0;
  Counted::operations = 0;
  for (uint32_t t = 0; t < lanes; t += stride, ++counted) body.template lane<Counted>(t);
  return Counted::operations * lanes / counted;
}

struct Kernel {
  const char* name;
  std::function<void(Executor&, const Body&)> run;
  std::function<void(PlainLoop&, const std::vector<PlainField>&)> plain;
  std::function<size_t(const Body&)> bytes;       // that must move: every array that it reads or writes, once
  std::function<double(const Body&)> operations;  // of the host's body; null: not counted
};

Buffer<Vec3f> push_out(Executor& executor, const Body& body) {
  const Sdf* collider = &body.solid;
  CollideInput input;
  input.points = body.bent.points.view(executor.device());
  input.placement = body.bent.placement;
  input.colliders = {&collider, 1};
  input.diagonal = body.bent.diagonal();
  input.most = 0.1 * input.diagonal;
  Buffer<Vec3f> displacement(input.points.size(), executor.memory());
  Buffer<float> memory(input.points.size(), executor.memory());
  Buffer<ContactProgress> progress(1, executor.memory());
  collide_push(executor, input, displacement.data_for_write(), memory.data_for_write(), progress.data_for_write());
  return displacement;
}

const std::vector<Kernel>& kernels() {
  static const std::vector<Kernel> all{
      {"restore_volume",
       [](Executor& executor, const Body& b) {
         RestoreVolumeSettings settings;
         settings.sweeps = 1;
         benchmark::DoNotOptimize(restore_volume(executor, b.points.values, b.tets, settings));
       },
       [](PlainLoop& plain, const auto&) { plain.restore_volume(0.4, 0.03, 0.5); },
       [](const Body& b) { return bytes_read(b.tets.vertex_strips) + 24 * b.tets.vertices(); },
       [](const Body& b) {
         std::vector<Vec3f> to(b.tets.vertices());
         return operations(volume_body(executor_of("cpu", 1), b, to.data()), b.tets.vertex_strips.lanes);
       }},
      {"enforce_stiffness",
       [](Executor& executor, const Body& b) { benchmark::DoNotOptimize(enforce_stiffness(executor, b.points.values, b.tets, {})); },
       [](PlainLoop& plain, const auto&) { plain.enforce_stiffness(0.5, 0.5); },
       [](const Body& b) { return bytes_read(b.tets.vertex_edges) + 24 * b.tets.vertices(); },
       [](const Body& b) {
         std::vector<Vec3f> to(b.tets.vertices());
         return operations(stiffness_body(executor_of("cpu", 1), b, to.data()), b.tets.vertex_edges.lanes);
       }},
      {"collide_sdf", [](Executor& executor, const Body& b) { benchmark::DoNotOptimize(push_out(executor, b)); },
       [](PlainLoop& plain, const std::vector<PlainField>& fields) { plain.collide(fields); },
       [](const Body& b) { return (12 + 12 + 4) * b.bent.vertices(); },  // the collider's voxels come on top
       nullptr},
      {"map_to_tets",
       [](Executor& executor, const Body& b) { benchmark::DoNotOptimize(map_to_tets(executor, b.push.values, b.points.values, b.lattice, {})); },
       [](PlainLoop& plain, const auto&) { plain.map_to_tets(0.5); },
       [](const Body& b) { return bytes_read(b.lattice.gather) + 12 * b.bent.vertices() + 24 * b.tets.vertices(); }, nullptr},
      {"map_to_surface", [](Executor& executor, const Body& b) { benchmark::DoNotOptimize(map_to_surface(executor, b.points.values, b.lattice)); },
       [](PlainLoop& plain, const auto&) { plain.map_to_surface(); },
       [](const Body& b) { return bytes_read(b.lattice.map) + 24 * b.bent.vertices() + 24 * b.tets.vertices(); }, nullptr},
      {"hold",
       [](Executor& executor, const Body& b) { benchmark::DoNotOptimize(hold(executor, b.points.values, b.tets, nullptr, {.strength = 0.02})); },
       nullptr, [](const Body& b) { return (12 + 12 + 4 + 4 + 12 + 12 + 4 + 12) * b.tets.vertices(); }, nullptr},
  };
  return all;
}

double farthest(const Buffer<Vec3f>& ours, const std::vector<Eigen::Vector3d>& plain) {
  double most = 0;
  for (size_t i = 0; i < plain.size(); ++i) {
    const Vec3f& at = ours.host()[i];
    most = std::max(most, (plain[i] - Eigen::Vector3d(at.x, at.y, at.z)).norm());
  }
  return most;
}

// A reference that computes something else would make a fine ratio: every step of one iteration must agree with the library's, from the same start.
void check_plain(const Body& b) {
  Executor& executor = executor_of("cpu", 1);
  PlainLoop plain(b.tets, b.lattice);
  const std::vector<PlainField> fields{PlainField(b.solid)};
  const double cell = b.tets.to_local.scale;
  const auto expect = [](double difference, double most, const char* what) {
    if (!(difference <= most))
      throw Error(ErrorCode::kInternal, std::string("the plain reference differs in ") + what + " by " + std::to_string(difference) + " cells");
  };
  plain.place(b.points.values);
  plain.map_to_surface();
  expect(farthest(b.bent.points, plain.surface()) / cell, 1e-4, "map_to_surface");
  plain.collide(fields);
  const Buffer<Vec3f> push = push_out(executor, b);
  expect(farthest(push, plain.pushes()) / cell, 0.02, "collide_sdf");  // another gradient in the last voxel
  plain.map_to_tets(0.5);
  Buffer<Vec3f> moved = map_to_tets(executor, push, b.points.values, b.lattice, {.mean_edge = static_cast<double>(b.tets.mean_edge)});
  expect(farthest(moved, plain.points()), 0.02, "map_to_tets");
  plain.place(b.points.values);
  plain.restore_volume(0.4, 0.03, 0.5);
  RestoreVolumeSettings once;
  once.sweeps = 1;
  expect(farthest(restore_volume(executor, b.points.values, b.tets, once), plain.points()), 1e-3, "restore_volume");
  plain.place(b.points.values);
  plain.enforce_stiffness(0.5, 0.5);
  expect(farthest(enforce_stiffness(executor, b.points.values, b.tets, {}), plain.points()), 1e-4, "enforce_stiffness");
}

void describe(benchmark::State& state, const Body& body) {
  state.counters["tets"] = static_cast<double>(body.tets.tets.size());
  state.counters["vertices"] = static_cast<double>(body.tets.vertices());
  state.counters["surface_vertices"] = static_cast<double>(body.bent.vertices());
}

void add_machine(const Setting& setting) {
  for (const int threads : setting.threads) {
    for (const size_t bytes : {size_t{1} << 18, size_t{1} << 21, size_t{1} << 24, size_t{1} << 27, size_t{1} << 29})
      benchmark::RegisterBenchmark(("copy/" + std::to_string(2 * bytes) + "/threads:" + std::to_string(threads)).c_str(),
                                   [bytes, threads](benchmark::State& state) {
                                     Copy copy(bytes);
                                     Executor& executor = executor_of("cpu", threads);
                                     for (auto _ : state) copy.run(executor);
                                     state.counters["bytes"] = 2.0 * static_cast<double>(bytes);  // read and written
                                   });
    benchmark::RegisterBenchmark(("multiply_and_add/threads:" + std::to_string(threads)).c_str(), [threads](benchmark::State& state) {
      double operations = 0;
      for (auto _ : state) operations = multiply_and_add(executor_of("cpu", threads));
      state.counters["flops"] = operations;
    });
  }
}

void add_kernels(const Setting& setting, const Size& size) {
  for (const Kernel& kernel : kernels()) {
    for (const int threads : setting.threads)
      benchmark::RegisterBenchmark(("kernel/" + std::string(kernel.name) + "/" + size.name + "/threads:" + std::to_string(threads)).c_str(),
                                   [&kernel, &size, &setting, threads](benchmark::State& state) {
                                     Executor& executor = executor_of(setting.device, threads);
                                     const Body& body = body_on(executor, size);
                                     for (auto _ : state) {
                                       kernel.run(executor, body);
                                       executor.synchronise();
                                     }
                                     describe(state, body);
                                     state.counters["bytes"] = static_cast<double>(kernel.bytes(body));
                                     if (kernel.operations) state.counters["flops"] = kernel.operations(host_body(size));
                                   });
    if (!kernel.plain) continue;
    benchmark::RegisterBenchmark(("plain/" + std::string(kernel.name) + "/" + size.name).c_str(), [&kernel, &size](benchmark::State& state) {
      static std::map<std::string, std::unique_ptr<PlainLoop>> loops;
      static std::vector<PlainField> fields;
      const Body& body = host_body(size);
      auto& loop = loops[size.name];
      if (!loop) loop = std::make_unique<PlainLoop>(body.tets, body.lattice);
      if (fields.empty()) fields.emplace_back(body.solid);
      loop->place(body.points.values);
      loop->map_to_surface();
      for (auto _ : state) kernel.plain(*loop, fields);
      describe(state, body);
    });
  }
}

struct Layout {
  const char* name;
  Structure structure;
  Order order;
  bool scalar;
};
// H is numbered along the Morton curve and by valence in windows, as the library's own tables are; by valence: over all of H at once.
constexpr Layout kLayouts[] = {{"jagged", Structure::kJagged, Order::kByValence, false},
                               {"sliced_by_valence", Structure::kSliced, Order::kByValence, false},
                               {"sliced_in_windows", Structure::kSliced, Order::kAsNumbered, false},
                               {"ell", Structure::kEll, Order::kByValence, false},
                               {"csr", Structure::kCsr, Order::kAsNumbered, true},
                               {"jagged_one_lane", Structure::kJagged, Order::kByValence, true}};

const TableData& table_of(Executor& executor, const Size& size, const Layout& layout, bool edges) {
  static std::map<std::string, TableData> made;
  TableData& table = made[std::string(size.name) + layout.name + (edges ? "edges" : "strips")];
  if (!table.lanes) {
    const TetMesh& tets = host_body(size).tets;
    table = restructured(edges ? tets.vertex_edges : tets.vertex_strips, static_cast<uint32_t>(tets.vertices()), layout.structure, layout.order);
    const auto place = [&]<class E>(Buffer<E>& buffer) {
      if (executor.device() == Device{}) return;
      Buffer<E> moved(buffer.size(), executor.memory());
      executor.copy(buffer.host().data(), Device{}, moved.data_for_write(), executor.device(), buffer.bytes());
      buffer = std::move(moved);
    };
    place(table.order), place(table.offsets), place(table.indices), place(table.values);
  }
  return table;
}

void add_structures(const Setting& setting, const Size& size) {
  for (const bool edges : {false, true})
    for (const Layout& layout : kLayouts)
      for (const int threads : setting.threads)
        benchmark::RegisterBenchmark(("structure/" + std::string(edges ? "enforce_stiffness" : "restore_volume") + "/" + layout.name + "/" +
                                      size.name + "/threads:" + std::to_string(threads))
                                         .c_str(),
                                     [edges, &layout, &size, &setting, threads](benchmark::State& state) {
                                       Executor& executor = executor_of(setting.device, threads);
                                       const Body& body = body_on(executor, size);
                                       const TableData& table = table_of(executor, size, layout, edges);
                                       Buffer<Vec3f> to(body.tets.vertices(), executor.memory());
                                       Vec3f* moved = to.data_for_write();
                                       for (auto _ : state) {
                                         if (edges)
                                           run_stiffness(executor, stiffness_body(executor, body, moved), table, layout.scalar);
                                         else
                                           run_volume(executor, volume_body(executor, body, moved), table, layout.scalar);
                                         executor.synchronise();
                                       }
                                       describe(state, body);
                                       state.counters["bytes"] = static_cast<double>(table.bytes() + 24 * body.tets.vertices());
                                       state.counters["entries"] = static_cast<double>(table.values.size());
                                     });
}

// Storage by tet and by vertex of H: what the loop reads and writes, and all that is kept.
void add_memory(const Size& size) {
  benchmark::RegisterBenchmark(("memory/" + std::string(size.name)).c_str(), [&size](benchmark::State& state) {
    const Body& b = host_body(size);
    for (auto _ : state) benchmark::DoNotOptimize(&b);
    const size_t in_h = bytes_read(b.tets.vertex_strips) + bytes_read(b.tets.vertex_edges) + b.tets.vertex_tets.order.bytes() +
                        b.tets.lane_volumes.bytes() + b.tets.rest.bytes();
    const size_t in_maps = bytes_read(b.lattice.map) + bytes_read(b.lattice.gather) + b.lattice.rest.points.bytes();
    const size_t moving =
        3 * 12 * b.tets.vertices() + (3 * 12 + 2 * 4) * b.bent.vertices();  // most that lives at once: points of H, of M, pushes, memories
    size_t kept = 0;
    TetMesh tets = b.tets;
    Lattice lattice = b.lattice;
    const auto add = [&](const auto& buffer) { kept += buffer.bytes(); };
    PortTraits<TetMesh>::each_buffer(tets, add);
    PortTraits<Lattice>::each_buffer(lattice, add);
    describe(state, b);
    state.counters["bytes_of_h"] = static_cast<double>(in_h);
    state.counters["bytes_of_maps"] = static_cast<double>(in_maps);
    state.counters["bytes_moving"] = static_cast<double>(moving);
    state.counters["bytes_kept"] = static_cast<double>(kept);
  });
}

// Takes our own options out of the command line.
Setting read_setting(int& count, char** arguments) {
  Setting setting;
  std::string sizes = "5k,50k,500k";
  int kept = 1;
  for (int i = 1; i < count; ++i) {
    if (std::strncmp(arguments[i], "--device=", 9) == 0)
      setting.device = arguments[i] + 9;
    else if (std::strncmp(arguments[i], "--sizes=", 8) == 0)
      sizes = arguments[i] + 8;
    else
      arguments[kept++] = arguments[i];
  }
  count = kept;
  std::stringstream list(sizes);
  for (std::string name; std::getline(list, name, ',');) {
    const Size* found = nullptr;
    for (const Size& size : kSizes)
      if (name == size.name) found = &size;
    if (!found) throw Error(ErrorCode::kInput, "there is no size '" + name + "'", "--sizes=5k,50k,500k,5M");
    setting.sizes.push_back(found);
  }
  setting.threads = {1};
  const int all = make_executor(setting.device, 0)->threads();
  if (all > 1) setting.threads.push_back(all);
  return setting;
}

int main_of(int count, char** arguments) {
  static const Setting setting = read_setting(count, arguments);
  benchmark::AddCustomContext("processor", processor_name());
  if (const char* command = std::getenv("KNEAD_BENCH_COMMAND"))
    benchmark::AddCustomContext("command", command);  // --benchmark_context takes no second '='
  benchmark::AddCustomContext("device", setting.device);
  benchmark::AddCustomContext("threads", std::to_string(setting.threads.back()));
  benchmark::AddCustomContext("simd", name_of(simd_level(executor_of(setting.device, 1))));
  add_machine(setting);
  for (const Size* size : setting.sizes) {
    add_kernels(setting, *size);
    add_structures(setting, *size);
    add_memory(*size);
  }
  add_frames(setting);
  check_plain(host_body(kSizes[0]));
  benchmark::Initialize(&count, arguments);
  if (benchmark::ReportUnrecognizedArguments(count, arguments)) return 1;
  benchmark::RunSpecifiedBenchmarks();
  benchmark::Shutdown();
  return 0;
}

}  // namespace
}  // namespace knead::bench

int main(int count, char** arguments) {
  try {
    return knead::bench::main_of(count, arguments);
  } catch (const knead::Error& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
