#include "kernels/hold.h"

#include <Eigen/Dense>
#include <algorithm>

#include "kernels/lane_table.h"
#include "kernels/loop_points.h"
#include "kernels/parallel.h"

namespace knead {
namespace {

struct FitSums {
  double weight = 0, travelled = 0;
  Vec3d now{0, 0, 0}, rest{0, 0, 0};
  double product[9] = {};  // sum w x x_rest^T

  FitSums operator+(const FitSums& b) const {
    FitSums s{weight + b.weight, travelled + b.travelled, now + b.now, rest + b.rest, {}};
    for (int k = 0; k < 9; ++k) s.product[k] = product[k] + b.product[k];
    return s;
  }
};

// A lane is a vertex of H; its weight is the volume of its tets.
struct FitBody {
  const Vec3f *now, *rest;
  LaneTable tets;

  FitSums operator()(uint32_t t) const {
    double w = 0;
    for (uint32_t k = 0; k < tets.valence[t]; ++k) w += tets.values[tets.entry(t, k)];
    const uint32_t j = tets.order[t];
    const Vec3d x = to_double(now[j]), r = to_double(rest[j]), u = x - r;
    FitSums s{w, w * dot(u, u), w * x, w * r, {}};
    for (int a = 0; a < 3; ++a)
      for (int b = 0; b < 3; ++b) s.product[3 * a + b] = w * x[a] * r[b];
    return s;
  }
};

void check_paint(const Buffer<float>& paint, const Lattice* lattice, const char* what) {
  if (!lattice) throw Error(ErrorCode::kInput, std::string("hold: ") + what + " are painted on M, but no lattice is connected", "lattice: <build_tets>.lattice");
  require_size(paint.size(), lattice->rest.vertices(), "hold", what, "vertices of the surface that the lattice binds");
}

}  // namespace

RigidFit rigid_fit(Executor& executor, const Buffer<Vec3f>& points, const TetMesh& tets) {
  const Device device = executor.device();
  const FitBody body{points.view(device).data(), tets.rest.view(device).data(), lane_table(tets.vertex_tets, device)};
  const FitSums s = parallel_reduce(executor, body.tets.lanes, "rigid_fit", FitSums{}, body, [](const FitSums& a, const FitSums& b) { return a + b; });
  RigidFit fit;
  if (!(s.weight > 0) || s.travelled == 0) return fit;
  fit.moved = true;
  fit.centre = (1 / s.weight) * s.now;
  fit.rest_centre = (1 / s.weight) * s.rest;
  Eigen::Matrix3d covariance;
  for (int a = 0; a < 3; ++a)
    for (int b = 0; b < 3; ++b) covariance(a, b) = s.product[3 * a + b] / s.weight - fit.centre[a] * fit.rest_centre[b];
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(covariance, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Eigen::Vector3d spread = svd.singularValues();
  if (!(spread(1) > 1e-12 * spread(0))) return fit;  // points on a line or collapsed to it: no rotation to speak of
  Eigen::Matrix3d flip = Eigen::Matrix3d::Identity();
  flip(2, 2) = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0 ? -1 : 1;
  const Eigen::Matrix3d rotation = svd.matrixU() * flip * svd.matrixV().transpose();
  for (int a = 0; a < 3; ++a)
    for (int b = 0; b < 3; ++b) fit.rotation[3 * a + b] = rotation(a, b);
  return fit;
}

Buffer<float> paint_to_tets(Executor& executor, const Buffer<float>& paint, const Lattice& lattice, bool largest, float elsewhere) {
  const LaneTable gather = lane_table(lattice.gather, executor.device());
  Buffer<float> weights(lattice.tet_rest.size(), executor.memory());
  PaintToTets body{};
  body.paint = paint.view(executor.device()).data();
  body.to = weights.data_for_write();
  body.order = gather.order;
  body.valence = gather.valence;
  body.row_offsets = gather.row_offsets;
  body.indices = gather.indices;
  body.values = gather.values;
  body.largest = largest;
  std::fill_n(body.to, weights.size(), elsewhere);
  uint32_t influencing = 0;  // lanes with neighbours come first
  while (influencing < gather.lanes && gather.valence[influencing] > 0) ++influencing;
  parallel_for(executor, influencing, "paint_to_tets", body);
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
  Buffer<Vec3f> to(points.size(), executor.memory());
  Hold body{};
  body.from = points.view(executor.device()).data();
  body.rest = tets.rest.view(executor.device()).data();
  body.to = to.data_for_write();
  body.weights = weights ? weights.view(executor.device()).data() : nullptr;
  body.pins = pins ? pins.view(executor.device()).data() : nullptr;
  body.strength = static_cast<float>(settings.strength);
  if (settings.remove_rigid && !pinned) body.rigid = rigid_fit(executor, points, tets);
  parallel_for(executor, points.size(), "hold", body);
  return to;
}

}  // namespace knead
