#include "kernels/equilibrium/samples.h"

#include <algorithm>
#include <array>
#include <map>
#include <numeric>
#include <unordered_map>

#include "kernels/neighbour_table.h"

namespace knead {
namespace {

constexpr double kLeastArea = 0.1;  // of the mean: for corners of slivers and vertices of no triangle

using OnTriangle = std::array<std::pair<uint32_t, double>, 3>;  // vertices of M and their shares

// M's triangles, each cut into steps^2 alike.
class CutTriangles {
 public:
  CutTriangles(uint32_t vertices, std::span<const uint32_t> triangles, std::span<const uint8_t> steps) : vertices_(vertices) {
    for (size_t t = 0; t < steps.size(); ++t) cut({triangles[3 * t], triangles[3 * t + 1], triangles[3 * t + 2]}, steps[t]);
  }
  std::vector<OnTriangle> points;    // beyond M's vertices
  std::vector<uint32_t> triangles;   // of M's vertices and, after them, `points`
  std::vector<uint32_t> of, pieces;  // by triangle here: the triangle of M, and into how many that is cut

 private:
  void cut(const std::array<uint32_t, 3>& v, int steps) {
    const auto t = static_cast<uint32_t>(triangle_++);
    const auto corner = [&](int i, int j) { return point(v, i, j, steps); };  // i and j steps from v[2] towards v[0] and v[1]
    const auto add = [&](uint32_t a, uint32_t b, uint32_t c) {
      triangles.insert(triangles.end(), {a, b, c});
      of.push_back(t);
      pieces.push_back(static_cast<uint32_t>(steps * steps));
    };
    for (int i = 0; i < steps; ++i)
      for (int j = 0; i + j < steps; ++j) {
        add(corner(i + 1, j), corner(i, j + 1), corner(i, j));
        if (i + j + 2 <= steps) add(corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1));
      }
    inside_.clear();
  }

  uint32_t point(const std::array<uint32_t, 3>& v, int i, int j, int steps) {
    const int shares[3] = {i, j, steps - i - j};
    for (size_t c = 0; c < 3; ++c)
      if (shares[c] == steps) return v[c];
    for (size_t c = 0; c < 3; ++c)
      if (shares[c] == 0) return on_edge(v[(c + 1) % 3], v[(c + 2) % 3], shares[(c + 1) % 3], steps);
    return once(inside_, static_cast<uint64_t>(i) << 8 | static_cast<uint64_t>(j),
                {{{v[0], share(i, steps)}, {v[1], share(j, steps)}, {v[2], share(shares[2], steps)}}});
  }

  // Neighbours share the points on their edge, also where one of them is cut finer.
  uint32_t on_edge(uint32_t a, uint32_t b, int of_a, int steps) {
    if (a > b) return on_edge(b, a, steps - of_a, steps);
    const int common = std::gcd(of_a, steps);
    const auto fraction = static_cast<uint64_t>(of_a / common) << 5 | static_cast<uint64_t>(steps / common);
    const uint64_t edge = static_cast<uint64_t>(a) * vertices_ + b;
    return once(edges_[edge], fraction, {{{a, share(of_a, steps)}, {b, share(steps - of_a, steps)}, {b, 0.0}}});
  }

  static double share(int part, int steps) { return static_cast<double>(part) / steps; }

  uint32_t once(std::map<uint64_t, uint32_t>& known, uint64_t key, const OnTriangle& at) {
    const auto [found, is_new] = known.try_emplace(key, vertices_ + static_cast<uint32_t>(points.size()));
    if (is_new) points.push_back(at);
    return found->second;
  }

  const uint32_t vertices_;
  size_t triangle_ = 0;
  std::map<uint64_t, uint32_t> inside_;                               // of the triangle that is being cut
  std::unordered_map<uint64_t, std::map<uint64_t, uint32_t>> edges_;  // of edges that are cut
};

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

// M's vertices are there already: adds the points of the cut, and every sample's area, to which its triangles give a third each.
void add_cut(SampleTable& table, const std::vector<Vec3d>& points, std::span<const uint32_t> triangles, std::span<const uint8_t> steps) {
  CutTriangles cut(table.vertices, triangles, steps);
  double enclosed = 0;
  for (size_t t = 0; t + 2 < triangles.size(); t += 3) {
    const Vec3d o = points[triangles[0]];
    enclosed += dot(points[triangles[t]] - o, cross(points[triangles[t + 1]] - o, points[triangles[t + 2]] - o));
  }
  for (size_t c = 0; c < triangles.size(); ++c) {
    const uint32_t next = triangles[c % 3 == 2 ? c - 2 : c + 1];
    table.longest_side = std::max(table.longest_side, length(points[next] - points[triangles[c]]));
  }
  const double side = enclosed < 0 ? -0.5 : 0.5;
  const size_t count = table.vertices + cut.points.size();
  std::vector<double> area(count, 0);
  std::vector<Vec3d> outward(count, Vec3d{0, 0, 0});
  for (size_t s = 0; s < cut.of.size(); ++s) {
    const uint32_t* v = &triangles[3 * size_t{cut.of[s]}];
    const Vec3d facing = (side / static_cast<double>(3 * cut.pieces[s])) * cross(points[v[1]] - points[v[0]], points[v[2]] - points[v[0]]);
    const double share = length(facing);
    for (size_t c = 0; c < 3; ++c) area[cut.triangles[3 * s + c]] += share, outward[cut.triangles[3 * s + c]] += facing;
  }
  const double total = std::accumulate(area.begin(), area.end(), 0.0);
  const double least = total > 0 ? kLeastArea * total / static_cast<double>(area.size()) : 1;

  for (const OnTriangle& point : cut.points) {
    std::map<uint32_t, double> row;
    Vec3d at{0, 0, 0};
    for (const auto& [v, share] : point) {
      if (share == 0) continue;
      at += share * points[v];
      for (uint32_t e = table.offsets[v]; e < table.offsets[v + 1]; ++e) row[table.indices[e]] += share * static_cast<double>(table.weights[e]);
    }
    for (const auto& [p, w] : row) {
      table.indices.push_back(p);
      table.weights.push_back(static_cast<float>(w));
    }
    table.offsets.push_back(static_cast<uint32_t>(table.indices.size()));
    table.rest.push_back(to_float(at));
  }
  for (size_t s = 0; s < count; ++s) {
    table.area.push_back(static_cast<float>(std::max(area[s], least)));
    table.outward.push_back(to_float(outward[s]));
  }
  table.triangles = std::move(cut.triangles);
}

}  // namespace

SampleTable make_samples(const Lattice& lattice, const std::vector<uint32_t>& permuted, int steps, bool gathers) {
  SampleTable table;
  const Similarity to_cells = lattice.to_local.inverse();
  std::vector<Vec3d> points;
  for (const Vec3f& p : lattice.rest.points.host()) points.push_back(to_cells.apply(to_double(p)));
  table.vertices = static_cast<uint32_t>(points.size());
  const auto rows = neighbours_by_vertex(lattice.map, table.vertices);
  table.offsets.push_back(0);
  for (uint32_t i = 0; i < table.vertices; ++i) {
    std::map<uint32_t, double> row;
    for (const Neighbour& e : rows[i])
      if (e.value != 0) row[permuted[e.indices[0]]] += e.value;
    for (const auto& [p, w] : row) {
      table.indices.push_back(p);
      table.weights.push_back(static_cast<float>(w));
    }
    table.offsets.push_back(static_cast<uint32_t>(table.indices.size()));
    table.rest.push_back(to_float(points[i]));
  }
  std::vector<uint32_t> triangles;
  if (lattice.rest.topology) triangles = lattice.rest.topology->triangles;
  table.steps = std::clamp(steps, 1, kMostSteps);
  add_cut(table, points, triangles, std::vector<uint8_t>(triangles.size() / 3, static_cast<uint8_t>(table.steps)));
  transpose(table, permuted.size(), gathers ? table.size() : table.vertices);
  return table;
}

SampleTable refined_samples(const SampleTable& samples, std::span<const uint32_t> triangles, std::span<const uint8_t> steps, size_t h_vertices,
                            bool gathers) {
  SampleTable table;
  const uint32_t n = table.vertices = samples.vertices;
  table.steps = samples.steps;
  table.offsets.assign(samples.offsets.begin(), samples.offsets.begin() + n + 1);
  table.indices.assign(samples.indices.begin(), samples.indices.begin() + table.offsets[n]);
  table.weights.assign(samples.weights.begin(), samples.weights.begin() + table.offsets[n]);
  table.rest.assign(samples.rest.begin(), samples.rest.begin() + n);
  std::vector<Vec3d> points;
  for (const Vec3f& at : table.rest) points.push_back(to_double(at));
  add_cut(table, points, triangles, steps);
  transpose(table, h_vertices, gathers ? table.size() : n);
  return table;
}

SamplesThere put_samples(Executor& executor, const SampleTable& samples, DeviceTables& tables) {
  const auto put = [&](const auto& table) { return tables(executor, table); };
  return {put(samples.offsets), put(samples.indices), put(samples.transpose_offsets), put(samples.transpose_samples),
          put(samples.weights), put(samples.area),    put(samples.transpose_weights), put(samples.rest)};
}

}  // namespace knead
