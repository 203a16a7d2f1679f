#include "kernels/loop/approach.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "graph/registry.h"
#include "io/vdb/near_field.h"
#include "kernels/loop/collide.h"
#include "kernels/port_types.h"
#include "kernels/surface/searchable_mesh.h"

namespace knead {

namespace {

const char* const kManual = R"(The contact memory that a loop begins with: how colliders that stand deep in the body come in.

  way:   {type: approach, surface: body, sdf: solid}
  press: {type: iterate, state: {points: tets.points, surface: body, memory: way}, ...}

The nearest way out of a collider may be the wrong one: the tip of a nose past a thumb's middle would be drawn out at the thumb's far side, and flesh above a bar
that is pressed in deeper than it is thick would stay above it. So each collider is looked at against the surface at rest, for such vertices and for islands
that it cuts off from the rest of the surface. If nearly all of them can go into the body the same way, the collider begins outside and comes in that way, by
1/400 of the diagonal an iteration and in 64 at most. Where there is no such way, as for a ring around a finger, and with `way_in: false`, it begins in its
place, and the nearest way out is taken; so it is in a loop whose memory begins with `none`.

Colliders and margin must be those of the loop's collide_sdf.)";

class Approach : public Node {
 public:
  In<Surface> surface{this, "surface", {.unit = "world", .doc = "the soft surface at rest"}};
  ManyIn<Sdf> sdf{this, "sdf", {.unit = "world", .doc = "colliders, as the loop has them"}};
  Param<double> margin{this, "margin", 0, {.min = 0, .unit = "world", .doc = "distance to keep from the colliders"}};
  Param<bool> way_in{this, "way_in", true, {.doc = "colliders that are in too deep to tell the side come in from outside over the first iterations"}};
  Out<Contacts> memory{this, "memory", {.unit = "local", .shape = "vertices", .doc = "the state of collide_sdf to begin with"}};
  Out<Report> report{this, "report", {.doc = "way_in_steps: iterations until all colliders are in their places"}};

  void evaluate(Context& context) const override {
    const Surface& body = context.get(surface);
    std::vector<const Sdf*> given;
    for (size_t k = 0; k < context.count(sdf); ++k) given.push_back(&context.get(sdf, k));
    const NearFields fields(context, given, near_body(body, margin() / body.placement.scale));
    std::vector<Vec3d> shifts;
    if (way_in() && body.topology) {
      CollideInput input;
      input.points = body.points.host();
      input.placement = body.placement;
      input.colliders = fields.colliders();
      input.margin = margin() / body.placement.scale;
      Value mesh;
      shifts = stand_back(context.executor(), input, body.topology->triangles, [&]() -> const MeshDistance& {
        mesh = searchable_mesh(context, body);
        return *mesh.as<SearchableMesh>().distance;
      });
    }
    Contacts contacts = begin(shifts, body);
    if (fields.any_made()) contacts.fields = fields.copies();
    context.set(memory, std::move(contacts));
    Report figures;
    figures.set("way_in_steps", steps_of(shifts, body));
    context.set(report, std::move(figures));
  }

 private:
  static int steps_of(const std::vector<Vec3d>& shifts, const Surface& body) {
    constexpr double kStride = 0.0025, kMostSteps = 64;  // of the diagonal, an iteration
    double longest = 0;
    for (const Vec3d& shift : shifts) longest = std::max(longest, length(shift));
    return body.diagonal() > 0 ? static_cast<int>(std::ceil(std::min(kMostSteps, longest / body.diagonal() / kStride))) : 0;
  }

  static Contacts begin(const std::vector<Vec3d>& shifts, const Surface& body) {
    Contacts contacts;
    contacts.progress = Buffer<ContactProgress>(1);
    ContactProgress& progress = contacts.progress.data_for_write()[0];
    progress = {};
    progress.steps = steps_of(shifts, body);
    if (progress.steps == 0) return contacts;
    contacts.stand_back = Buffer<Vec3f>(shifts.size());
    for (size_t k = 0; k < shifts.size(); ++k) contacts.stand_back.data_for_write()[k] = to_float(shifts[k]);
    return contacts;
  }
};

}  // namespace

KNEAD_REGISTER(approach, Approach, 2, kManual)

}  // namespace knead
