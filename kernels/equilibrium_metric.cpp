#include <array>

#include "kernels/equilibrium_rest.h"

namespace knead {
namespace {

constexpr double kFloating = 1e-5;  // a floating body without hold stays solvable in float32

// A tet's shape gradients, in double, whatever the table keeps for the elastic term.
std::array<Vec3d, 4> gradients_of(const EquilibriumRest& rest, size_t k) {
  const float* shape = rest.shape.host().data() + k;
  std::array<Vec3d, 3> g;
  for (size_t c = 0; c < 3; ++c) g[c] = {shape[3 * c * rest.stride], shape[(3 * c + 1) * rest.stride], shape[(3 * c + 2) * rest.stride]};
  if (rest.term == ElasticTerm::kEdges) {
    const double over = 1 / dot(g[0], cross(g[1], g[2]));
    g = {over * cross(g[1], g[2]), over * cross(g[2], g[0]), over * cross(g[0], g[1])};
  }
  return {-(g[0] + g[1] + g[2]), g[0], g[1], g[2]};
}

// C n for every corner.
std::array<Vec3d, 4> turned(const EquilibriumRest& rest, size_t k, const Row4* u, const std::array<Vec3d, 4>& n) {
  const uint32_t* corners = rest.corners.host().data() + k;
  Mat3<double> f{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  const Vec3d first = to_double(to_vec(u[corners[0]]));
  for (size_t c = 1; c < 4; ++c) {
    const Vec3d s = to_double(to_vec(u[corners[c * rest.stride]])) - first;
    f.x += s.x * n[c];
    f.y += s.y * n[c];
    f.z += s.z * n[c];
  }
  const Mat3<double> m = cofactors(f);
  std::array<Vec3d, 4> result;
  for (size_t c = 0; c < 4; ++c) result[c] = {dot(m.x, n[c]), dot(m.y, n[c]), dot(m.z, n[c])};
  return result;
}

}  // namespace

void EquilibriumRest::metric_at(const Row4* u, std::vector<float>& entries, std::vector<float>& diagonal) const {
  std::vector<double> by_edge(edges, 0), by_place(places, 0);
  const uint32_t* corner = corners.host().data();
  for (size_t k = 0; k < tets; ++k) {
    const std::array<Vec3d, 4> n = gradients_of(*this, k), c = u ? turned(*this, k, u, n) : n;
    const double m = mu.host()[k], l = lambda.host()[k] - (term == ElasticTerm::kStableNeoHookean ? mu.host()[k] : 0);
    for (size_t i = 0, e = 6 * k; i < 4; ++i) {
      by_place[corner[i * stride + k]] += m * dot(n[i], n[i]) + l * dot(c[i], c[i]);
      for (size_t j = i + 1; j < 4; ++j, ++e) {
        if (free[corner[i * stride + k]] != 0 && free[corner[j * stride + k]] != 0)
          by_edge[tet_edges[e]] += m * dot(n[i], n[j]) + l * dot(c[i], c[j]);
      }
    }
  }
  for (uint32_t p = 0; p < places; ++p) by_place[p] = free[p] == 0 ? 1 : (by_place[p] + hold[p]) * (1 + kFloating);
  entries.assign(by_edge.begin(), by_edge.end());
  diagonal.assign(by_place.begin(), by_place.end());
}

}  // namespace knead
