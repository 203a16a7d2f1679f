#include <fmt/format.h>

#include <algorithm>

#include "graph/opaque_value.h"
#include "graph/registry.h"
#include "io/vdb/near_field.h"
#include "io/vdb/vdb.h"
#include "kernels/port_types.h"
#include "kernels/shapes/primitives.h"
#include "kernels/surface/closed_mesh.h"
#include "kernels/surface/mesh_distance.h"
#include "kernels/surface/principal_frame.h"
#include "kernels/surface/shell_distance.h"

namespace knead {
namespace {

// What the frames share: the field along the collider's own axes, and what had to be said about it.
struct SolidField {
  static constexpr const char* kOpaqueName = "SolidField";
  Sdf sdf;  // its placement: to the collider's local space
  std::vector<std::string> warnings;
  Report report;
  void each_buffer(auto&& f) { f(sdf.grid); }
};

const char* const kManual = R"(A collider mesh as a signed distance field: negative inside, in world units, exact at the voxels.

The field knows its whole inside, as deep as a body can go in, and a band of `band` voxels outside; beyond that it is a positive constant. It is built once in
the collider's own space and moved with it, as long as the collider only turns, moves and scales; a mesh whose points change is built again for every frame.
Voxels stand along the collider's principal axes where these are clear, as build_tets' cells do, so that a collider turned in its file has the same field.

`voxel_size` is in world units. 0 takes the longest side over `resolution`. That can be too coarse for a small body against a large collider. So whatever presses a
body builds a finer field for itself where the two meet. With `near`, the body, this node does it: voxels as fine as the body's edges, and none where the two
cannot meet, which is much faster for a collider that deforms. Such a field is for this body only. Distances come from the triangles themselves (Embree), not from OpenVDB's mesh
converter: that one fills hollow shells, leaks into open ones and takes many times longer for deep interiors. Inside is where the winding number is above one
half. So an inner shell that faces the other way is a cavity, solids that overlap are one solid, and a mesh that faces inwards all over is turned round.

`solid` says what an open mesh is. A solid's openings are closed by a cone over their rim. A shell, such as a sheet for a floor or a bowl, bounds nothing: it holds
a body that is on one side of it from passing to the other, where most of the body is at rest being its side; a shell whose rim stands in the body, such as a blade,
has the body on both sides. `auto` takes a mesh for a shell whose openings are a fifth of its area or more, and one that encloses nothing. A shell is as thick as
`thickness`, half on each side; as thin as 0, but for a blade, which is as thick as the field can hold. Whatever was assumed is said in a warning.

A part thinner than about two voxels can be missed by the samples: a warning names the voxel size that would do. A field that would not fit in `memory_limit`
is an error with the estimate and a voxel size that fits, before memory is taken.)";

constexpr double kThinShare = 0.02;  // of the area: less than this is an edge or a tip
constexpr size_t kThicknessRays = 20000;
constexpr double kMostlyOpen = 0.2;      // of the area: a hemisphere's opening is half its area, that of a bust at the neck a thirtieth
constexpr double kWithoutVolume = 1e-9;  // of the area times the diagonal
constexpr double kLeastShellVoxels = 2;  // a shell's own field shows it no thinner

class MeshToSdf : public Node {
 public:
  In<Surface> mesh{this, "mesh", {.unit = "world", .doc = "the collider; open, inside-out and self-intersecting ones too"}};
  Param<double> voxel_size{this, "voxel_size", 0, {.min = 0, .unit = "world", .doc = "edge of a voxel; 0: the longest side over `resolution`"}};
  Param<int> resolution{this, "resolution", 96, {.min = 4, .max = 100000, .doc = "voxels along the longest side when voxel_size is 0"}};
  Param<double> band{this, "band", 4, {.min = 2, .max = 100, .unit = "voxels", .doc = "how far outside distances are known"}};
  Param<int> memory_limit{this, "memory_limit", 2048, {.min = 1, .unit = "MiB", .doc = "what the build may take"}};
  OptionalIn<Surface> near{
      this, "near", {.unit = "world", .doc = "the body that the field is for, at rest: fine where they can meet, nothing elsewhere"}};
  Param<std::string> solid{
      this, "solid", "auto", {.choices = {"auto", "solid", "shell"}, .doc = "what an open mesh is: closed by cones, or a shell that bounds nothing"}};
  Param<double> thickness{this, "thickness", 0, {.min = 0, .unit = "world", .doc = "of a shell"}};
  Out<Sdf> sdf{this, "sdf", {.unit = "world", .doc = "signed distance, negative inside, with the mesh for exact projection"}};
  Out<Report> report{this, "report", {.doc = "taken_as: solid or shell; thickness and voxel_size, world"}};

  bool shares_parts() const override { return true; }

  void evaluate(Context& context) const override {
    const Surface& surface = context.get(mesh);
    const double scale = surface.placement.scale;
    Hasher key;
    key.add("mesh_to_sdf").add(surface.points.id()).add(voxel_size() / scale).add(resolution()).add(band()).add(memory_limit());
    key.add(solid()).add(thickness() / scale);
    if (const Surface* body = context.get(near)) {
      const Similarity from = surface.placement.inverse() * body->placement;
      key.add(body->vertices()).add(from.scale).add(from.translation.x).add(from.translation.y).add(from.translation.z);
      for (const double r : from.rotation) key.add(r);
      for (int k = 0; k < 3; ++k) key.add(body->lower[k]).add(body->upper[k]);
    }
    if (surface.topology) key.bytes(surface.topology->triangles.data(), surface.topology->triangles.size() * sizeof(uint32_t));
    const Value shared = context.once(key.key(), [&] { return Value::of(build(context, surface)); });
    const SolidField& field = shared.as<SolidField>();
    for (const std::string& warning : field.warnings) context.warn(warning);
    Sdf placed = field.sdf;
    placed.placement = surface.placement * field.sdf.placement;
    context.set(sdf, std::move(placed));
    context.set(report, field.report);
  }

 private:
  SolidField build(Context& context, const Surface& surface) const {
    Executor& executor = context.executor();
    const double scale = surface.placement.scale;
    const std::span<const uint32_t> triangles =
        surface.topology ? std::span<const uint32_t>(surface.topology->triangles) : std::span<const uint32_t>();
    ClosedMesh closed = close_mesh(surface.points.host(), triangles);
    if (closed.triangles.empty())
      throw Error(ErrorCode::kInput, fmt::format("the collider has no triangle with an area ({} triangles given)", triangles.size() / 3),
                  "is this the right mesh?");
    const Similarity own_axes = turn_to_own_axes(closed);
    SolidField field;
    const bool is_shell = takes_for_shell(closed);
    const auto distance = is_shell ? shell_around(closed, executor, scale) : solid_within(closed, executor, field);
    context.check_cancelled();

    SdfPlan plan;
    plan.lower = closed.lower;
    plan.upper = closed.upper;
    plan.origin = (plan.lower + plan.upper) * 0.5;
    const Vec3d size = plan.upper - plan.lower;
    plan.voxel_size = voxel_size() > 0 ? voxel_size() / scale : std::max({size.x, size.y, size.z}) / resolution();
    plan.band = band();
    plan.memory_limit = static_cast<uint64_t>(memory_limit()) << 20;
    plan.world_scale = scale;
    plan.check_cancelled = [&] { context.check_cancelled(); };
    if (const Surface* body = context.get(near)) plan_near(plan, surface.placement * own_axes, *distance, *body);
    const ShellDistance* shell = distance->shell();
    const double thicker = shell ? 0.5 * std::max(0.0, kLeastShellVoxels * plan.voxel_size - shell->thickness()) : 0;
    field.sdf =
        build_sdf(executor, plan, [&](const Vec3d& local, uint32_t& hint) { return distance->signed_distance_near(local, hint).distance - thicker; });
    if (shell) {
      field.warnings.push_back(fmt::format(
          "collider: it is open as a sheet or a bowl is, {:.0f} % of its area, and was taken for a shell of thickness {:.4g}, which holds a "
          "body on the side that most of it is on; thickness gives it one, solid: solid closes it",
          100 * closed.openings_area / closed.own_area, shell->thickness() * scale));
    } else if (!plan.only) {
      warn_if_thin(static_cast<const MeshDistance&>(*distance), closed, plan, scale, field);
    }
    if (plan.only) {
      field.sdf.known_lower = to_float((*plan.only)[0]);
      field.sdf.known_upper = to_float((*plan.only)[1]);
    }
    field.report.set("taken_as", shell ? "shell" : "solid");
    if (shell) field.report.set("thickness", shell->thickness() * scale);
    field.report.set("voxel_size", plan.voxel_size * scale);
    field.sdf.placement = own_axes;
    if (shell) closed.triangles.resize(3 * closed.own_triangles);
    field.sdf.mesh = std::make_shared<Surface>(make_triangle_surface(std::move(closed.points), std::move(closed.triangles)));
    field.sdf.distance = distance;
    return field;
  }

  bool takes_for_shell(const ClosedMesh& mesh) const {
    if (solid() != "auto") return solid() == "shell";
    return mesh.openings_area > kMostlyOpen * mesh.own_area || std::abs(mesh.volume) < kWithoutVolume * mesh.area * length(mesh.upper - mesh.lower);
  }

  std::shared_ptr<const ExactDistance> shell_around(const ClosedMesh& mesh, Executor& executor, double scale) const {
    return std::make_shared<ShellDistance>(mesh.points, std::span(mesh.triangles).first(3 * mesh.own_triangles), thickness() / scale, &executor);
  }

  static std::shared_ptr<const ExactDistance> solid_within(const ClosedMesh& mesh, Executor& executor, SolidField& field) {
    const auto distance = std::make_shared<MeshDistance>(std::span<const Vec3f>(mesh.points), mesh.triangles, &executor);
    if (std::string assumed = mesh.assumptions(); !assumed.empty()) field.warnings.push_back("collider: " + assumed);
    if (distance->overlapping()) field.warnings.push_back("collider: parts of it lie inside others; the field is that of their union");
    return distance;
  }

  // Of a field for one body.
  void plan_near(SdfPlan& plan, const Similarity& placement, const ExactDistance& distance, const Surface& body) const {
    const NearRegion region = region_near(placement, distance, nullptr, near_body(body, 0));
    if (!(voxel_size() > 0)) plan.voxel_size = std::max(region.finest_voxel, std::min(plan.voxel_size, region.voxel_size));
    plan.only = {region.lower, region.upper};
    plan.origin = to_double(to_float((region.lower + region.upper) * 0.5));  // as the field holds it
  }

  // Returns the way back.
  static Similarity turn_to_own_axes(ClosedMesh& solid) {
    const auto rotation = principal_frame(solid.points, solid.triangles);
    Similarity back;
    if (!rotation) return back;
    back.rotation = *rotation;
    const Similarity turn = back.inverse();
    for (Vec3f& p : solid.points) p = to_float(turn.rotate(to_double(p)));
    solid.lower = solid.upper = to_double(solid.points[solid.triangles[0]]);
    for (const uint32_t v : solid.triangles)
      for (int k = 0; k < 3; ++k) {
        solid.lower[k] = std::min(solid.lower[k], double{solid.points[v][k]});
        solid.upper[k] = std::max(solid.upper[k], double{solid.points[v][k]});
      }
    return back;
  }

  // Measures the thickness under the triangles by rays, and compares it with what voxels can hold.
  static void warn_if_thin(const MeshDistance& distance, const ClosedMesh& solid, const SdfPlan& plan, double scale, SolidField& field) {
    std::vector<std::pair<double, double>> thickness;  // (length, area)
    double total = 0, thin = 0;
    const size_t count = solid.triangles.size() / 3, step = 1 + count / kThicknessRays;
    for (size_t t = 0; t < count; t += step) {
      const Vec3d a = to_double(solid.points[solid.triangles[3 * t]]), b = to_double(solid.points[solid.triangles[3 * t + 1]]),
                  c = to_double(solid.points[solid.triangles[3 * t + 2]]), along = cross(b - a, c - a);
      const double twice = length(along);
      if (!(twice > 0)) continue;
      const Vec3d inward = along * (-1 / twice), start = (a + b + c) * (1.0 / 3) + (1e-3 * std::sqrt(twice)) * inward;
      thickness.push_back({distance.first_hit(start, inward), twice});
      total += twice;
      if (thickness.back().first < 2 * plan.voxel_size) thin += twice;
    }
    if (field.sdf.inside_depth > 0 && thin < kThinShare * total) return;
    std::sort(thickness.begin(), thickness.end());
    double below = 0, would_do = 0;
    for (const auto& [length, area] : thickness) {
      below += area;
      would_do = length / 2;
      if (below >= kThinShare * total && would_do > 1e-6 * distance.diagonal()) break;
    }
    field.warnings.push_back(fmt::format(
        "collider: {:.0f} % of its surface is on parts thinner than two voxels of {:.4g}, which samples can miss; a voxel size of {:.3g} would do",
        100 * thin / total, plan.voxel_size * scale, would_do * scale));
  }
};

}  // namespace

KNEAD_REGISTER(mesh_to_sdf, MeshToSdf, 3, kManual)

}  // namespace knead
