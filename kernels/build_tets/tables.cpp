#include "kernels/build_tets/tables.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "graph/error.h"
#include "kernels/build_tets/strips.h"
#include "kernels/neighbour_table.h"

namespace knead {
namespace {

constexpr size_t kPiece = 4096;

// For the corner at position p of a positive tet, the positions of the others, so that the tet (p, those three) is positive too.
constexpr uint8_t kOthers[4][3] = {{1, 2, 3}, {0, 3, 2}, {3, 0, 1}, {2, 1, 0}};

struct CornerLists {  // tets around each vertex, 4 * tet + position
  std::vector<uint32_t> offsets, corners;
  CornerLists(const std::vector<std::array<uint32_t, 4>>& tets, size_t vertices) : offsets(vertices + 1, 0), corners(4 * tets.size()) {
    for (const auto& tet : tets)
      for (const uint32_t v : tet) ++offsets[v + 1];
    std::partial_sum(offsets.begin(), offsets.end(), offsets.begin());
    std::vector<uint32_t> next(offsets.begin(), offsets.end() - 1);
    for (uint32_t t = 0; t < tets.size(); ++t)
      for (uint32_t k = 0; k < 4; ++k) corners[next[tets[t][k]]++] = 4 * t + k;
  }
};

std::vector<std::array<uint32_t, 2>> edges_of(const std::vector<std::array<uint32_t, 4>>& tets, const CornerLists& lists, Executor& executor) {
  const size_t vertices = lists.offsets.size() - 1;
  std::vector<std::vector<std::array<uint32_t, 2>>> found((vertices + kPiece - 1) / kPiece);
  executor.parallel_ranges(vertices, kPiece, [&](size_t begin, size_t end) {
    std::vector<uint32_t> others;
    for (size_t v = begin; v < end; ++v) {
      others.clear();
      for (uint32_t c = lists.offsets[v]; c < lists.offsets[v + 1]; ++c)
        for (const uint32_t w : tets[lists.corners[c] / 4])
          if (w > v) others.push_back(w);
      std::sort(others.begin(), others.end());
      others.erase(std::unique(others.begin(), others.end()), others.end());
      for (const uint32_t w : others) found[begin / kPiece].push_back({static_cast<uint32_t>(v), w});
    }
  });
  std::vector<std::array<uint32_t, 2>> edges;
  for (const auto& piece : found) edges.insert(edges.end(), piece.begin(), piece.end());
  return edges;
}

NeighbourTable tet_table(const std::vector<std::array<uint32_t, 4>>& tets, std::span<const float> volumes, const CornerLists& lists,
                         Executor& executor) {
  std::vector<uint32_t> indices(3 * lists.corners.size());
  std::vector<float> values(lists.corners.size());
  executor.parallel_ranges(lists.corners.size(), 4 * kPiece, [&](size_t begin, size_t end) {
    for (size_t e = begin; e < end; ++e) {
      const uint32_t tet = lists.corners[e] / 4, position = lists.corners[e] % 4;
      for (size_t c = 0; c < 3; ++c) indices[3 * e + c] = tets[tet][kOthers[position][c]];
      values[e] = volumes[tet];
    }
  });
  return make_neighbour_table({lists.offsets, indices, values, 3}, PadIndex::kOwnVertex, Lanes::kAll, executor);
}

NeighbourTable edge_table(const std::vector<std::array<uint32_t, 2>>& edges, std::span<const float> lengths, size_t vertices, Executor& executor) {
  std::vector<uint32_t> offsets(vertices + 1, 0), indices(2 * edges.size());
  std::vector<float> values(2 * edges.size());
  for (const auto& edge : edges)
    for (const uint32_t v : edge) ++offsets[v + 1];
  std::partial_sum(offsets.begin(), offsets.end(), offsets.begin());
  std::vector<uint32_t> next(offsets.begin(), offsets.end() - 1);
  for (size_t e = 0; e < edges.size(); ++e)
    for (size_t k = 0; k < 2; ++k) {
      uint32_t& at = next[edges[e][k]];
      indices[at] = edges[e][1 - k];
      values[at++] = lengths[e];
    }
  return make_neighbour_table({offsets, indices, values, 1}, PadIndex::kOwnVertex, Lanes::kAll, executor);
}

}  // namespace

std::vector<uint32_t> vertex_order(const std::vector<std::array<int32_t, 3>>& places, const std::vector<std::array<uint32_t, 4>>& tets) {
  const size_t vertices = places.size();
  std::vector<uint32_t> valence(vertices, 0);
  for (const auto& tet : tets)
    for (const uint32_t v : tet) ++valence[v];
  struct Keyed {
    uint32_t valence;
    uint64_t key;
    uint32_t vertex;
  };
  std::vector<Keyed> order(vertices);
  for (uint32_t v = 0; v < vertices; ++v) {
    const auto& at = places[v];
    order[v] = {valence[v], morton_key(static_cast<uint32_t>(at[0]), static_cast<uint32_t>(at[1]), static_cast<uint32_t>(at[2])), v};
  }
  std::sort(order.begin(), order.end(), [](const Keyed& a, const Keyed& b) { return a.key != b.key ? a.key < b.key : a.vertex < b.vertex; });
  for (size_t begin = 0; begin < vertices; begin += kSortWindow)
    std::stable_sort(order.begin() + static_cast<ptrdiff_t>(begin), order.begin() + static_cast<ptrdiff_t>(std::min(begin + kSortWindow, vertices)),
                     [](const Keyed& a, const Keyed& b) { return a.valence > b.valence; });
  std::vector<uint32_t> vertex_at(vertices);
  for (uint32_t i = 0; i < vertices; ++i) vertex_at[i] = order[i].vertex;
  return vertex_at;
}

void sort_vertices(RawTets& raw) {
  const std::vector<uint32_t> vertex_at = vertex_order(raw.places, raw.tets);
  std::vector<uint32_t> renumbered(vertex_at.size());
  std::vector<std::array<int32_t, 3>> places(vertex_at.size());
  for (uint32_t i = 0; i < vertex_at.size(); ++i) {
    renumbered[vertex_at[i]] = i;
    places[i] = raw.places[vertex_at[i]];
  }
  raw.places = std::move(places);
  for (auto& tet : raw.tets)
    for (uint32_t& v : tet) v = renumbered[v];
  for (uint32_t& v : raw.slot_vertices)
    if (v != Octree::kNone) v = renumbered[v];
}

TetMesh make_tet_mesh(const std::vector<Vec3d>& positions, const std::vector<std::array<uint32_t, 4>>& tets, std::span<const float> volumes,
                      Executor& executor) {
  TetMesh mesh;
  const size_t vertices = positions.size();
  if (tets.size() > UINT32_MAX / 4) throw Error(ErrorCode::kMemory, "H has more than 2^30 tets", "lower max_depth or min_depth");
  mesh.rest = Buffer<Vec3f>(vertices);
  Vec3f* rest = mesh.rest.data_for_write();
  for (size_t v = 0; v < vertices; ++v) rest[v] = to_float(positions[v]);
  mesh.tets = Buffer<std::array<uint32_t, 4>>(tets);
  mesh.rest_volumes = Buffer<float>(std::vector<float>(volumes.begin(), volumes.end()));

  const CornerLists lists(tets, vertices);
  const std::vector<std::array<uint32_t, 2>> edges = edges_of(tets, lists, executor);
  mesh.edges = Buffer<std::array<uint32_t, 2>>(edges);
  mesh.rest_lengths = Buffer<float>(edges.size());
  float* lengths = mesh.rest_lengths.data_for_write();
  double sum = 0;
  for (size_t e = 0; e < edges.size(); ++e) {
    const double size = length(positions[edges[e][1]] - positions[edges[e][0]]);
    lengths[e] = static_cast<float>(size);
    sum += size;
  }
  mesh.mean_edge = static_cast<float>(sum / static_cast<double>(edges.size()));
  mesh.vertex_tets = tet_table(tets, mesh.rest_volumes.host(), lists, executor);
  mesh.vertex_strips = make_strips(mesh.vertex_tets, executor);
  mesh.lane_volumes = lane_sums(mesh.vertex_tets);
  mesh.vertex_edges = edge_table(edges, mesh.rest_lengths.host(), vertices, executor);
  return mesh;
}

TetMesh make_tet_mesh(const RawTets& raw, const std::array<int32_t, 3>& origin, Executor& executor) {
  constexpr double kUnit = kPlaceUnit;
  std::vector<Vec3d> positions(raw.places.size());
  for (size_t v = 0; v < positions.size(); ++v) {
    const auto& at = raw.places[v];
    positions[v] = (1 / kUnit) * Vec3d{double(at[0] - origin[0]), double(at[1] - origin[1]), double(at[2] - origin[2])};
  }
  std::vector<float> volumes(raw.tets.size());
  executor.parallel_ranges(raw.tets.size(), kPiece, [&](size_t begin, size_t end) {
    for (size_t t = begin; t < end; ++t) {
      const auto& [a, b, c, d] = raw.tets[t];
      volumes[t] = static_cast<float>(static_cast<double>(six_volumes(raw.places[a], raw.places[b], raw.places[c], raw.places[d])) /
                                      (6 * kUnit * kUnit * kUnit));
    }
  });
  return make_tet_mesh(positions, raw.tets, volumes, executor);
}

}  // namespace knead
