#include <algorithm>
#include <array>
#include <map>
#include <numeric>

#include "kernels/equilibrium/rest_tables.h"
#include "kernels/neighbour_table.h"

namespace knead {
namespace {

constexpr double kLeastArea = 0.1;  // of the mean: for corners of slivers and vertices of no triangle

using OnTriangle = std::array<std::pair<uint32_t, double>, 3>;  // vertices of M and their shares

// Points inside a triangle and on its edges. A point on an edge belongs to the triangle that has the edge in rising order of its ends, so that it is
// there once (on an edge of one triangle in falling order not at all).
std::vector<OnTriangle> points_within(const std::array<uint32_t, 3>& v, int steps) {
  std::vector<OnTriangle> found;
  for (int i = 0; i <= steps && steps >= 2; ++i)
    for (int j = 0; i + j <= steps; ++j) {
      const int k = steps - i - j;
      if (i == steps || j == steps || k == steps) continue;
      if ((k == 0 && v[0] > v[1]) || (i == 0 && v[1] > v[2]) || (j == 0 && v[2] > v[0])) continue;
      found.push_back({{{v[0], static_cast<double>(i) / steps}, {v[1], static_cast<double>(j) / steps}, {v[2], static_cast<double>(k) / steps}}});
    }
  return found;
}

// The transpose: those of the first `samples` that a vertex of H moves.
void transpose(SampleTable& table, size_t vertices, size_t samples) {
  table.transpose_offsets.assign(vertices + 1, 0);
  const uint32_t entries = table.offsets[samples];
  for (uint32_t e = 0; e < entries; ++e) ++table.transpose_offsets[table.indices[e] + 1];
  for (size_t p = 0; p < vertices; ++p) table.transpose_offsets[p + 1] += table.transpose_offsets[p];
  table.transpose_samples.resize(entries);
  table.transpose_weights.resize(entries);
  std::vector<uint32_t> cursor(table.transpose_offsets.begin(), table.transpose_offsets.end() - 1);
  for (uint32_t s = 0; s < samples; ++s)
    for (uint32_t e = table.offsets[s]; e < table.offsets[s + 1]; ++e) {
      const uint32_t at = cursor[table.indices[e]]++;
      table.transpose_samples[at] = s;
      table.transpose_weights[at] = table.weights[e];
    }
}

}  // namespace

SampleTable make_samples(const Lattice& lattice, const std::vector<uint32_t>& permuted, int steps, bool gathers) {
  SampleTable table;
  const Similarity to_cells = lattice.to_local.inverse();
  std::vector<Vec3d> points;
  for (const Vec3f& p : lattice.rest.points.host()) points.push_back(to_cells.apply(to_double(p)));
  const uint32_t n = static_cast<uint32_t>(points.size());
  std::vector<uint32_t> triangles;
  if (lattice.rest.topology) triangles = lattice.rest.topology->triangles;
  double enclosed = 0;
  for (size_t t = 0; t + 2 < triangles.size(); t += 3) {
    const Vec3d o = points[triangles[0]];
    enclosed += dot(points[triangles[t]] - o, cross(points[triangles[t + 1]] - o, points[triangles[t + 2]] - o));
  }
  const double side = enclosed < 0 ? -0.5 : 0.5;

  std::vector<OnTriangle> inner;
  std::vector<double> area(n, 0);  // a triangle shares its area out evenly
  std::vector<Vec3d> outward(n, Vec3d{0, 0, 0});
  for (size_t t = 0; t + 2 < triangles.size(); t += 3) {
    const std::array<uint32_t, 3> v{triangles[t], triangles[t + 1], triangles[t + 2]};
    const std::vector<OnTriangle> here = points_within(v, steps);
    const Vec3d facing = (side / static_cast<double>(3 + here.size())) * cross(points[v[1]] - points[v[0]], points[v[2]] - points[v[0]]);
    const double share = length(facing);
    for (const uint32_t c : v) area[c] += share, outward[c] += facing;
    inner.insert(inner.end(), here.begin(), here.end());
    area.resize(n + inner.size(), share);
    outward.resize(n + inner.size(), facing);
  }
  const double total = std::accumulate(area.begin(), area.end(), 0.0);
  const double least = total > 0 ? kLeastArea * total / static_cast<double>(area.size()) : 1;

  const auto rows = neighbours_by_vertex(lattice.map, n);
  table.offsets.push_back(0);
  const auto add = [&](const OnTriangle& sample, size_t s) {
    std::map<uint32_t, double> row;
    Vec3d at{0, 0, 0};
    for (const auto& [v, share] : sample) {
      if (share == 0) continue;
      at += share * points[v];
      for (const Neighbour& e : rows[v])
        if (e.value != 0) row[permuted[e.indices[0]]] += share * e.value;
    }
    for (const auto& [p, w] : row) {
      table.indices.push_back(p);
      table.weights.push_back(static_cast<float>(w));
    }
    table.offsets.push_back(static_cast<uint32_t>(table.indices.size()));
    table.rest.push_back(to_float(at));
    table.area.push_back(static_cast<float>(std::max(area[s], least)));
    table.outward.push_back(to_float(outward[s]));
  };
  for (uint32_t i = 0; i < n; ++i) add({{{i, 1.0}, {i, 0.0}, {i, 0.0}}}, i);
  for (size_t s = 0; s < inner.size(); ++s) add(inner[s], n + s);
  table.vertices = n;
  transpose(table, permuted.size(), gathers ? table.size() : n);
  return table;
}

}  // namespace knead
