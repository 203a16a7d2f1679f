#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <span>
#include <vector>

#include "graph/registry.h"
#include "io/vdb/vdb.h"
#include "kernels/port_types.h"
#include "kernels/sdf_sample.h"
#include "kernels/shapes/primitives.h"
#include "kernels/surface/exact_distance.h"

namespace knead {

namespace {

const char* const kManual = R"(Several signed distance fields as one: the union of their solids, phi = min_k phi_k.

The result lives in the first field's space, with the finest voxel size among them and the narrowest outside band; it is sampled anew from the others'
trilinear interpolants, so it is as exact as they are. Where solids overlap, the minimum is the depth in the deeper one, which is less than the distance to
the union's own surface: pushes out of an overlap may take two steps. As long as the fields keep their places relative to each other the result is built once.

collide_sdf takes several fields without merging them, which is faster when they move apart; use this one to write a union to a file, or to keep the number
of colliders down. The meshes behind the fields, if all have one, are joined too, so that exact projection still works.)";

constexpr double kPlaceVoxels = 32;  // a cube of space in which the parts are listed

class UnionSdf : public Node {
 public:
  ManyIn<Sdf> sdf{this, "sdf", {.unit = "world", .doc = "fields to join"}};
  Param<int> memory_limit{this, "memory_limit", 2048, {.min = 1, .unit = "MiB", .doc = "what the result may take"}};
  Out<Sdf> united{this, "sdf", {.unit = "world", .doc = "the union"}};

  bool shares_parts() const override { return true; }

  void evaluate(Context& context) const override {
    const size_t count = context.count(sdf);
    if (count == 0)
      throw Error(ErrorCode::kInput, Where{{}, 0, 0, {}, "sdf"}, "there is nothing to join", "connect at least one signed distance field");
    const Sdf& first = context.get(sdf, 0);
    if (count == 1) return context.set(united, first);
    for (size_t k = 0; k < count; ++k)
      if (context.get(sdf, k).distance && !context.get(sdf, k).mesh)
        throw Error(ErrorCode::kInput, Where{{}, 0, 0, {}, "sdf"}, "a plane has no end, so a union with it has none",
                    "give the plane to the press as a collider of its own");
    std::vector<Part> parts;
    Hasher key;
    key.add("union_sdf").add(memory_limit());
    for (size_t k = 0; k < count; ++k) {
      parts.push_back(part(context.get(sdf, k), first));
      const Similarity& t = parts.back().from_first;
      key.add(parts.back().sdf->grid.id()).add(t.scale).add(t.translation.x).add(t.translation.y).add(t.translation.z);
      for (double r : t.rotation) key.add(r);
      if (parts.back().sdf->mesh) key.add(parts.back().sdf->mesh->points.id());
    }
    Sdf placed = context.once(key.key(), [&] { return Value::of(join(context, parts)); }).as<Sdf>();
    placed.placement = first.placement;
    context.set(united, std::move(placed));
  }

 private:
  struct Part {
    const Sdf* sdf;
    Similarity from_first;  // the first field's local space to this one's
    SdfView view;
    double background;         // the first field's local units
    std::array<Vec3d, 2> box;  // of the field, its band included, the first field's local space
    bool holds(const Vec3d& p) const {
      return p.x >= box[0].x && p.y >= box[0].y && p.z >= box[0].z && p.x <= box[1].x && p.y <= box[1].y && p.z <= box[1].z;
    }
  };

  static std::array<Vec3d, 2> box_of(const Similarity& place, const Vec3d& lower, const Vec3d& upper) {
    std::array<Vec3d, 2> box;
    for (int corner = 0; corner < 8; ++corner) {
      const Vec3d p = place.apply({corner & 1 ? lower.x : upper.x, corner & 2 ? lower.y : upper.y, corner & 4 ? lower.z : upper.z});
      if (corner == 0) box = {p, p};
      widen(box, {p, p});
    }
    return box;
  }
  static void widen(std::array<Vec3d, 2>& box, const std::array<Vec3d, 2>& by) {
    for (int k = 0; k < 3; ++k) box[0][k] = std::min(box[0][k], by[0][k]), box[1][k] = std::max(box[1][k], by[1][k]);
  }

  static Part part(const Sdf& sdf, const Sdf& first) {
    const auto* grid = reinterpret_cast<const nanovdb::NanoGrid<float>*>(sdf.grid.host().data());
    constexpr float kAll = 1e9f;
    Part part{&sdf, sdf.placement.inverse() * first.placement, {grid, {-kAll, -kAll, -kAll}, {kAll, kAll, kAll}}, 0, {}};
    if (&sdf == &first) part.from_first = Similarity{};
    part.background = grid->tree().background() / part.from_first.scale;
    const double around = grid->tree().background() + 2 * sdf.voxel_size;
    Vec3d lower = to_double(sdf.lower) - Vec3d{around, around, around}, upper = to_double(sdf.upper) + Vec3d{around, around, around};
    for (int k = 0; k < 3; ++k) lower[k] = std::max(lower[k], double{sdf.known_lower[k]}), upper[k] = std::min(upper[k], double{sdf.known_upper[k]});
    part.box = box_of(part.from_first.inverse(), lower, upper);
    return part;
  }

  // Space in cubes, and for each the parts whose boxes meet it.
  class Neighbourhoods {
   public:
    Neighbourhoods(const std::vector<Part>& parts, double side) : side_(side) {
      for (uint32_t k = 0; k < parts.size(); ++k) {
        const Place low = place_of(parts[k].box[0]), high = place_of(parts[k].box[1]);
        for (int x = low[0]; x <= high[0]; ++x)
          for (int y = low[1]; y <= high[1]; ++y)
            for (int z = low[2]; z <= high[2]; ++z) parts_[{x, y, z}].push_back(k);
      }
    }
    std::span<const uint32_t> at(const Vec3d& p) const {
      const auto found = parts_.find(place_of(p));
      return found == parts_.end() ? std::span<const uint32_t>() : found->second;
    }

   private:
    using Place = std::array<int, 3>;
    Place place_of(const Vec3d& p) const {
      return {static_cast<int>(std::floor(p.x / side_)), static_cast<int>(std::floor(p.y / side_)), static_cast<int>(std::floor(p.z / side_))};
    }
    double side_;
    std::map<Place, std::vector<uint32_t>> parts_;
  };

  Sdf join(Context& context, const std::vector<Part>& parts) const {
    SdfPlan plan;
    plan.voxel_size = std::numeric_limits<double>::infinity();
    plan.origin = to_double(parts[0].sdf->index_origin);
    plan.memory_limit = static_cast<uint64_t>(memory_limit()) << 20;
    plan.world_scale = parts[0].sdf->placement.scale;
    plan.true_distances = false;
    double background = std::numeric_limits<double>::infinity();
    bool meshes = true;
    std::array<Vec3d, 2> surface{to_double(parts[0].sdf->lower), to_double(parts[0].sdf->upper)};
    for (const Part& part : parts) {
      plan.voxel_size = std::min(plan.voxel_size, part.sdf->voxel_size / part.from_first.scale);
      background = std::min(background, part.background);
      meshes = meshes && part.sdf->mesh && !(part.sdf->distance && part.sdf->distance->shell());
      plan.boxes.push_back(part.box);
      widen(surface, box_of(part.from_first.inverse(), to_double(part.sdf->lower), to_double(part.sdf->upper)));
    }
    plan.lower = surface[0];
    plan.upper = surface[1];
    plan.band = background / plan.voxel_size;
    plan.check_cancelled = [&] { context.check_cancelled(); };
    const Neighbourhoods nearby(parts, kPlaceVoxels * plan.voxel_size);
    Sdf joined = build_sdf(context.executor(), plan, [&](const Vec3d& local, uint32_t&) {
      double least = background;
      for (const uint32_t k : nearby.at(local)) {
        const Part& part = parts[k];
        if (!part.holds(local)) continue;
        const Vec3d index = (part.from_first.apply(local) - to_double(part.sdf->index_origin)) * (1.0 / part.sdf->voxel_size);
        least = std::min(least, SdfSampler(part.view).value(to_float(index)) / part.from_first.scale);
      }
      return least;
    });
    if (meshes) joined.mesh = join_meshes(parts);
    return joined;
  }

  static std::shared_ptr<const Surface> join_meshes(const std::vector<Part>& parts) {
    std::vector<Vec3f> points;
    std::vector<uint32_t> triangles;
    for (const Part& part : parts) {
      const Similarity to_first = part.from_first.inverse();
      const uint32_t base = static_cast<uint32_t>(points.size());
      for (const Vec3f& p : part.sdf->mesh->points.host()) points.push_back(to_float(to_first.apply(to_double(p))));
      for (uint32_t v : part.sdf->mesh->topology->triangles) triangles.push_back(base + v);
    }
    return std::make_shared<Surface>(make_triangle_surface(std::move(points), std::move(triangles)));
  }
};

}  // namespace

KNEAD_REGISTER(union_sdf, UnionSdf, 1, kManual)

}  // namespace knead
