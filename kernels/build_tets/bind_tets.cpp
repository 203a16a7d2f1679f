#include "kernels/build_tets/bind_tets.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numeric>

#include "graph/error.h"
#include "kernels/build_tets/lattice_coordinates.h"
#include "kernels/build_tets/tables.h"
#include "kernels/surface/disjoint_sets.h"
#include "kernels/surface/mesh_distance.h"

namespace knead {
namespace {

using Tet = std::array<uint32_t, 4>;

constexpr size_t kPiece = 1024;
constexpr double kFlat = 1e-6;       // six volumes over the longest edge cubed: no more is no volume
constexpr double kOutside = 1e-6;    // of M's diagonal: less is rounding
constexpr double kBoxes = 4e6;       // of the search, at the most
constexpr double kPlaces = 1 << 20;  // along an axis, for the order of vertices

std::string counted(size_t n, const char* one, const char* many) {
  return std::to_string(n) + " " + (n == 1 ? one : many);
}

double six_volumes(const std::vector<Vec3d>& points, const Tet& t) {
  const Vec3d& a = points[t[0]];
  return dot(cross(points[t[1]] - a, points[t[2]] - a), points[t[3]] - a);
}

double longest_edge(const std::vector<Vec3d>& points, const Tet& t) {
  double longest = 0;
  for (size_t i = 0; i < 4; ++i)
    for (size_t j = 0; j < i; ++j) longest = std::max(longest, length(points[t[i]] - points[t[j]]));
  return longest;
}

void check_indices(const GivenTets& given) {
  for (size_t v = 0; v < given.points.size(); ++v)
    for (int k = 0; k < 3; ++k)
      if (!std::isfinite(given.points[v][k])) throw Error(ErrorCode::kInput, "vertex " + std::to_string(v) + " of the tet mesh is not finite");
  for (size_t t = 0; t < given.tets.size(); ++t)
    for (const uint32_t v : given.tets[t])
      if (v >= given.points.size())
        throw Error(ErrorCode::kInput,
                    "tet " + std::to_string(t) + " names vertex " + std::to_string(v) + " of " + std::to_string(given.points.size()));
}

void turn_and_drop_tets(GivenTets& given, std::vector<std::string>& warnings) {
  size_t turned = 0, kept = 0;
  for (Tet tet : given.tets) {
    const double volume = six_volumes(given.points, tet), longest = longest_edge(given.points, tet);
    if (!(std::abs(volume) > kFlat * longest * longest * longest)) continue;
    if (volume < 0) {
      std::swap(tet[2], tet[3]);
      ++turned;
    }
    given.tets[kept++] = tet;
  }
  const size_t flat = given.tets.size() - kept;
  given.tets.resize(kept);
  if (kept == 0) throw Error(ErrorCode::kInput, "the tet mesh has no tet with a volume", "give it a mesh with tetrahedra");
  if (flat > 0) warnings.push_back(counted(flat, "tet has", "tets have") + " no volume and " + (flat == 1 ? "is" : "are") + " left out");
  if (turned > 0) warnings.push_back(counted(turned, "tet was", "tets were") + " inside out and turned");
}

void drop_unused_vertices(GivenTets& given, std::vector<std::string>& warnings) {
  std::vector<uint32_t> number(given.points.size(), 0);
  for (const Tet& tet : given.tets)
    for (const uint32_t v : tet) number[v] = 1;
  uint32_t kept = 0;
  for (size_t v = 0; v < number.size(); ++v) {
    if (number[v] == 0) continue;
    given.points[kept] = given.points[v];
    number[v] = kept++;
  }
  const size_t unused = given.points.size() - kept;
  given.points.resize(kept);
  for (Tet& tet : given.tets)
    for (uint32_t& v : tet) v = number[v];
  if (unused > 0) warnings.push_back(counted(unused, "vertex", "vertices") + " of the tet mesh that no tet uses left out");
}

void say_pieces(const GivenTets& given, std::vector<std::string>& warnings) {
  DisjointSets sets(given.points.size());
  for (const Tet& tet : given.tets)
    for (size_t k = 1; k < 4; ++k) sets.join(tet[0], tet[k]);
  size_t pieces = 0;
  for (uint32_t v = 0; v < given.points.size(); ++v) pieces += sets.find(v) == v;
  if (pieces > 1) warnings.push_back("the tet mesh is in " + std::to_string(pieces) + " pieces, which nothing holds together");
}

struct Face {
  std::array<uint32_t, 3> sorted, corners;  // seen from outside
  uint32_t tet;
};

// The faces that one tet has alone. Says where more than two share one.
std::vector<Face> boundary_of(const GivenTets& given, std::vector<std::string>& warnings) {
  constexpr size_t kFaces[4][3] = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}};
  std::vector<Face> faces;
  faces.reserve(4 * given.tets.size());
  for (uint32_t t = 0; t < given.tets.size(); ++t)
    for (const auto& face : kFaces) {
      const Tet& tet = given.tets[t];
      Face made{{}, {tet[face[0]], tet[face[1]], tet[face[2]]}, t};
      made.sorted = made.corners;
      std::sort(made.sorted.begin(), made.sorted.end());
      faces.push_back(made);
    }
  std::sort(faces.begin(), faces.end(), [](const Face& a, const Face& b) { return a.sorted != b.sorted ? a.sorted < b.sorted : a.tet < b.tet; });
  size_t kept = 0, crowded = 0;
  for (size_t begin = 0, end; begin < faces.size(); begin = end) {
    for (end = begin + 1; end < faces.size() && faces[end].sorted == faces[begin].sorted; ++end) {
    }
    crowded += end - begin > 2;
    if (end - begin == 1) faces[kept++] = faces[begin];
  }
  faces.resize(kept);
  if (crowded > 0) warnings.push_back(counted(crowded, "face has", "faces have") + " more than two tets: some lie over each other");
  return faces;
}

// Which tet holds a point, by a grid of boxes that each list the tets whose own boxes meet them.
class TetSearch {
 public:
  explicit TetSearch(const GivenTets& given) : given_(given) {
    lower_ = upper_ = given.points[0];
    for (const Vec3d& p : given.points)
      for (int k = 0; k < 3; ++k) lower_[k] = std::min(lower_[k], p[k]), upper_[k] = std::max(upper_[k], p[k]);
    double sum = 0;
    for (const Tet& tet : given.tets) sum += longest_edge(given.points, tet);
    edge_ = sum / static_cast<double>(given.tets.size());
    const Vec3d size = upper_ - lower_;
    while ((size.x / edge_ + 1) * (size.y / edge_ + 1) * (size.z / edge_ + 1) > kBoxes) edge_ *= 1.5;
    for (int k = 0; k < 3; ++k) sides_[static_cast<size_t>(k)] = static_cast<uint32_t>(size[k] / edge_) + 1;
    offsets_.assign(size_t{sides_[0]} * sides_[1] * sides_[2] + 1, 0);
    each_box([&](size_t box, uint32_t) { ++offsets_[box + 1]; });
    std::partial_sum(offsets_.begin(), offsets_.end(), offsets_.begin());
    tets_.resize(offsets_.back());
    std::vector<uint32_t> next(offsets_.begin(), offsets_.end() - 1);
    each_box([&](size_t box, uint32_t tet) { tets_[next[box]++] = tet; });
  }

  // The tet that p is deepest in, or least outside of among those near; false when no box near p has any.
  bool find(const Vec3d& p, uint32_t& tet, std::array<double, 4>& weights) const {
    double best = -INFINITY;
    std::array<uint32_t, 3> at;
    for (size_t k = 0; k < 3; ++k) {
      const int axis = static_cast<int>(k);
      if (p[axis] < lower_[axis] - edge_ || p[axis] > upper_[axis] + edge_) return false;
      at[k] = box_of(p[axis], axis);
    }
    const size_t box = index(at[0], at[1], at[2]);
    for (uint32_t i = offsets_[box]; i < offsets_[box + 1] && best < -1e-12; ++i) {
      const auto w = weights_in(tets_[i], p);
      const double least = *std::min_element(w.begin(), w.end());
      if (least > best) best = least, tet = tets_[i], weights = w;
    }
    return best >= -1e-9;
  }
  std::array<double, 4> weights_in(uint32_t t, const Vec3d& p) const {
    const Tet& tet = given_.tets[t];
    return barycentric_coordinates(p, given_.points[tet[0]], given_.points[tet[1]], given_.points[tet[2]], given_.points[tet[3]]);
  }

 private:
  uint32_t box_of(double x, int axis) const {
    return static_cast<uint32_t>(std::clamp((x - lower_[axis]) / edge_, 0.0, sides_[static_cast<size_t>(axis)] - 1.0));
  }
  size_t index(uint32_t x, uint32_t y, uint32_t z) const { return (size_t{x} * sides_[1] + y) * sides_[2] + z; }
  template <class F>
  void each_box(F&& f) const {
    for (uint32_t t = 0; t < given_.tets.size(); ++t) {
      std::array<uint32_t, 3> low{~0u, ~0u, ~0u}, high{0, 0, 0};
      for (const uint32_t v : given_.tets[t])
        for (size_t k = 0; k < 3; ++k) {
          const uint32_t box = box_of(given_.points[v][static_cast<int>(k)], static_cast<int>(k));
          low[k] = std::min(low[k], box), high[k] = std::max(high[k], box);
        }
      for (uint32_t x = low[0]; x <= high[0]; ++x)
        for (uint32_t y = low[1]; y <= high[1]; ++y)
          for (uint32_t z = low[2]; z <= high[2]; ++z) f(index(x, y, z), t);
    }
  }

  const GivenTets& given_;
  Vec3d lower_, upper_;
  double edge_;  // of a box
  std::array<uint32_t, 3> sides_;
  std::vector<uint32_t> offsets_, tets_;
};

struct Tie {
  uint32_t tet = 0;
  std::array<double, 4> weights{1, 0, 0, 0};
  double outside = 0;
};

std::vector<Tie> tie_vertices(const Surface& surface, const GivenTets& given, const std::vector<Face>& boundary, Executor& executor) {
  const auto points = surface.points.host();
  const TetSearch search(given);
  std::vector<uint32_t> triangles;
  for (const Face& face : boundary) triangles.insert(triangles.end(), face.corners.begin(), face.corners.end());
  const MeshDistance skin(std::span<const Vec3d>(given.points), triangles, &executor);
  const Vec3d centre = 0.5 * (to_double(surface.lower) + to_double(surface.upper));
  std::vector<Tie> ties(points.size());
  executor.parallel_ranges(points.size(), kPiece, [&](size_t begin, size_t end) {
    for (size_t v = begin; v < end; ++v) {
      Tie& tie = ties[v];
      Vec3d p = to_double(points[v]);
      if (!std::isfinite(p.x + p.y + p.z)) p = centre;
      if (search.find(p, tie.tet, tie.weights)) continue;
      const SignedDistance nearest = skin.signed_distance(p);
      tie.tet = boundary[nearest.triangle].tet;
      tie.outside = std::abs(nearest.distance);
      tie.weights = search.weights_in(tie.tet, nearest.point);
      for (double& w : tie.weights) w = std::max(w, 0.0);
    }
  });
  return ties;
}

void judge_ties(const Surface& surface, const std::vector<Tie>& ties, const std::vector<uint8_t>& used, double tolerance, BoundTets& bound,
                std::vector<std::string>& warnings) {
  size_t beyond = 0, first = 0;
  const double diagonal = surface.diagonal();
  for (size_t v = 0; v < ties.size(); ++v) {
    if (used[v] == 0 || ties[v].outside <= kOutside * diagonal) continue;
    ++bound.outside;
    bound.furthest = std::max(bound.furthest, ties[v].outside);
    if (ties[v].outside > tolerance && beyond++ == 0) first = v;
  }
  if (bound.outside == 0) return;
  char far[64];
  std::snprintf(far, sizeof far, "%.3g %% of its diagonal", 100 * bound.furthest / diagonal);
  if (beyond > 0)
    throw Error(ErrorCode::kInput,
                counted(beyond, "vertex", "vertices") + " of the surface, the first of them " + std::to_string(first) +
                    ", lie outside the tet mesh, up to " + far,
                "the tet mesh must hold the whole surface: make it larger, see that both are in the same units and place, or raise tolerance");
  warnings.push_back(counted(bound.outside, "vertex", "vertices") + " of the surface outside the tet mesh, by up to " + far +
                     ": bound to the nearest tet");
}

// Along the Morton curve, in tet space: edges of mean length 1, about M's centre.
TetMesh in_tet_space(GivenTets& given, const Surface& surface, Executor& executor) {
  double sum = 0;
  for (const Tet& tet : given.tets)
    for (size_t i = 0; i < 4; ++i)
      for (size_t j = 0; j < i; ++j) sum += length(given.points[tet[i]] - given.points[tet[j]]);
  Similarity to_local;
  to_local.scale = sum / (6 * static_cast<double>(given.tets.size()));
  to_local.translation = 0.5 * (to_double(surface.lower) + to_double(surface.upper));
  Vec3d lower = given.points[0], upper = lower;
  for (const Vec3d& p : given.points)
    for (int k = 0; k < 3; ++k) lower[k] = std::min(lower[k], p[k]), upper[k] = std::max(upper[k], p[k]);
  const double widest = std::max({upper.x - lower.x, upper.y - lower.y, upper.z - lower.z});
  std::vector<std::array<int32_t, 3>> places(given.points.size());
  for (size_t v = 0; v < places.size(); ++v)
    for (size_t k = 0; k < 3; ++k) {
      const int axis = static_cast<int>(k);
      places[v][k] = static_cast<int32_t>((given.points[v][axis] - lower[axis]) / widest * (kPlaces - 1));
    }
  const std::vector<uint32_t> vertex_at = vertex_order(places, given.tets);
  std::vector<uint32_t> number(vertex_at.size());
  std::vector<Vec3d> sorted(vertex_at.size()), positions(vertex_at.size());
  for (uint32_t i = 0; i < vertex_at.size(); ++i) {
    number[vertex_at[i]] = i;
    sorted[i] = given.points[vertex_at[i]];
    positions[i] = to_double(to_float((1 / to_local.scale) * (sorted[i] - to_local.translation)));
  }
  given.points = std::move(sorted);
  std::vector<float> volumes;
  for (Tet& tet : given.tets) {
    for (uint32_t& v : tet) v = number[v];
    volumes.push_back(static_cast<float>(six_volumes(positions, tet) / 6));
    if (!(volumes.back() > 0))
      throw Error(ErrorCode::kInput, "the tet mesh has tets too thin for single precision", "make it again with rounder tets");
  }
  TetMesh mesh = make_tet_mesh(positions, given.tets, volumes, executor);
  mesh.to_local = to_local;
  return mesh;
}

std::vector<uint8_t> used_vertices(const Surface& surface) {
  std::vector<uint8_t> used(surface.vertices(), 0);
  if (surface.topology)
    for (const uint32_t v : surface.topology->face_vertices)
      if (v < used.size()) used[v] = 1;
  return used;
}

}  // namespace

BoundTets bind_tets(const Surface& surface, GivenTets given, double tolerance, Executor& executor, std::vector<std::string>& warnings) {
  const std::vector<uint8_t> used = used_vertices(surface);
  if (std::find(used.begin(), used.end(), 1) == used.end()) throw Error(ErrorCode::kInput, "the surface has no faces");
  check_indices(given);
  turn_and_drop_tets(given, warnings);
  drop_unused_vertices(given, warnings);
  say_pieces(given, warnings);
  BoundTets bound;
  BuiltTets& build = bound.build;
  build.tets = in_tet_space(given, surface, executor);
  const std::vector<Tie> ties = tie_vertices(surface, given, boundary_of(given, warnings), executor);
  judge_ties(surface, ties, used, tolerance, bound, warnings);
  LatticeRows rows;
  rows.offsets.push_back(0);
  for (const Tie& tie : ties) {
    append_row(given.tets[tie.tet], tie.weights, rows.indices, rows.weights);
    rows.offsets.push_back(static_cast<uint32_t>(rows.indices.size()));
  }
  fill_lattice_tables(rows, used, static_cast<uint32_t>(given.points.size()), build.lattice, executor);
  build.lattice.rest = surface;
  build.lattice.tet_rest = build.tets.rest;
  build.lattice.to_local = build.tets.to_local;
  for (const Tet& tet : given.tets) build.tet_volume += six_volumes(given.points, tet) / 6;
  return bound;
}

}  // namespace knead
