#include "kernels/contact_sides.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "kernels/collide_launch.h"
#include "kernels/mesh_distance.h"
#include "kernels/parallel.h"

namespace knead {
namespace {

constexpr double kLeastCap = 0.25;     // vector area of a patch over its area: a tube has less
constexpr double kMostlyThrough = 0.75;  // part of a patch, as seen along D, that must come out
constexpr double kFarthest = 1.5;      // mean way out over the root of the patch's area as seen along D: a longer one follows the collider through the body
constexpr double kOff = 1e-3;          // of the diagonal: rays start this far inside

// Sets of vertices that triangles join.
class Pieces {
 public:
  explicit Pieces(size_t n) : above_(n) { std::iota(above_.begin(), above_.end(), 0u); }
  uint32_t find(uint32_t v) {
    while (above_[v] != v) v = above_[v] = above_[above_[v]];
    return v;
  }
  void join(uint32_t a, uint32_t b) {
    a = find(a), b = find(b);
    above_[std::max(a, b)] = std::min(a, b);
  }
  // Joins the ends of every triangle edge whose ends both are in.
  template <class In>
  void join_all(std::span<const uint32_t> triangles, const In& in) {
    for (size_t c = 0; c < triangles.size(); ++c) {
      const uint32_t a = triangles[c], b = triangles[c % 3 == 2 ? c - 2 : c + 1];
      if (in(a) && in(b)) join(a, b);
    }
  }

 private:
  std::vector<uint32_t> above_;
};

struct Patch {
  Vec3d vector_area{0, 0, 0}, inwards{0, 0, 0};
  double area = 0, facing = 0;
  double thickness = 0, through = 0, way = 0;  // sums over what faces D, by its area as seen along D

  bool pressed() const { return facing > 0 && through >= kMostlyThrough * facing && way <= kFarthest * std::sqrt(facing) * through; }
};

class Sides {
 public:
  Sides(Executor& executor, const CollideInput& input, std::span<const uint32_t> triangles)
      : executor_(executor), push_(make_push(executor, input)), points_(input.points), triangles_(triangles), inside_(points_.size()) {
    hit_ = reduce_sum(executor, points_.size(), "contact_inside", [&](uint32_t i) -> size_t {
      uint32_t nearest = 0;
      inside_[i] = push_.distance(points_[i], nearest) < 0;
      return inside_[i];
    });
  }
  bool hit() const { return hit_ > 0; }

  ContactSides decide(const MeshDistance& mesh) {
    const size_t n = points_.size();
    find_islands();
    find_patches();
    measure_areas();
    measure_ways(mesh);
    ContactSides sides{Buffer<Vec3f>(n), Buffer<uint8_t>(n)};
    Vec3f* ways = sides.ways.data_for_write();
    uint8_t* trapped = sides.trapped.data_for_write();
    bool any = false;
    for (uint32_t v = 0; v < n; ++v) {
      const Patch* patch = in_patch(v) ? &patches_[patch_of_[v]] : nullptr;
      const bool pressed = patch && patch->pressed();
      ways[v] = pressed ? to_float((patch->thickness / patch->facing) * patch->inwards) : Vec3f{0, 0, 0};
      trapped[v] = pressed && island_[v];
      any = any || pressed;
    }
    return any ? sides : ContactSides();
  }

 private:
  void find_islands() {
    const size_t n = points_.size();
    Pieces whole(n), cut(n);
    whole.join_all(triangles_, [](uint32_t) { return true; });
    cut.join_all(triangles_, [&](uint32_t v) { return !inside_[v]; });
    std::vector<uint32_t> size(n, 0), largest(n, 0);  // of the piece of a root; of the largest piece of a shell
    for (uint32_t v = 0; v < n; ++v)
      if (!inside_[v]) ++size[cut.find(v)];
    for (uint32_t v = 0; v < n; ++v) largest[whole.find(v)] = std::max(largest[whole.find(v)], size[v]);
    island_.resize(n);
    for (uint32_t v = 0; v < n; ++v) island_[v] = !inside_[v] && size[cut.find(v)] < largest[whole.find(v)];
  }

  bool in_patch(uint32_t v) const { return inside_[v] || island_[v]; }

  void find_patches() {
    Pieces pieces(points_.size());
    pieces.join_all(triangles_, [&](uint32_t v) { return in_patch(v); });
    patch_of_.resize(points_.size());
    for (uint32_t v = 0; v < points_.size(); ++v) patch_of_[v] = pieces.find(v);
    patches_.resize(points_.size());  // by root
  }

  // Vertex normals are thirds of the triangles' vector areas, turned outwards if M encloses a negative volume.
  void measure_areas() {
    normals_.assign(points_.size(), Vec3d{0, 0, 0});
    std::vector<double> areas(points_.size(), 0.0);
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
        areas[triangles_[t + k]] += length(third);
      }
    }
    for (uint32_t v = 0; v < points_.size(); ++v) {
      if (volume < 0) normals_[v] = -normals_[v];
      if (!in_patch(v)) continue;
      Patch& patch = patches_[patch_of_[v]];
      patch.vector_area = patch.vector_area + normals_[v];
      patch.area += areas[v];
    }
    for (Patch& patch : patches_) {
      const double size = length(patch.vector_area);
      if (size > kLeastCap * patch.area) patch.inwards = (-1 / size) * patch.vector_area;
    }
  }

  void measure_ways(const MeshDistance& mesh) {
    std::vector<uint32_t> members;
    for (uint32_t v = 0; v < points_.size(); ++v)
      if (in_patch(v) && -dot(normals_[v], patches_[patch_of_[v]].inwards) > 0) members.push_back(v);
    std::vector<float> found(members.size());
    const double most = mesh.diagonal(), off = kOff * most;
    parallel_for(executor_, members.size(), "contact_thickness", [&](uint32_t m) {
      const uint32_t v = members[m];
      const Vec3d in = patches_[patch_of_[v]].inwards;
      found[m] = static_cast<float>(std::min(off + mesh.first_hit(to_double(points_[v]) + off * in, in), most));
    }, 64);
    for (size_t m = 0; m < members.size(); ++m) {
      Patch& patch = patches_[patch_of_[members[m]]];
      const double facing = -dot(normals_[members[m]], patch.inwards);
      patch.facing += facing;
      patch.thickness += facing * found[m];
    }
    parallel_for(executor_, members.size(), "contact_through", [&](uint32_t m) {
      const uint32_t v = members[m];
      const Patch& patch = patches_[patch_of_[v]];
      const float reach = static_cast<float>(patch.thickness / patch.facing);
      const float way = push_.way_through(points_[v], to_float(patch.inwards), reach);
      found[m] = way <= reach ? way : -1.0f;
    }, 64);
    for (size_t m = 0; m < members.size(); ++m) {
      Patch& patch = patches_[patch_of_[members[m]]];
      if (found[m] < 0) continue;
      const double facing = -dot(normals_[members[m]], patch.inwards);
      patch.through += facing;
      patch.way += facing * found[m];
    }
  }

  Executor& executor_;
  CollidePush push_;
  std::span<const Vec3f> points_;
  std::span<const uint32_t> triangles_;
  std::vector<uint8_t> inside_, island_;
  std::vector<uint32_t> patch_of_;
  std::vector<Patch> patches_;
  std::vector<Vec3d> normals_;
  size_t hit_ = 0;
};

}  // namespace

ContactSides contact_sides(Executor& executor, const CollideInput& input, std::span<const uint32_t> triangles,
                           FunctionRef<const MeshDistance&()> rest_mesh) {
  if (triangles.empty() || input.colliders.empty()) return {};
  Sides sides(executor, input, triangles);
  if (!sides.hit()) return {};
  return sides.decide(rest_mesh());
}

}  // namespace knead
