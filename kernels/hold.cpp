#include "kernels/hold.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>

#include "kernels/lane_table.h"
#include "kernels/loop_lanes.h"
#include "kernels/loop_points.h"
#include "kernels/parallel.h"

namespace knead {
namespace {

using Sums = std::array<double, RigidSums::kSums>;

Sums rigid_sums(Executor& executor, const Buffer<Vec3f>& points, const TetMesh& tets) {
  const Device device = executor.device();
  const NeighbourTable& lanes = tets.vertex_tets;
  const RigidSums body{points.view(device).data(), tets.rest.view(device).data(), lanes.order.view(device).data(), tets.lane_volumes.view(device).data()};
  const auto run = loop_lanes(executor).rigid_sums;
  constexpr size_t kMostPieces = 64;
  const size_t most = (lanes.lanes + kMostPieces - 1) / kMostPieces, block = NeighbourTable::kLaneBlock;
  const size_t piece = std::max<size_t>(kLanesPerPiece, (most + block - 1) / block * block);
  std::array<Sums, kMostPieces> partial;
  executor.parallel_ranges(lanes.lanes, piece, [&](size_t begin, size_t end) {
    run(body, static_cast<uint32_t>(begin), static_cast<uint32_t>(end), partial[begin / piece].data());
  });
  Sums sums{};
  for (size_t p = 0; p * piece < lanes.lanes; ++p)
    for (size_t k = 0; k < sums.size(); ++k) sums[k] += partial[p][k];
  return sums;
}

void check_paint(const Buffer<float>& paint, const Lattice* lattice, const char* what) {
  if (!lattice) throw Error(ErrorCode::kInput, std::string("hold: ") + what + " are painted on M, but no lattice is connected", "lattice: <build_tets>.lattice");
  require_size(paint.size(), lattice->rest.vertices(), "hold", what, "vertices of the surface that the lattice binds");
}

}  // namespace

RigidFit rigid_fit(Executor& executor, const Buffer<Vec3f>& points, const TetMesh& tets) {
  const Sums s = rigid_sums(executor, padded(executor, points), tets);
  RigidFit fit;
  const double weight = s[0], travelled = s[1];
  if (!(weight > 0) || travelled == 0) return fit;
  fit.moved = true;
  const Vec3d step = (1 / weight) * Vec3d{s[2], s[3], s[4]};
  fit.rest_centre = (1 / weight) * Vec3d{s[5], s[6], s[7]};
  fit.centre = fit.rest_centre + step;
  constexpr int kUpper[3][3] = {{17, 18, 19}, {18, 20, 21}, {19, 21, 22}};
  Eigen::Matrix3d covariance;
  for (int a = 0; a < 3; ++a)
    for (int b = 0; b < 3; ++b) covariance(a, b) = (s[8 + 3 * a + b] + s[kUpper[a][b]]) / weight - fit.centre[a] * fit.rest_centre[b];
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(covariance, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Eigen::Vector3d spread = svd.singularValues();
  if (!(spread(1) > 1e-6 * spread(0))) return fit;  // points on a line or collapsed to it: no rotation to speak of
  Eigen::Matrix3d flip = Eigen::Matrix3d::Identity();
  flip(2, 2) = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0 ? -1 : 1;
  const Eigen::Matrix3d rotation = svd.matrixU() * flip * svd.matrixV().transpose();
  for (int a = 0; a < 3; ++a)
    for (int b = 0; b < 3; ++b) fit.rotation[3 * a + b] = rotation(a, b);
  return fit;
}

RigidMotion undoing(const RigidFit& fit) {
  RigidMotion back;
  back.moved = fit.moved;
  back.centre = to_float(fit.centre);
  back.shift = to_float(fit.rest_centre - fit.centre);
  for (int a = 0; a < 3; ++a)
    for (int b = 0; b < 3; ++b) back.turn[3 * a + b] = static_cast<float>(fit.rotation[3 * b + a] - (a == b ? 1 : 0));
  return back;
}

Buffer<float> paint_to_tets(Executor& executor, const Buffer<float>& paint, const Lattice& lattice, bool largest, float elsewhere) {
  const LaneTable gather = lane_table(lattice.gather, executor.device());
  Buffer<float> weights(lattice.tet_rest.size(), executor.memory());
  PaintToTets body{};
  body.paint = paint.view(executor.device()).data();
  body.to = weights.data_for_write();
  body.gather = gather;
  body.largest = largest;
  std::fill_n(body.to, weights.size(), elsewhere);
  parallel_for(executor, gather.lanes, "paint_to_tets", body);
  return weights;
}

Buffer<Vec3f> hold(Executor& executor, const Buffer<Vec3f>& points, const TetMesh& tets, const Lattice* lattice, const HoldSettings& settings) {
  require_host(executor, "hold");
  require_size(points.size(), tets.vertices(), "hold", "points", "vertices of the tet mesh");
  Buffer<float> pins, weights;
  bool pinned = false;
  if (settings.pins) {
    check_paint(*settings.pins, lattice, "pins");
    const auto paint = settings.pins->view(executor.device());
    pinned = std::any_of(paint.begin(), paint.end(), [](float w) { return w > 0; });
    if (pinned) pins = paint_to_tets(executor, *settings.pins, *lattice, true, 0);
  }
  if (settings.weights && settings.strength > 0) {
    check_paint(*settings.weights, lattice, "weights");
    const auto paint = settings.weights->view(executor.device());
    const double sum = reduce_sum(executor, paint.size(), "hold", [&](uint32_t i) { return static_cast<double>(paint[i]); });
    weights = paint_to_tets(executor, *settings.weights, *lattice, false, static_cast<float>(sum / static_cast<double>(std::max<size_t>(1, paint.size()))));
  }
  const Buffer<Vec3f> from = padded(executor, points);
  Buffer<Vec3f> to(points.size(), executor.memory());
  Hold body{};
  body.from = from.view(executor.device()).data();
  body.rest = tets.rest.view(executor.device()).data();
  body.to = to.data_for_write();
  body.order = tets.vertex_tets.order.view(executor.device()).data();
  body.lanes = tets.vertex_tets.lanes;
  body.weights = weights ? weights.view(executor.device()).data() : nullptr;
  body.pins = pins ? pins.view(executor.device()).data() : nullptr;
  body.strength = static_cast<float>(settings.strength);
  if (settings.remove_rigid && !pinned) body.rigid = undoing(rigid_fit(executor, from, tets));
  run_lanes(executor, body.lanes, body, loop_lanes(executor).hold);
  return to;
}

}  // namespace knead
