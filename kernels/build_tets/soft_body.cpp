#include "kernels/build_tets/soft_body.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "graph/error.h"
#include "kernels/surface/edges.h"
#include "kernels/surface/morton.h"
#include "kernels/surface/principal_frame.h"
#include "kernels/surface/volume.h"
#include "kernels/surface/weld.h"

namespace knead {
namespace {

constexpr size_t kPiece = 8192;

bool is_finite(const Vec3f& p) {
  return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z);
}

std::string counted(size_t n, const char* one, const char* many) {
  return std::to_string(n) + " " + (n == 1 ? one : many);
}

// The cube stands along M's own axes, so that it turns with M. It is 1/32 wider than M and its middle lies thirds, fifths and sevenths of a 64th off
// M's middle, which are never near a multiple of any cell size: the middle planes and the outer planes of a symmetric body do not fall on cell faces,
// where rounding would decide which cell they belong to.
void place_in_cube(const Surface& surface, SoftBody& body, Executor& executor) {
  const auto local = surface.points.host();
  Similarity frame;
  frame.rotation = principal_frame(local, body.triangles).value_or(frame.rotation);
  const Similarity to_frame = frame.inverse();
  Vec3d lower{INFINITY, INFINITY, INFINITY}, upper = -lower;
  for (size_t v = 0; v < local.size(); ++v) {
    if (!body.used[v]) continue;
    const Vec3d p = to_frame.rotate(to_double(local[v]));
    for (int k = 0; k < 3; ++k) {
      lower[k] = std::min(lower[k], p[k]);
      upper[k] = std::max(upper[k], p[k]);
    }
  }
  const double size = std::max({upper.x - lower.x, upper.y - lower.y, upper.z - lower.z});
  if (!(size > 0)) throw Error(ErrorCode::kInput, "the surface has no extent: all of its vertices are in one place", "give it a mesh with triangles");
  const double edge = size * 33 / 32;
  const Vec3d middle = 0.5 * (lower + upper);
  body.centre = {0.5 + 1.0 / 192, 0.5 + 1.0 / 320, 0.5 + 2.0 / 448};
  body.to_local = frame;
  body.to_local.scale = edge;
  body.to_local.translation = frame.rotate(middle - edge * body.centre);
  body.points.resize(local.size());
  executor.parallel_ranges(local.size(), kPiece, [&](size_t begin, size_t end) {
    for (size_t v = begin; v < end; ++v)
      body.points[v] = is_finite(local[v]) ? (1 / edge) * (to_frame.rotate(to_double(local[v])) - middle) + body.centre : body.centre;
  });
}

// The octree takes the keys in order.
std::vector<uint64_t> sorted_keys_of_places(const SoftBody& body) {
  std::vector<uint64_t> keys;
  keys.reserve(body.points.size());
  for (uint32_t v = 0; v < body.points.size(); ++v)
    if (body.used[v] && body.welded[v] == v) keys.push_back(morton_key(body.points[v]));
  std::sort(keys.begin(), keys.end());
  return keys;
}

EdgeUses edge_uses(const SoftBody& body, Executor& executor) {
  std::vector<uint32_t> triangles(body.triangles.size());
  for (size_t c = 0; c < triangles.size(); ++c) triangles[c] = body.welded[body.triangles[c]];
  return EdgeUses(body.points.size(), triangles, &executor);
}

// Triangles joined by relative orientation: find() gives the root and whether the triangle is turned against it.
class Parity {
 public:
  explicit Parity(size_t n) : parent_(n), turned_(n, 0), broken_(n, 0) { std::iota(parent_.begin(), parent_.end(), 0u); }
  std::pair<uint32_t, uint8_t> find(uint32_t t) {
    uint32_t root = t;
    uint8_t parity = 0;
    while (parent_[root] != root) {
      parity ^= turned_[root];
      root = parent_[root];
    }
    for (uint8_t p = parity; parent_[t] != root && t != root;) {
      const uint32_t next = parent_[t];
      const uint8_t own = turned_[t];
      parent_[t] = root;
      turned_[t] = p;
      p ^= own;
      t = next;
    }
    return {root, parity};
  }
  void join(uint32_t a, uint32_t b, uint8_t opposite) {
    const auto [ra, pa] = find(a);
    const auto [rb, pb] = find(b);
    if (ra == rb) {
      if ((pa ^ pb) != opposite) broken_[ra] = 1;
      return;
    }
    const uint32_t low = std::min(ra, rb), high = std::max(ra, rb);
    parent_[high] = low;
    turned_[high] = pa ^ pb ^ opposite;
    broken_[low] |= broken_[high];
  }
  bool broken(uint32_t root) const { return broken_[root] != 0; }

 private:
  std::vector<uint32_t> parent_;
  std::vector<uint8_t> turned_, broken_;
};

// Turns the minority of each component to agree with the majority; a one-sided component (a Moebius strip) stays as it is. Returns how many were
// turned.
size_t orient(SoftBody& body, const EdgeUses& edges) {
  Parity parity(body.triangle_count());
  edges.each_edge([&](uint32_t, std::span<const EdgeUse> uses) {
    if (uses.size() == 2) parity.join(uses[0].triangle(), uses[1].triangle(), uses[0].forward == uses[1].forward);
  });
  std::vector<int64_t> balance(body.triangle_count(), 0);
  for (uint32_t t = 0; t < body.triangle_count(); ++t) {
    const auto [root, turned] = parity.find(t);
    balance[root] += turned ? -1 : 1;
  }
  size_t count = 0;
  for (uint32_t t = 0; t < body.triangle_count(); ++t) {
    const auto [root, turned] = parity.find(t);
    if (parity.broken(root) || turned != (balance[root] >= 0)) continue;
    std::swap(body.triangles[3 * size_t{t} + 1], body.triangles[3 * size_t{t} + 2]);
    ++count;
  }
  return count;
}

struct EdgeCounts {
  size_t open = 0, crowded = 0, misled = 0, unbalanced = 0;
};

EdgeCounts count_edges(const EdgeUses& edges) {
  EdgeCounts counts;
  edges.each_edge([&](uint32_t, std::span<const EdgeUse> uses) {
    const int net = net_use(uses);
    counts.open += uses.size() == 1;
    counts.crowded += uses.size() > 2;
    counts.misled += uses.size() == 2 && net != 0;
    counts.unbalanced += net != 0;
  });
  return counts;
}

void judge_edges(SoftBody& body, Executor& executor, std::vector<std::string>& warnings) {
  const EdgeUses edges = edge_uses(body, executor);
  EdgeCounts counts = count_edges(edges);
  if (counts.misled > 0) {
    const size_t turned = orient(body, edges);
    warnings.push_back(counted(counts.misled, "edge has", "edges have") + " faces of opposite orientation; " +
                       counted(turned, "triangle was", "triangles were") + " turned to agree with their neighbours");
    counts = count_edges(edge_uses(body, executor));
  }
  body.closed = counts.unbalanced == 0;
  if (counts.open > 0)
    warnings.push_back("the surface is open (" + counted(counts.open, "boundary edge", "boundary edges") +
                       "): inside is where its winding number exceeds one half");
  if (counts.crowded > 0)
    warnings.push_back("the surface is not manifold (" + counted(counts.crowded, "edge has", "edges have") +
                       " more than two triangles): taken as it is");
}

// Faces without area have no triangles in the topology. Their edges still close the surface and their vertices are still M's, so they come back as
// fans.
void add_flat_faces(const MeshTopology& topology, std::span<const Vec3f> local, SoftBody& body) {
  std::vector<uint8_t> has_area(topology.faces(), 0);
  for (const uint32_t face : topology.triangle_faces) has_area[face] = 1;
  for (size_t face = 0; face < topology.faces(); ++face) {
    const std::span<const uint32_t> corners(topology.face_vertices.data() + topology.face_offsets[face],
                                            topology.face_vertices.data() + topology.face_offsets[face + 1]);
    const bool good = std::all_of(corners.begin(), corners.end(), [&](uint32_t v) { return v < local.size() && is_finite(local[v]); });
    for (size_t k = 2; good && !has_area[face] && k < corners.size(); ++k)
      body.triangles.insert(body.triangles.end(), {corners[0], corners[k - 1], corners[k]});
    for (const uint32_t v : corners) {
      if (v >= local.size() || body.used[v] || !is_finite(local[v])) continue;
      body.used[v] = 1;
      body.triangles.insert(body.triangles.end(), {v, v, v});
    }
  }
}

}  // namespace

SoftBody make_soft_body(const Surface& surface, Executor& executor, std::vector<std::string>& warnings) {
  SoftBody body;
  const auto local = surface.points.host();
  body.used.assign(local.size(), 0);
  size_t dropped = 0;
  if (surface.topology) {
    const MeshTopology& topology = *surface.topology;
    body.triangles.reserve(topology.triangles.size());
    for (size_t t = 0; t + 2 < topology.triangles.size(); t += 3) {
      const uint32_t* v = &topology.triangles[t];
      const bool good = std::max({v[0], v[1], v[2]}) < local.size() && is_finite(local[v[0]]) && is_finite(local[v[1]]) && is_finite(local[v[2]]);
      dropped += !good;
      if (!good) continue;
      body.triangles.insert(body.triangles.end(), v, v + 3);
      for (int k = 0; k < 3; ++k) body.used[v[k]] = 1;
    }
    if (body.triangles.empty()) {
      throw Error(ErrorCode::kInput,
                  "the surface has no usable triangles (" + std::to_string(topology.faces()) + " faces, " + std::to_string(dropped) +
                      " triangles with a vertex that is missing or not finite)",
                  "give it a mesh with at least one triangle");
    }
    add_flat_faces(topology, local, body);
  }
  if (body.triangles.empty()) throw Error(ErrorCode::kInput, "the surface has no faces", "give it a mesh with at least one triangle");
  if (dropped > 0) warnings.push_back(counted(dropped, "triangle", "triangles") + " with a vertex that is not finite left out");
  place_in_cube(surface, body, executor);
  body.welded = first_at_same_place(std::span<const Vec3d>(body.points), body.used);
  body.sorted_keys = sorted_keys_of_places(body);
  judge_edges(body, executor, warnings);
  body.volume = signed_volume(std::span<const Vec3d>(body.points), body.triangles, body.centre);
  if (body.volume < 0) warnings.push_back("the faces point inwards: inside is taken where the winding number is beyond one half either way");
  return body;
}

}  // namespace knead
