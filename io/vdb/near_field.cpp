#include "io/vdb/near_field.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "graph/opaque_value.h"
#include "io/vdb/vdb.h"
#include "kernels/surface/edges.h"
#include "kernels/surface/exact_distance.h"
#include "kernels/surface/searchable_mesh.h"
#include "kernels/surface/shell_distance.h"

namespace knead {
namespace {

// Of M's edge. In a body of 2,562 vertices, a ball of half the body's radius, and one of twice, with voxels of 0.35 edges dents it otherwise than one with voxels
// of 0.1 by 1.2e-4 and 7e-5 of the diagonal at most, with 0.7 by 3.7e-4 and 1.2e-4, with 1.0 by 7.5e-4 and 2.2e-4. It falls as the collider grows; one whose own
// voxels are as large as an edge is more than three times as large as the body.
constexpr double kCoarsest = 1.0, kVoxel = 0.7, kFinest = 0.35;
// Edges are taken for no longer and no shorter than these parts of the diagonal: H is not finer than that at its usual depth.
constexpr double kLongestEdge = 1.0 / 32, kShortestEdge = 1.0 / 128;
constexpr double kBulge = 0.25;       // of the diagonal: flesh may go so far from its box, and
constexpr double kMostDepth = 1;      // so many diagonals farther where it is in so deep
constexpr double kLeastBand = 4;      // voxels, as mesh_to_sdf has it
constexpr double kUnusedBand = 2;     // voxels of the band that are not known well (build_sdf)
constexpr double kInterpolated = 2;   // voxels around the known box that its last samples look at
constexpr double kMostVoxels = 1024;  // along a side of the known box
// A collider is thin where a point this far below its surface, in voxels, is not at least so far inside. Then voxels are halved so many times at most.
constexpr double kBelow = 0.75, kLeastBelow = 0.3;
constexpr int kFiner = 3;
constexpr double kDeepIn = 0.9;      // of the ball's radius: what a body is pressed into may reach so far into it
constexpr double kLeastShell = 2.5;  // voxels: a shell in the flesh is taken for no thinner

struct FieldNear {
  static constexpr const char* kOpaqueName = "FieldNear";
  Sdf sdf;
  void each_buffer(auto&& f) { f(sdf.grid); }
};

struct Box {
  Vec3d lower, upper;
  bool holds(const Box& other) const {
    for (int k = 0; k < 3; ++k)
      if (other.lower[k] < lower[k] || other.upper[k] > upper[k]) return false;
    return true;
  }
  bool clear_of(const Box& other) const {
    for (int k = 0; k < 3; ++k)
      if (other.lower[k] > upper[k] || other.upper[k] < lower[k]) return true;
    return false;
  }
  Box grown(double by) const { return {lower - Vec3d{by, by, by}, upper + Vec3d{by, by, by}}; }
};

double to_collider_units(const Similarity& collider, const NearBody& body) {
  return body.placement.scale / collider.scale;
}

// Where M may be, with `by` around it, in the collider's local space.
Box region_of(const Similarity& collider, const NearBody& body, double by) {
  const Similarity to_collider = collider.inverse() * body.placement;
  const Box here = Box{body.lower, body.upper}.grown(by);
  Box box{{1e300, 1e300, 1e300}, {-1e300, -1e300, -1e300}};
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3d p = to_collider.apply(
        {corner & 1 ? here.upper.x : here.lower.x, corner & 2 ? here.upper.y : here.lower.y, corner & 4 ? here.upper.z : here.lower.z});
    for (int k = 0; k < 3; ++k) box.lower[k] = std::min(box.lower[k], p[k]), box.upper[k] = std::max(box.upper[k], p[k]);
  }
  return box;
}

Box surface_box(const Sdf& collider) {
  return {to_double(collider.lower), to_double(collider.upper)};
}

// A grid of points all over M's box, in the collider's local space.
std::vector<Vec3d> lattice(const Similarity& collider, const NearBody& body) {
  const Similarity to_collider = collider.inverse() * body.placement;
  const Vec3d half = (body.upper - body.lower) * 0.5, middle = body.lower + half;
  std::vector<Vec3d> points;
  for (int i = -1; i <= 1; ++i)
    for (int j = -1; j <= 1; ++j)
      for (int k = -1; k <= 1; ++k) points.push_back(to_collider.apply(middle + Vec3d{i * half.x, j * half.y, k * half.z}));
  return points;
}

// What is nearest to the body is thinner than voxels of this size can hold: a little way below the surface it is not inside.
bool is_thin(const ExactDistance& distance, const std::vector<Vec3d>& points, const Box& region, double voxel) {
  for (const Vec3d& p : points) {
    const SignedDistance nearest = distance.signed_distance(p);
    if (!nearest.found() || Box{nearest.point, nearest.point}.clear_of(region)) continue;
    const Vec3d below = nearest.point - (kBelow * voxel) * nearest.normal;
    if (distance.signed_distance(below).distance > -kLeastBelow * voxel) return true;
  }
  return false;
}

Vec3d middle_of(const Similarity& collider, const NearBody& body) {
  return (collider.inverse() * body.placement).apply((body.lower + body.upper) * 0.5);
}

// Any of the points, which are in the collider's local space, is deep in the ball that M's box is around.
bool any_within(const std::vector<Vec3d>& points, const Similarity& collider, const NearBody& body) {
  const Similarity to_body = body.placement.inverse() * collider;
  const Vec3d half = (body.upper - body.lower) * 0.5, middle = body.lower + half;
  return std::any_of(points.begin(), points.end(), [&](const Vec3d& at) {
    const Vec3d p = to_body.apply(at) - middle;
    double sum = 0;
    for (int k = 0; k < 3; ++k) sum += half[k] > 0 ? p[k] * p[k] / (half[k] * half[k]) : 0;
    return sum < kDeepIn * kDeepIn;
  });
}

// The triangles of a collider as they face a place.
class Facing {
 public:
  Facing(const Surface& mesh, const Vec3d& eye) : points_(mesh.points.host()), triangles_(mesh.topology->triangles), eye_(eye) {}

  bool faces(uint32_t t) const {
    if (3 * size_t{t} + 2 >= triangles_.size()) return true;  // a cone without area over a seam
    const Vec3d a = corner(t, 0);
    return dot(cross(corner(t, 1) - a, corner(t, 2) - a), eye_ - a) > 0;
  }

  // Ends and middles of the edges between a triangle that faces the eye and one that does not.
  std::vector<Vec3d> outline() const {
    std::vector<Vec3d> found;
    EdgeUses(points_.size(), triangles_).each_edge([&](uint32_t low, std::span<const EdgeUse> uses) {
      bool any = false, all = true;
      for (const EdgeUse& use : uses) any = any || faces(use.triangle()), all = all && faces(use.triangle());
      const Vec3d a = to_double(points_[low]), b = to_double(points_[uses[0].high]);
      if (any && !all) found.insert(found.end(), {a, b, (a + b) * 0.5});
    });
    return found;
  }

 private:
  Vec3d corner(uint32_t t, size_t k) const { return to_double(points_[triangles_[3 * size_t{t} + k]]); }
  std::span<const Vec3f> points_;
  std::span<const uint32_t> triangles_;
  Vec3d eye_;
};

void add(Hasher& key, const Similarity& place) {
  key.add(place.scale).add(place.translation.x).add(place.translation.y).add(place.translation.z);
  for (const double r : place.rotation) key.add(r);
}

// What the field near the body is sampled from, about a place of its own.
std::function<double(const Vec3d&, uint32_t&)> sampled(const Sdf& collider, const NearBody& body, const NearRegion& region, const Vec3d& centre) {
  const ExactDistance& distance = *collider.distance;
  const ShellDistance* shell = distance.shell();
  const Vec3d eye = middle_of(collider.placement, body);
  if (const int side = shell && region.is_plate ? shell->side_of(eye) : 0; side != 0)
    return [shell, side, centre](const Vec3d& p, uint32_t& hint) { return shell->from_side(p + centre, side, hint); };
  const double thicker = shell ? 0.5 * std::max(0.0, kLeastShell * region.voxel_size - shell->thickness()) : 0;
  if (shell || !region.is_plate)
    return
        [&distance, thicker, centre](const Vec3d& p, uint32_t& hint) { return distance.signed_distance_near(p + centre, hint).distance - thicker; };
  return [&distance, facing = Facing(*collider.mesh, eye), centre](const Vec3d& p, uint32_t& hint) {
    const SignedDistance nearest = distance.signed_distance_near(p + centre, hint);
    return facing.faces(nearest.triangle) ? nearest.distance : -std::abs(nearest.distance);
  };
}

}  // namespace

NearBody near_body(const Surface& body, double reach) {
  NearBody made{body.placement, to_double(body.lower), to_double(body.upper), 0, reach};
  const double diagonal = made.diagonal();
  // A triangulated box or ball has about this.
  const double edge = 1.1 * diagonal / std::sqrt(std::max(1.0, static_cast<double>(body.vertices())));
  made.edge = std::clamp(edge, kShortestEdge * diagonal, kLongestEdge * diagonal);
  return made;
}

bool knows(const Sdf& field, const NearBody& body) {
  if (!(body.diagonal() > 0)) return true;  // a body without a size has no voxels of its own
  const Box box = region_of(field.placement, body, kBulge * body.diagonal() + body.reach);
  if (surface_box(field).clear_of(box)) return true;
  if (field.distance && field.distance->shell()) return false;  // from which side it is met only the body tells
  const bool fine = field.voxel_size <= kCoarsest * body.edge * to_collider_units(field.placement, body);
  return fine && Box{to_double(field.known_lower), to_double(field.known_upper)}.holds(box);
}

NearRegion region_near(const Similarity& placement, const ExactDistance& distance, const Surface* mesh, const NearBody& body) {
  const double scale = to_collider_units(placement, body);
  const std::vector<Vec3d> points = lattice(placement, body);
  double deepest = 0;
  for (const Vec3d& p : points) deepest = std::max(deepest, -distance.signed_distance(p).distance / scale);
  const Box region = region_of(placement, body, kBulge * body.diagonal() + body.reach + std::min(deepest, kMostDepth * body.diagonal()));
  const Vec3d size = region.upper - region.lower;
  const double least = std::max({size.x, size.y, size.z}) / kMostVoxels;
  NearRegion near{region.lower, region.upper, std::max(kVoxel * body.edge * scale, least), kFinest * body.edge * scale};
  if (distance.shell()) {
    const auto rim = distance.shell()->rim();
    near.is_plate = !rim.empty() && !any_within({rim.begin(), rim.end()}, placement, body);
    return near;
  }
  const auto thin = [&] { return mesh && is_thin(distance, points, region, near.voxel_size); };
  if (!thin()) return near;
  const Vec3d eye = middle_of(placement, body);
  near.is_plate = distance.signed_distance(eye).distance > 0 && !any_within(Facing(*mesh, eye).outline(), placement, body);
  for (int finer = 0; !near.is_plate && finer < kFiner && near.voxel_size > 2 * least && (finer == 0 || thin()); ++finer) near.voxel_size *= 0.5;
  return near;
}

Sdf field_near(Executor& executor, const Sdf& collider, const NearBody& body) {
  const ExactDistance& distance = *collider.distance;
  const NearRegion region = region_near(collider.placement, distance, collider.mesh.get(), body);
  const Vec3d centre = (region.lower + region.upper) * 0.5;
  SdfPlan plan;
  plan.voxel_size = region.voxel_size;
  plan.band = std::max(kLeastBand, body.reach * to_collider_units(collider.placement, body) / plan.voxel_size + 2 * kUnusedBand);
  plan.lower = to_double(collider.lower) - centre;
  plan.upper = to_double(collider.upper) - centre;
  plan.world_scale = collider.placement.scale;
  const Box built = Box{region.lower - centre, region.upper - centre}.grown(kInterpolated * plan.voxel_size);
  plan.only = {built.lower, built.upper};
  Sdf near = build_sdf(executor, plan, sampled(collider, body, region, centre));
  near.known_lower = to_float(region.lower - centre);
  near.known_upper = to_float(region.upper - centre);
  near.inside_depth = std::max(near.inside_depth, collider.inside_depth);
  near.placement = Similarity{};
  near.placement.translation = centre;
  return near;
}

NearFields::NearFields(Context& context, std::span<const Sdf* const> colliders, const NearBody& body, bool warn)
    : colliders_(colliders.begin(), colliders.end()), on_host_(colliders.size()) {
  made_.reserve(colliders.size());
  for (size_t k = 0; k < colliders.size(); ++k) {
    const Sdf& given = *colliders[k];
    if (knows(given, body)) continue;
    Sdf exact = given;
    exact.distance = searchable_mesh(context, given);
    if (exact.distance) {
      colliders_[k] = &made_.emplace_back(near(context, exact, body));
      on_host_[k] = kept_.back().as<FieldNear>().sdf;
      on_host_[k]->placement = made_.back().placement;
    } else if (warn) {
      context.warn(fmt::format(
          "collider {}: its voxels of {:.4g} are coarser than the edges of the body, about {:.4g}, and its mesh is not known; take a finer field",
          k + 1, given.voxel_size * given.placement.scale, body.edge * body.placement.scale));
    }
  }
}

// On the executor's device; the last one kept is its copy on the host.
Sdf NearFields::near(Context& context, const Sdf& collider, const NearBody& body) {
  Executor& executor = context.executor();
  const bool on_host = executor.device() == Device{};
  Hasher key;
  key.add("field near").add(collider.grid.id()).add(body.edge).add(body.reach);
  add(key, collider.placement.inverse() * body.placement);
  for (int axis = 0; axis < 3; ++axis) key.add(body.lower[axis]).add(body.upper[axis]);
  const Value here =
      context.once(key.key(), [&] { return Value::of(FieldNear{field_near(on_host ? executor : *make_cpu_executor(), collider, body)}); });
  Sdf field = here.as<FieldNear>().sdf;
  if (!on_host) {
    kept_.push_back(context.once(key.add("there").key(), [&] {
      FieldNear there{field};
      there.sdf.grid = Buffer<std::byte>(field.grid.size(), executor.memory());
      executor.copy(field.grid.host().data(), Device{}, there.sdf.grid.data_for_write(), executor.device(), field.grid.bytes());
      executor.synchronise();
      return Value::of(std::move(there));
    }));
    field = kept_.back().as<FieldNear>().sdf;
  }
  kept_.push_back(here);
  field.placement = collider.placement * field.placement;
  return field;
}

std::vector<Sdf> NearFields::copies() const {
  std::vector<Sdf> copies;
  for (const Sdf* collider : colliders_) copies.push_back(*collider);
  return copies;
}

}  // namespace knead
