#include "tests/bench/bodies.h"

#include <cmath>
#include <map>

#include "graph/error.h"
#include "graph/evaluator.h"
#include "kernels/build_tets/build_tets.h"
#include "kernels/loop/lattice_map.h"
#include "kernels/shapes/primitives.h"

namespace knead::bench {
namespace {

Sdf ball() {
  GraphSpec graph;
  graph.add("ball", "primitive", {{"shape", "sphere"}, {"radius", 0.4}, {"centre", Literal::List{0.8, 0.0, 0.0}}});
  graph.add("solid", "mesh_to_sdf", {{"mesh", "ball"}});
  return Evaluator(compile(graph)).get<Sdf>("solid", 1);
}

Body make_body(const Size& size) {
  const auto executor = make_cpu_executor();
  std::vector<std::string> warnings;
  BuiltTets built = build_tets(make_capsule(0.5, 2, size.segments), {.max_depth = size.depth, .min_depth = 3}, *executor, warnings);
  Body body;
  body.size = size.name;
  body.tets = std::move(built.tets);
  body.lattice = std::move(built.lattice);
  const double cell = body.tets.to_local.scale, bend = 0.01 / cell;  // of the body's size, whatever the cells'
  std::vector<Vec3f> bent;
  for (const Vec3f& p : body.tets.rest.host()) {
    const double t = 4 * cell * static_cast<double>(p.y);
    bent.push_back(p + to_float({bend * std::sin(t), 0, bend * std::cos(t)}));
  }
  body.points.values = Buffer<Vec3f>(bent);
  body.bent = body.lattice.rest;
  body.bent.points = map_to_surface(*executor, body.points.values, body.lattice);
  body.push.values = Buffer<Vec3f>(std::vector<Vec3f>(body.lattice.rest.vertices(), Vec3f{0.001f, 0, 0}));
  body.solid = ball();
  return body;
}

}  // namespace

const Body& host_body(const Size& size) {
  static std::map<std::string, Body> bodies;
  const auto found = bodies.find(size.name);
  return found != bodies.end() ? found->second : bodies.emplace(size.name, make_body(size)).first->second;
}

std::unique_ptr<Executor> make_executor(const std::string& device, int threads) {
  if (device == "serial") return make_serial_executor();
  if (device == "cpu") return make_cpu_executor(threads);
  if (device == "cuda") return make_cuda_executor();
  throw Error(ErrorCode::kDevice, "the benchmarks know no device '" + device + "'", "serial, cpu or cuda");
}

}  // namespace knead::bench
