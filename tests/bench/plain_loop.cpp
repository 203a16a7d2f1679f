#include "tests/bench/plain_loop.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "kernels/neighbour_table.h"
#include "kernels/sdf_sample.h"

namespace knead::bench {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kFar = 1e9;
constexpr double kRounding = 1e-6;  // as the kernels: smaller relative errors are the rest shape's

Vector3d to_eigen(const Vec3f& v) {
  return {static_cast<double>(v.x), static_cast<double>(v.y), static_cast<double>(v.z)};
}

Vector3d limited(const Vector3d& step, double longest) {
  const double size = step.norm();
  return size > longest ? Vector3d(step * (longest / size)) : step;
}

}  // namespace

PlainField::PlainField(const Sdf& sdf) {
  const Similarity to_local = sdf.placement.inverse();
  const double local_voxel = static_cast<double>(sdf.voxel_size);
  voxel = local_voxel * sdf.placement.scale;
  const SdfView view{reinterpret_cast<const nanovdb::NanoGrid<float>*>(sdf.grid.host().data()), {-1e9f, -1e9f, -1e9f}, {1e9f, 1e9f, 1e9f}};
  SdfSampler sampler(view);
  std::array<int, 3> first{};
  for (int a = 0; a < 3; ++a) {
    const auto k = static_cast<size_t>(a);
    first[k] = static_cast<int>(std::floor((sdf.lower[a] - sdf.outside_band - sdf.index_origin[a]) / sdf.voxel_size)) - 2;
    size[k] = static_cast<int>(std::ceil((sdf.upper[a] + sdf.outside_band - sdf.index_origin[a]) / sdf.voxel_size)) + 3 - first[k];
    for (int b = 0; b < 3; ++b) to_grid(a, b) = to_local.scale * to_local.rotation[static_cast<size_t>(3 * a + b)] / local_voxel;
    offset[a] = (to_local.translation[a] - static_cast<double>(sdf.index_origin[a])) / local_voxel - first[k];
  }
  for (int i = 0; i < size[0]; ++i)
    for (int j = 0; j < size[1]; ++j)
      for (int k = 0; k < size[2]; ++k)
        values.push_back(sdf.placement.scale * static_cast<double>(sampler.value({static_cast<float>(i + first[0]), static_cast<float>(j + first[1]),
                                                                                  static_cast<float>(k + first[2])})));
}

double PlainField::value(const Vector3d& p) const {
  const Vector3d at = to_grid * p + offset;
  int low[3];
  double part[3];
  for (int k = 0; k < 3; ++k) {
    if (!(at[k] >= 0 && at[k] < size[static_cast<size_t>(k)] - 1)) return kFar;
    low[k] = static_cast<int>(at[k]);
    part[k] = at[k] - low[k];
  }
  double sum = 0;
  for (int n = 0; n < 8; ++n) {
    const int a = n >> 2, b = n >> 1 & 1, c = n & 1;
    const double weight = (a ? part[0] : 1 - part[0]) * (b ? part[1] : 1 - part[1]) * (c ? part[2] : 1 - part[2]);
    sum += weight * values[static_cast<size_t>(((low[0] + a) * size[1] + low[1] + b) * size[2] + low[2] + c)];
  }
  return sum;
}

Vector3d PlainField::gradient(const Vector3d& p) const {
  Vector3d slope;
  for (int k = 0; k < 3; ++k) {
    const Vector3d step = voxel * Vector3d::Unit(k);
    slope[k] = (value(p + step) - value(p - step)) / (2 * voxel);
  }
  return slope;
}

PlainLoop::PlainLoop(const TetMesh& tets, const Lattice& lattice)
    : mean_edge_(static_cast<double>(tets.mean_edge)), memory_limit_(0.1 * lattice.rest.diagonal()) {
  for (const Vec3f& p : tets.rest.host()) x_rest_.push_back(to_eigen(p));
  for (const Vec3f& p : lattice.rest.points.host()) y_rest_.push_back(to_eigen(p));
  x_ = x_next_ = x_rest_;
  y_ = y_rest_;
  displacement_.resize(y_.size());
  memory_.assign(y_.size(), 0);
  tets_of_.resize(x_.size());
  edges_of_.resize(x_.size());
  for (const auto& [a, b, c, d] : tets.tets.host()) {
    for (const uint32_t v : {a, b, c, d}) tets_of_[v].push_back(static_cast<int>(tets_.size()));
    tets_.push_back({static_cast<int>(a), static_cast<int>(b), static_cast<int>(c), static_cast<int>(d)});
  }
  for (const float v : tets.rest_volumes.host()) rest_volumes_.push_back(static_cast<double>(v));
  for (size_t e = 0; e < tets.edges.size(); ++e) {
    const auto [a, b] = tets.edges.host()[e];
    const double length = static_cast<double>(tets.rest_lengths.host()[e]);
    edges_of_[a].push_back({static_cast<int>(b), length});
    edges_of_[b].push_back({static_cast<int>(a), length});
  }
  const auto weights = [](const NeighbourTable& table, size_t rows) {
    std::vector<std::vector<Weighted>> result;
    for (const auto& row : neighbours_by_vertex(table, static_cast<uint32_t>(rows))) {
      result.emplace_back();
      for (const Neighbour& n : row) result.back().push_back({static_cast<int>(n.indices[0]), static_cast<double>(n.value)});
    }
    return result;
  };
  map_ = weights(lattice.map, y_.size());
  gather_ = weights(lattice.gather, x_.size());
  for (int a = 0; a < 3; ++a)
    for (int b = 0; b < 3; ++b) to_local_(a, b) = lattice.to_local.scale * lattice.to_local.rotation[static_cast<size_t>(3 * a + b)];
}

void PlainLoop::place(const Buffer<Vec3f>& points) {
  for (size_t j = 0; j < x_.size(); ++j) x_[j] = to_eigen(points.host()[j]);
  y_ = y_rest_;
  memory_.assign(y_.size(), 0);
}

void PlainLoop::collide(const std::vector<PlainField>& colliders) {
  for (size_t i = 0; i < y_.size(); ++i) {
    double phi = kFar;
    const PlainField* nearest = nullptr;
    for (const PlainField& collider : colliders)
      if (const double value = collider.value(y_[i]); value < phi) phi = value, nearest = &collider;
    memory_[i] = std::clamp(memory_[i] - phi, 0.0, memory_limit_);
    const double push = std::max(memory_[i], -phi);
    displacement_[i].setZero();
    if (push > 0 && nearest) displacement_[i] = push * nearest->gradient(y_[i]).normalized();
  }
}

void PlainLoop::map_to_tets(double max_step) {
  const Matrix3d to_cells = to_local_.inverse();
  for (size_t j = 0; j < x_.size(); ++j) {
    Vector3d sum = Vector3d::Zero();
    for (const Weighted& w : gather_[j]) sum += w.weight * displacement_[static_cast<size_t>(w.index)];
    x_[j] += limited(to_cells * sum, max_step * mean_edge_);
  }
}

void PlainLoop::restore_volume(double relaxation, double regularisation, double max_step) {
  for (size_t v = 0; v < x_.size(); ++v) {
    Matrix3d matrix = Matrix3d::Zero();
    Vector3d right = Vector3d::Zero();
    for (const int t : tets_of_[v]) {
      // The other corners, in the order in which (d - a) . Base is six times the volume.
      const auto& tet = tets_[static_cast<size_t>(t)];
      constexpr int kOthers[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
      int corner = 0;
      while (tet[static_cast<size_t>(corner)] != static_cast<int>(v)) ++corner;
      const auto at = [&](int k) -> const Vector3d& { return x_[static_cast<size_t>(tet[static_cast<size_t>(kOthers[corner][k])])]; };
      const Vector3d base = (at(0) - at(2)).cross(at(1) - at(2));
      const double rest = 6 * rest_volumes_[static_cast<size_t>(t)];
      double error = base.dot(at(2) - x_[v]) - rest;
      if (std::abs(error) <= kRounding * rest) error = 0;
      matrix += base * base.transpose() / rest;
      right += base * (error / rest);
    }
    const double trace = matrix.trace();
    matrix.diagonal().array() += (regularisation / 3 + 1e-6) * trace;
    x_next_[v] = x_[v] + limited(relaxation * matrix.ldlt().solve(right), max_step * mean_edge_);
  }
  x_.swap(x_next_);
}

void PlainLoop::enforce_stiffness(double stiffness, double max_step) {
  for (size_t v = 0; v < x_.size(); ++v) {
    Vector3d sum = Vector3d::Zero();
    for (const Weighted& edge : edges_of_[v]) {
      const Vector3d along = x_[static_cast<size_t>(edge.index)] - x_[v];
      const double now = along.norm();
      if (now > 0 && std::abs(now - edge.weight) > kRounding * edge.weight) sum += along * ((now - edge.weight) / now);
    }
    const double count = std::max<double>(1, static_cast<double>(edges_of_[v].size()));
    x_next_[v] = x_[v] + limited(stiffness / count * sum, max_step * mean_edge_);
  }
  x_.swap(x_next_);
}

void PlainLoop::map_to_surface() {
  for (size_t i = 0; i < y_.size(); ++i) {
    Vector3d sum = Vector3d::Zero();
    for (const Weighted& w : map_[i]) sum += w.weight * (x_[static_cast<size_t>(w.index)] - x_rest_[static_cast<size_t>(w.index)]);
    y_[i] = y_rest_[i] + to_local_ * sum;
  }
}

}  // namespace knead::bench
