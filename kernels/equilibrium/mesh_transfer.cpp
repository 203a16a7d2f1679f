#include "kernels/equilibrium/mesh_transfer.h"

#include <algorithm>
#include <map>
#include <tuple>

namespace knead {
namespace {

constexpr uint32_t kNone = ~uint32_t{0};
constexpr double kInside = -1e-6;   // A point counts as in a tet when its least barycentric coordinate is at least this.
constexpr double kOutside = -1e-3;  // Other ways are tried for a point whose least coordinate is below this.
constexpr double kFarthest = -1;    // A point is extrapolated no further than to this coordinate.
constexpr int kMostSteps = 256;     // A walk ends after this many tets.
constexpr int kRetries = 2;         // Rounds over the points for which other ways are tried.

struct Found {
  uint32_t tet = kNone;
  std::array<double, 4> weights{};
  double least = -1e30;
};

// An H by permuted vertices, with the tets around each.
class Mesh {
 public:
  Mesh(Executor& executor, const EquilibriumRest& rest) : rest_(rest), corners_(rest.corners.host().data()), at_(rest.vertices) {
    std::vector<Vec3f> by_vertex(rest.vertices);
    executor.copy(rest.rest.view(executor.device()).data(), executor.device(), by_vertex.data(), Device{}, rest.rest.bytes());
    executor.synchronise();
    for (uint32_t p = 0; p < rest.vertices; ++p) at_[p] = to_double(by_vertex[rest.vertex_at[p]]);
  }
  size_t tets() const { return rest_.tets; }
  const Vec3d& at(uint32_t p) const { return at_[p]; }
  uint32_t corner(uint32_t tet, size_t c) const { return corners_[c * rest_.stride + tet]; }
  std::array<uint32_t, 4> corners(uint32_t tet) const { return {corner(tet, 0), corner(tet, 1), corner(tet, 2), corner(tet, 3)}; }
  template <class F>
  void each_tet(uint32_t p, F&& f) const {
    for (uint32_t e = rest_.incident_offsets[p]; e < rest_.incident_offsets[p + 1]; ++e)
      f(static_cast<uint32_t>(rest_.incident_corners[e] % rest_.stride));
  }
  template <class F>
  void each_neighbour(uint32_t p, F&& f) const {
    each_tet(p, [&](uint32_t t) {
      for (size_t c = 0; c < 4; ++c)
        if (corner(t, c) != p) f(corner(t, c));
    });
  }

 private:
  const EquilibriumRest& rest_;
  const uint32_t* corners_;
  std::vector<Vec3d> at_;
};

class Walker {
 public:
  explicit Walker(const Mesh& mesh) : mesh_(mesh), across_(mesh.tets(), {kNone, kNone, kNone, kNone}) {
    std::vector<std::tuple<std::array<uint32_t, 3>, uint32_t, uint32_t>> faces;  // corners, tet, the corner that it is opposite to
    faces.reserve(4 * mesh.tets());
    for (uint32_t t = 0; t < mesh.tets(); ++t)
      for (uint32_t skip = 0; skip < 4; ++skip) {
        std::array<uint32_t, 3> face{};
        for (uint32_t c = 0, n = 0; c < 4; ++c)
          if (c != skip) face[n++] = mesh.corner(t, c);
        std::sort(face.begin(), face.end());
        faces.emplace_back(face, t, skip);
      }
    std::sort(faces.begin(), faces.end());
    for (size_t i = 0; i + 1 < faces.size(); ++i) {
      const auto& [face, t, c] = faces[i];
      const auto& [next_face, next_t, next_c] = faces[i + 1];
      if (face == next_face) across_[t][c] = next_t, across_[next_t][next_c] = t;
    }
  }

  Found in(uint32_t tet, const Vec3d& x) const {
    const Vec3d a = mesh_.at(mesh_.corner(tet, 0));
    const Vec3d b = mesh_.at(mesh_.corner(tet, 1)) - a, c = mesh_.at(mesh_.corner(tet, 2)) - a, d = mesh_.at(mesh_.corner(tet, 3)) - a, y = x - a;
    const double over = 1 / dot(b, cross(c, d));
    Found found{tet, {0, over * dot(y, cross(c, d)), over * dot(y, cross(d, b)), over * dot(y, cross(b, c))}, 0};
    found.weights[0] = 1 - found.weights[1] - found.weights[2] - found.weights[3];
    found.least = *std::min_element(found.weights.begin(), found.weights.end());
    return found;
  }

  // Through the face that x is farthest beyond and that leads somewhere. Of the tets on the way the one that x is least outside of.
  Found walk(uint32_t tet, const Vec3d& x) const {
    Found best;
    for (int step = 0; step < kMostSteps; ++step) {
      const Found here = in(tet, x);
      if (here.least > best.least) best = here;
      if (here.least >= kInside) break;
      uint32_t next = kNone;
      double beyond = kInside;
      for (size_t c = 0; c < 4; ++c)
        if (here.weights[c] < beyond && across_[tet][c] != kNone) next = across_[tet][c], beyond = here.weights[c];
      if (next == kNone) break;
      tet = next;
    }
    return best;
  }

 private:
  const Mesh& mesh_;
  std::vector<std::array<uint32_t, 4>> across_;
};

// The tet of `from` that binds vertex m of M: the one that has most of its row, and holds it best.
uint32_t binding_tet(const EquilibriumRest& from, const Mesh& mesh, const Walker& walker, uint32_t m) {
  const SampleTable& s = from.samples;
  const auto begin = s.offsets[m], end = s.offsets[m + 1];
  if (begin == end) return kNone;
  const auto heaviest = std::max_element(s.weights.begin() + begin, s.weights.begin() + end) - s.weights.begin();
  std::tuple<float, double> best{-1e30f, 0.0};
  uint32_t tet = kNone;
  mesh.each_tet(s.indices[static_cast<size_t>(heaviest)], [&](uint32_t t) {
    float share = 0;
    for (uint32_t e = begin; e < end; ++e)
      for (size_t c = 0; c < 4; ++c)
        if (mesh.corner(t, c) == s.indices[e]) share += s.weights[e];
    const std::tuple<float, double> here{share, walker.in(t, to_double(s.rest[m])).least};
    if (here > best) best = here, tet = t;
  });
  return tet;
}

// By permuted vertex: the vertex of M that has most to do with the vertex; kNone: none has.
std::vector<uint32_t> bound_vertices(const EquilibriumRest& rest) {
  const SampleTable& s = rest.samples;
  std::vector<uint32_t> bound(rest.vertices, kNone);
  std::vector<float> weight(rest.vertices, 0);
  for (uint32_t m = 0; m < s.vertices; ++m)
    for (uint32_t e = s.offsets[m]; e < s.offsets[m + 1]; ++e)
      if (s.weights[e] > weight[s.indices[e]]) weight[s.indices[e]] = s.weights[e], bound[s.indices[e]] = m;
  return bound;
}

}  // namespace

MeshTransfer make_mesh_transfer(Executor& executor, const EquilibriumRest& from, const EquilibriumRest& to) {
  const Mesh coarse(executor, from), fine(executor, to);
  const Walker walker(coarse);
  const Similarity across = from.to_local.inverse() * to.to_local;
  const auto target = [&](uint32_t p) { return across.apply(fine.at(p)); };
  std::vector<Found> found(to.vertices);
  std::vector<uint32_t> queue;
  queue.reserve(to.vertices);

  const std::vector<uint32_t> bound = bound_vertices(to);
  std::map<uint32_t, uint32_t> tet_of;
  for (uint32_t p = 0; p < to.vertices; ++p) {
    if (bound[p] == kNone) continue;
    const auto [known, is_new] = tet_of.try_emplace(bound[p], kNone);
    if (is_new) known->second = binding_tet(from, coarse, walker, bound[p]);
    if (known->second == kNone) continue;
    found[p] = walker.walk(known->second, target(p));
    queue.push_back(p);
  }
  for (size_t i = 0; i < queue.size(); ++i)
    fine.each_neighbour(queue[i], [&](uint32_t q) {
      if (found[q].tet != kNone) return;
      found[q] = walker.walk(found[queue[i]].tet, target(q));
      queue.push_back(q);
    });
  // A walk that ended at a wall may have gone round the wrong corner.
  for (int retry = 0; retry < kRetries; ++retry)
    for (const uint32_t p : queue) {
      if (found[p].least >= kOutside) continue;
      fine.each_neighbour(p, [&](uint32_t q) {
        const Found other = walker.walk(found[q].tet, target(p));
        if (other.least > found[p].least) found[p] = other;
      });
    }

  MeshTransfer table;
  table.vertices.assign(to.vertices, {0, 0, 0, 0});
  table.weights.assign(to.vertices, {0, 0, 0, 0});
  for (const uint32_t p : queue) {
    const Found& f = found[p];
    table.outside += f.least < kOutside;
    table.vertices[p] = coarse.corners(f.tet);
    const double near = std::min(1.0, (0.25 - kFarthest) / (0.25 - f.least));
    for (size_t c = 0; c < 4; ++c) table.weights[p][c] = static_cast<float>(0.25 + near * (f.weights[c] - 0.25));
  }
  return table;
}

}  // namespace knead
