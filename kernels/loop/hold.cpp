#include "kernels/loop/hold.h"

#include <algorithm>
#include <array>

#include "kernels/lane_table.h"
#include "kernels/loop/loop_points.h"
#include "kernels/loop/loop_simd.h"
#include "kernels/parallel.h"

namespace knead {
namespace {

FitRigid fit_body(Executor& executor, const Buffer<Vec3f>& points, const TetMesh& tets) {
  const Device device = executor.device();
  FitRigid body{};
  body.sums = {points.view(device).data(), tets.rest.view(device).data(), tets.vertex_tets.order.view(device).data(),
               tets.lane_volumes.view(device).data()};
  return body;
}

void check_paint(const Buffer<float>& paint, const Lattice* lattice, const char* what) {
  if (!lattice)
    throw Error(ErrorCode::kInput, std::string("hold: ") + what + " are painted on M, but no lattice is connected", "lattice: <build_tets>.lattice");
  require_size(paint.size(), lattice->rest.vertices(), "hold", what, "vertices of the surface that the lattice binds");
}

// `elsewhere` lives where the kernels run; null: zero.
Buffer<float> brought_to_tets(Executor& executor, const Buffer<float>& paint, const Lattice& lattice, bool largest, const float* elsewhere) {
  const LaneTable gather = lane_table(lattice.gather, executor.device());
  Buffer<float> weights(lattice.tet_rest.size(), executor.memory());
  PaintToTets body{};
  body.paint = paint.view(executor.device()).data();
  body.to = weights.data_for_write();
  body.gather = gather;
  body.largest = largest;
  parallel_for(executor, weights.size(), FillFrom{elsewhere, body.to});
  parallel_for(executor, gather.lanes, body);
  return weights;
}

}  // namespace

RigidSum FitRigid::sum_on_host(Executor& executor, size_t lanes) const {
  const auto run = loop_simd(executor).rigid_sums;
  constexpr size_t kMostPieces = 64;
  const size_t most = (lanes + kMostPieces - 1) / kMostPieces, block = NeighbourTable::kLaneBlock;
  const size_t piece = std::max<size_t>(kLanesPerPiece, (most + block - 1) / block * block);
  std::array<RigidSum, kMostPieces> partial;
  executor.parallel_ranges(lanes, piece, [&](size_t begin, size_t end) {
    run(sums, static_cast<uint32_t>(begin), static_cast<uint32_t>(end), partial[begin / piece].of);
  });
  RigidSum sum;
  for (size_t p = 0; p * piece < lanes; ++p) sum = combine(sum, partial[p]);
  return sum;
}

RigidFit rigid_fit(Executor& executor, const Buffer<Vec3f>& points, const TetMesh& tets) {
  RigidFit fit;
  RigidMotion unused;
  const Buffer<Vec3f> from = padded(executor, points);
  FitRigid body = fit_body(executor, from, tets);
  body.fit = &fit;
  body.motion = &unused;
  require_host(executor, "rigid_fit");
  reduce(executor, tets.vertex_tets.lanes, body);
  return fit;
}

Buffer<float> paint_to_tets(Executor& executor, const Buffer<float>& paint, const Lattice& lattice, bool largest, float elsewhere) {
  require_host(executor, "paint_to_tets");
  return brought_to_tets(executor, paint, lattice, largest, &elsewhere);
}

Buffer<Vec3f> hold(Executor& executor, const Buffer<Vec3f>& points, const TetMesh& tets, const Lattice* lattice, const HoldSettings& settings) {
  require_size(points.size(), tets.vertices(), "hold", "points", "vertices of the tet mesh");
  const Device device = executor.device();
  const bool on_host = device == Device{};
  const auto sum_paint = [&](const Buffer<float>& paint, float* most, float* mean) {
    reduce(executor, paint.size(), SumPaint{paint.view(device).data(), static_cast<uint32_t>(paint.size()), most, mean});
  };
  Buffer<float> pins, weights, figures(2, executor.memory());  // the largest pin, the mean weight
  float* const most_pin = figures.data_for_write();
  bool pinned = false, free = true;  // as far as the host knows
  if (settings.pins) {
    check_paint(*settings.pins, lattice, "pins");
    sum_paint(*settings.pins, most_pin, nullptr);
    pinned = !on_host || *most_pin > 0;
    free = !on_host || !pinned;
    if (pinned) pins = brought_to_tets(executor, *settings.pins, *lattice, true, nullptr);
  }
  if (settings.weights && settings.strength > 0) {
    check_paint(*settings.weights, lattice, "weights");
    sum_paint(*settings.weights, nullptr, most_pin + 1);
    weights = brought_to_tets(executor, *settings.weights, *lattice, false, most_pin + 1);
  }
  const Buffer<Vec3f> from = padded(executor, points);
  Buffer<Vec3f> to(points.size(), executor.memory());
  Buffer<RigidMotion> motion(1, executor.memory());
  Hold body{};
  body.from = from.view(device).data();
  body.rest = tets.rest.view(device).data();
  body.to = to.data_for_write();
  body.order = tets.vertex_tets.order.view(device).data();
  body.lanes = tets.vertex_tets.lanes;
  body.weights = weights ? weights.view(device).data() : nullptr;
  body.pins = pins ? pins.view(device).data() : nullptr;
  body.strength = static_cast<float>(settings.strength);
  if (settings.remove_rigid && free) {
    FitRigid fit = fit_body(executor, from, tets);
    fit.motion = motion.data_for_write();
    fit.pinned = settings.pins ? most_pin : nullptr;
    reduce(executor, tets.vertex_tets.lanes, fit);
    body.rigid = fit.motion;
  }
  run_lanes(executor, body.lanes, body, loop_simd(executor).hold);
  return to;
}

}  // namespace knead
