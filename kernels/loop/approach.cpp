#include "kernels/loop/approach.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "kernels/loop/collide_launch.h"
#include "kernels/parallel.h"
#include "kernels/surface/disjoint_sets.h"
#include "kernels/surface/mesh_distance.h"

namespace knead {
namespace {

constexpr double kLeastCap = 0.25;       // vector area of a patch over its area: a tube has less
constexpr double kMostlyThrough = 0.75;  // part of a patch, as seen along D, that must come out
constexpr float kWrongWay = -0.3f;       // cosine with D below which the nearest way out is the wrong one
constexpr double kFarthest =
    1.5;                        // mean way out over the root of the patch's area as seen along D: a longer one follows the collider through the body
constexpr double kAside = 2.1;  // way in over the nearest way out: a longer one leads past the collider's side, as that of a pin does
constexpr double kDeep = 0.5;   // of the collider's half thickness: what is less deep is a plain press
constexpr double kOff = 1e-3;   // of the diagonal: rays start this far inside

// Joins the ends of every triangle edge whose ends both are in.
template <class In>
DisjointSets joined(std::span<const uint32_t> triangles, size_t vertices, const In& in) {
  DisjointSets sets(vertices);
  for (size_t c = 0; c < triangles.size(); ++c) {
    const uint32_t a = triangles[c], b = triangles[c % 3 == 2 ? c - 2 : c + 1];
    if (in(a) && in(b)) sets.join(a, b);
  }
  return sets;
}

// One collider against M at rest.
class Patch {
 public:
  Patch(Executor& executor, const CollideInput& input, std::span<const uint32_t> triangles)
      : executor_(executor), push_(make_push(executor, input, many_)), points_(input.points), triangles_(triangles), inside_(points_.size()) {
    hit_ = reduce_sum(executor, points_.size(), "approach_inside", [&](uint32_t i) -> size_t {
      uint32_t nearest = 0;
      inside_[i] = push_.distance(points_[i], nearest) < 0;
      return inside_[i];
    });
    half_thickness_ = static_cast<double>(input.colliders[0]->inside_depth * push_.collider(0).view.scale);
  }
  bool hit() const { return hit_ > 0; }

  WayIn way_in(FunctionRef<const MeshDistance&()> rest_mesh) {
    WayIn way;
    find_islands();
    find_normals();
    way.undecided = islands_ > 0 || hit_ == points_.size();
    if (!find_direction()) return way;
    if (islands_ > 0) {
      drop_free_islands(rest_mesh());
      if (!find_direction()) return way;
    }
    way.undecided = islands_ > 0 || leads_astray();
    if (!way.undecided && !is_deep()) return way;
    way.direction = inwards_;
    way.length = longest_way(rest_mesh());
    if (!way.undecided && way.length <= kAside * deepest_) way.length = 0;
    way.undecided = way.undecided && way.length == 0;
    return way;
  }

 private:
  // Whether the nearest way out may lead aside rather than back.
  bool is_deep() {
    deepest_ = reduce_max(executor_, points_.size(), "approach_deepest", [&](uint32_t i) -> double {
      uint32_t nearest = 0;
      return inside_[i] ? -static_cast<double>(push_.distance(points_[i], nearest)) : 0.0;
    });
    return deepest_ > kDeep * half_thickness_;
  }

  bool in_patch(uint32_t v) const { return inside_[v] || island_[v]; }

  void find_islands() {
    const size_t n = points_.size();
    DisjointSets whole = joined(triangles_, n, [](uint32_t) { return true; });
    DisjointSets cut = joined(triangles_, n, [&](uint32_t v) { return !inside_[v]; });
    std::vector<uint32_t> size(n, 0), largest(n, 0);  // of the piece of a root; of the largest piece of a shell
    for (uint32_t v = 0; v < n; ++v)
      if (!inside_[v]) ++size[cut.find(v)];
    for (uint32_t v = 0; v < n; ++v) largest[whole.find(v)] = std::max(largest[whole.find(v)], size[v]);
    island_.resize(n);
    piece_.resize(n);
    for (uint32_t v = 0; v < n; ++v) {
      piece_[v] = cut.find(v);
      island_[v] = !inside_[v] && size[piece_[v]] < largest[whole.find(v)];
      islands_ += island_[v];
    }
  }

  // Thirds of the triangles' vector areas, turned outwards if M encloses a negative volume.
  void find_normals() {
    normals_.assign(points_.size(), Vec3d{0, 0, 0});
    areas_.assign(points_.size(), 0.0);
    double volume = 0;
    const Vec3d origin = to_double(points_[triangles_[0]]);
    for (size_t t = 0; t + 2 < triangles_.size(); t += 3) {
      const Vec3d a = to_double(points_[triangles_[t]]) - origin, b = to_double(points_[triangles_[t + 1]]) - origin,
                  c = to_double(points_[triangles_[t + 2]]) - origin;
      const Vec3d third = (1.0 / 6) * cross(b - a, c - a);
      if (!std::isfinite(dot(third, third))) continue;
      volume += dot(a, third);
      for (size_t k = 0; k < 3; ++k) {
        normals_[triangles_[t + k]] = normals_[triangles_[t + k]] + third;
        areas_[triangles_[t + k]] += length(third);
      }
    }
    if (volume < 0)
      for (Vec3d& normal : normals_) normal = -normal;
  }

  bool find_direction() {
    Vec3d sum{0, 0, 0};
    double area = 0;
    for (uint32_t v = 0; v < points_.size(); ++v) {
      if (!in_patch(v)) continue;
      sum = sum + normals_[v];
      area += areas_[v];
    }
    if (!(length(sum) > kLeastCap * area)) return false;
    inwards_ = (-1 / length(sum)) * sum;
    return true;
  }

  bool leads_astray() const {
    const Vec3f in = to_float(inwards_);
    return reduce_max(executor_, points_.size(), "approach_astray", [&](uint32_t v) -> int {
             return inside_[v] && dot(CollidePush::outwards(push_.collider(0).view, points_[v], true), in) < kWrongWay;
           }) > 0;
  }

  // How far y has to go along D to have left the collider that it is in, or the first time that it meets it, by steps of the distance. More than
  // `most_far` when it does not meet it or is not out by then.
  float way_through(const Vec3f& y, float most_far) const {
    constexpr int kSteps = 96;
    const Vec3f in = to_float(inwards_);
    uint32_t nearest = 0;
    bool inside = false;
    for (float way = 0; way <= most_far;) {
      const float phi = push_.distance(y + in * way, nearest);
      if (inside && phi >= 0) return way;
      inside = inside || phi < 0;
      way += std::max(std::abs(phi), most_far / kSteps);
    }
    return 2 * most_far + 1;
  }

  struct Ways {  // of the vertices that face D
    std::vector<uint32_t> vertices;
    std::vector<double> facing, way;  // area as seen along D; how far along D to be out of the collider, or -1 when that is not before the body ends
    double all = 0;                   // sum of facing
  };

  Ways find_ways(const MeshDistance& mesh) const {
    Ways ways;
    for (uint32_t v = 0; v < points_.size(); ++v) {
      const double area = in_patch(v) ? -dot(normals_[v], inwards_) : 0;
      if (!(area > 0)) continue;
      ways.vertices.push_back(v);
      ways.facing.push_back(area);
      ways.all += area;
    }
    ways.way.resize(ways.vertices.size());
    const double most = mesh.diagonal(), off = kOff * most;
    parallel_for(
        executor_, ways.way.size(), "approach_thickness",
        [&](uint32_t m) { ways.way[m] = std::min(off + mesh.first_hit(to_double(points_[ways.vertices[m]]) + off * inwards_, inwards_), most); }, 64);
    double thickness = 0;
    for (size_t m = 0; m < ways.way.size(); ++m) thickness += ways.facing[m] * ways.way[m] / ways.all;
    const float reach = static_cast<float>(thickness);
    parallel_for(
        executor_, ways.way.size(), "approach_ways",
        [&](uint32_t m) {
          const float way = way_through(points_[ways.vertices[m]], reach);
          ways.way[m] = way <= reach ? way : -1;
        },
        64);
    return ways;
  }

  // Islands that need not pass the collider, such as what stands in a ring's hole.
  void drop_free_islands(const MeshDistance& mesh) {
    const Ways ways = find_ways(mesh);
    std::vector<double> facing(points_.size(), 0.0), through(points_.size(), 0.0);  // by piece
    for (size_t m = 0; m < ways.way.size(); ++m) {
      facing[piece_[ways.vertices[m]]] += ways.facing[m];
      if (ways.way[m] >= 0) through[piece_[ways.vertices[m]]] += ways.facing[m];
    }
    for (uint32_t v = 0; v < points_.size(); ++v) {
      if (!island_[v] || through[piece_[v]] >= kMostlyThrough * facing[piece_[v]]) continue;
      island_[v] = 0;
      --islands_;
    }
  }

  double longest_way(const MeshDistance& mesh) const {
    const Ways ways = find_ways(mesh);
    double through = 0, sum = 0, longest = 0;
    for (size_t m = 0; m < ways.way.size(); ++m) {
      if (ways.way[m] < 0) continue;
      through += ways.facing[m];
      sum += ways.facing[m] * ways.way[m];
      longest = std::max(longest, ways.way[m]);
    }
    return through >= kMostlyThrough * ways.all && sum <= kFarthest * std::sqrt(ways.all) * through ? longest : 0;
  }

  Executor& executor_;
  ManyColliders many_;
  CollidePush push_;
  std::span<const Vec3f> points_;
  std::span<const uint32_t> triangles_;
  std::vector<uint8_t> inside_, island_;
  std::vector<uint32_t> piece_;  // of M without what is inside, by root
  size_t islands_ = 0;           // vertices
  std::vector<Vec3d> normals_;
  std::vector<double> areas_;
  Vec3d inwards_{0, 0, 0};
  size_t hit_ = 0;
  double half_thickness_ = 0, deepest_ = 0;  // of the collider; of a vertex in it; M's local units
};

}  // namespace

std::vector<WayIn> ways_in(Executor& executor, const CollideInput& input, std::span<const uint32_t> triangles,
                           FunctionRef<const MeshDistance&()> rest_mesh) {
  std::vector<WayIn> ways;
  for (const Sdf* const& collider : input.colliders) {
    ways.emplace_back();
    if (triangles.empty()) continue;
    CollideInput one = input;
    one.colliders = std::span(&collider, 1);
    Patch patch(executor, one, triangles);
    if (patch.hit()) ways.back() = patch.way_in(rest_mesh);
  }
  return ways;
}

std::vector<Vec3d> stand_back(Executor& executor, const CollideInput& input, std::span<const uint32_t> triangles,
                              FunctionRef<const MeshDistance&()> rest_mesh) {
  std::vector<Vec3d> shifts;
  bool any = false;
  for (const WayIn& way : ways_in(executor, input, triangles, rest_mesh)) {
    shifts.push_back(-way.length * way.direction);
    any = any || way.length > 0;
  }
  return any ? shifts : std::vector<Vec3d>();
}

}  // namespace knead
