#include <algorithm>
#include <cmath>

#include "graph/registry.h"
#include "io/vdb/vdb.h"
#include "kernels/port_types.h"
#include "kernels/shapes/primitives.h"
#include "kernels/surface/exact_distance.h"

namespace knead {

namespace {

const char* const kManual = R"(A half space as a collider: everything behind a plane, exact at any size. A floor, a wall, a press.

  floor:  {type: plane, point: [0, -0.8, 0]}
  result: {type: deform_equilibrium, surface: body, sdf: [floor, fist]}

The plane goes through `point`; the solid is on the side that `normal` points away from. With `follows`, both are in that surface's local space, so that a
`transform` moves the plane over the frames; only the surface's place counts, not its points.

Whatever presses a body builds the field where the body is. The field that this node gives is a cube of `size` about the point, for write_vdb; `surface` is a
square of that size, for pictures.)";

constexpr double kEndless = 1e12;  // sizes
constexpr int kVoxels = 32;        // along the cube; an interpolated plane is exact with any number

class Plane : public Node {
 public:
  OptionalIn<Surface> follows{this, "follows", {.unit = "world", .doc = "a surface that the plane moves with"}};
  Param<Triple> point{this, "point", {0, 0, 0}, {.unit = "world", .doc = "on the plane"}};
  Param<Triple> normal{this, "normal", {0, 1, 0}, {.doc = "out of the solid; of any length"}};
  Param<double> size{this, "size", 10, {.min = 0, .unit = "world", .doc = "of the part that files and pictures show"}};
  Out<Sdf> sdf{this, "sdf", {.unit = "world", .doc = "signed distance, negative behind the plane"}};
  Out<Surface> shown{this, "surface", {.unit = "world", .doc = "a square of the plane"}};

  void configure() override {
    const Vec3d n{normal()[0], normal()[1], normal()[2]};
    if (!(length(n) > 0)) throw Error(ErrorCode::kGraph, Where{{}, 0, 0, {}, "normal"}, "the normal has no length", "[0, 1, 0] faces upwards");
    if (!(size() > 0))
      throw Error(ErrorCode::kGraph, Where{{}, 0, 0, {}, "size"}, "the part to be shown has no size", "take one as large as the scene");
  }

  void evaluate(Context& context) const override {
    const double half = 0.5 * size();
    SdfPlan plan;
    plan.voxel_size = size() / kVoxels;
    plan.lower = {-kEndless * size(), -kEndless * size(), -kEndless * size()};
    plan.upper = {kEndless * size(), kEndless * size(), 0};
    plan.only = {Vec3d{-half, -half, -half}, Vec3d{half, half, half}};
    Sdf field = build_sdf(context.executor(), plan, [&](const Vec3d& p, uint32_t&) { return p.z; });
    field.known_lower = to_float((*plan.only)[0]);
    field.known_upper = to_float((*plan.only)[1]);
    field.distance = std::make_shared<HalfSpaceDistance>();
    const Surface* leader = context.get(follows);
    field.placement = leader ? leader->placement * place() : place();
    Surface square = make_triangle_surface({at(-half, -half), at(half, -half), at(half, half), at(-half, half)}, {0, 1, 2, 0, 2, 3});
    square.placement = field.placement;
    context.set(sdf, std::move(field));
    context.set(shown, std::move(square));
  }

 private:
  static Vec3f at(double x, double y) { return {static_cast<float>(x), static_cast<float>(y), 0}; }

  // Takes z to the normal, and the origin to the point.
  Similarity place() const {
    const Vec3d n{normal()[0], normal()[1], normal()[2]}, z = n * (1 / length(n));
    const Vec3d other = std::abs(z.x) < 0.6 ? Vec3d{1, 0, 0} : Vec3d{0, 1, 0}, across = cross(other, z);
    const Vec3d x = across * (1 / length(across)), y = cross(z, x);
    Similarity place;
    place.rotation = {x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z};
    place.translation = {point()[0], point()[1], point()[2]};
    return place;
  }
};

}  // namespace

KNEAD_REGISTER(plane, Plane, 1, kManual)

}  // namespace knead
