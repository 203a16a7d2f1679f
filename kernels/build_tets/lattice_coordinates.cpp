#include "kernels/build_tets/lattice_coordinates.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "kernels/neighbour_table.h"

namespace knead {

std::array<double, 4> barycentric_coordinates(const Vec3d& p, const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d) {
  const Vec3d ab = b - a, ac = c - a, ad = d - a, ap = p - a;
  const double inverse = 1 / dot(cross(ab, ac), ad);
  const double wb = inverse * dot(cross(ap, ac), ad), wc = inverse * dot(cross(ab, ap), ad), wd = inverse * dot(cross(ab, ac), ap);
  return {1 - wb - wc - wd, wb, wc, wd};
}

std::array<double, 8> trilinear_coordinates(const Vec3d& p) {
  std::array<double, 8> weights;
  for (size_t corner = 0; corner < 8; ++corner)
    weights[corner] = ((corner & 1) != 0 ? p.x : 1 - p.x) * ((corner & 2) != 0 ? p.y : 1 - p.y) * ((corner & 4) != 0 ? p.z : 1 - p.z);
  return weights;
}

void mean_value_coordinates(std::span<const Vec3d> vertices, std::span<const std::array<uint8_t, 3>> triangles, const Vec3d& p,
                            std::span<double> weights) {
  constexpr double kNear = 1e-7;  // of the cage's size: nearer than this is on
  std::array<Vec3d, 32> unit;
  std::array<double, 32> distance;
  std::fill(weights.begin(), weights.end(), 0.0);
  for (size_t j = 0; j < vertices.size(); ++j) {
    const Vec3d way = vertices[j] - p;
    distance[j] = length(way);
    if (distance[j] < kNear) {
      weights[j] = 1;
      return;
    }
    unit[j] = (1 / distance[j]) * way;
  }
  for (const auto& t : triangles) {
    const Vec3d &a = vertices[t[0]], normal = cross(vertices[t[1]] - a, vertices[t[2]] - a);
    const double twice = length(normal);
    if (std::abs(dot(normal, p - a)) < kNear * twice) {
      std::array<double, 3> area;  // of the triangle with p in place of corner k, over the whole
      for (size_t k = 0; k < 3; ++k) area[k] = dot(normal, cross(vertices[t[(k + 1) % 3]] - p, vertices[t[(k + 2) % 3]] - p)) / (twice * twice);
      if (*std::min_element(area.begin(), area.end()) < -kNear) continue;  // in the plane but beside the triangle: it adds nothing
      std::fill(weights.begin(), weights.end(), 0.0);
      double sum = 0;
      for (size_t k = 0; k < 3; ++k) sum += weights[t[k]] = std::max(0.0, area[k]);
      for (size_t k = 0; k < 3; ++k) weights[t[k]] /= sum;
      return;
    }
    // The mean vector of the spherical triangle, split along its corners. Ju et al. write the same with cosines, which lose their digits near a face.
    Vec3d side[3], mean{0, 0, 0};
    for (size_t k = 0; k < 3; ++k) {
      const Vec3d &u = unit[t[(k + 1) % 3]], &v = unit[t[(k + 2) % 3]];
      side[k] = cross(u, v);
      const double sine = length(side[k]);
      side[k] = (1 / sine) * side[k];
      mean += std::atan2(sine, dot(u, v)) * side[k];
    }
    for (size_t k = 0; k < 3; ++k) weights[t[k]] += dot(side[k], mean) / (distance[t[k]] * dot(side[k], unit[t[k]]));
  }
  const double sum = std::accumulate(weights.begin(), weights.end(), 0.0);
  for (double& w : weights) w /= sum;
}

void append_row(std::span<const uint32_t> row_indices, std::span<const double> row_weights, std::vector<uint32_t>& indices,
                std::vector<float>& weights) {
  constexpr double kLeast = 1e-7;
  double sum = 0;
  for (const double weight : row_weights)
    if (weight > kLeast) sum += weight;
  const size_t first = weights.size();
  double rounded = 0;
  for (size_t i = 0; i < row_weights.size(); ++i) {
    if (row_weights[i] <= kLeast) continue;
    indices.push_back(row_indices[i]);
    weights.push_back(static_cast<float>(row_weights[i] / sum));
    rounded += double{weights.back()};
  }
  float& largest = *std::max_element(weights.begin() + static_cast<ptrdiff_t>(first), weights.end());
  largest = static_cast<float>(double{largest} + (1 - rounded));
}

void fill_lattice_tables(const LatticeRows& rows, std::span<const uint8_t> used, uint32_t tet_vertices, Lattice& lattice, Executor& executor) {
  lattice.map = make_neighbour_table({rows.offsets, rows.indices, rows.weights, 1}, PadIndex::kZero, Lanes::kAll, executor);
  std::vector<uint32_t> offsets(size_t{tet_vertices} + 1, 0);
  const uint32_t vertices = static_cast<uint32_t>(rows.offsets.size() - 1);
  const auto each_entry = [&](auto&& f) {
    for (uint32_t i = 0; i < vertices; ++i)
      for (uint32_t e = rows.offsets[i]; used[i] != 0 && e < rows.offsets[i + 1]; ++e) f(i, rows.indices[e], rows.weights[e]);
  };
  std::vector<double> sum(tet_vertices, 0);
  each_entry([&](uint32_t, uint32_t j, float w) {
    ++offsets[j + 1];
    sum[j] += double{w};
  });
  std::partial_sum(offsets.begin(), offsets.end(), offsets.begin());
  std::vector<uint32_t> next(offsets.begin(), offsets.end() - 1), indices(offsets.back());
  std::vector<float> values(offsets.back());
  each_entry([&](uint32_t i, uint32_t j, float w) {
    indices[next[j]] = i;
    values[next[j]++] = static_cast<float>(double{w} / sum[j]);
  });
  lattice.gather = make_neighbour_table({offsets, indices, values, 1}, PadIndex::kZero, Lanes::kWithNeighbours, executor);
}

}  // namespace knead
