#include "kernels/measure.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "graph/registry.h"
#include "kernels/surface/searchable_mesh.h"

namespace knead {

namespace {

const char* const kManual = R"(Figures about a result: how deep it still is in the colliders, what became of its volume, how much it is stretched.

Lengths and volumes are in world units; names that end in _relative are fractions of the diagonal of M's box at rest, other ratios are plain fractions.
  penetration_max, penetration_rms      depth of M's vertices in the union of the colliders; vertices_inside: how many are in it
  penetration_faces_max                 the deepest of `face_samples` points on every triangle; not with face_samples: 0
  penetration_at, penetration_of        where the deepest of these is, as "x, y, z", and in which collider, the first being 1; where any is inside
  volume_rest, volume, volume_error     enclosed by M; error: volume / volume_rest - 1 (left out for a surface without volume)
  volume_tets_error                     the same of H                                      } these need `tets` and `points`
  stretch_mean, stretch_max             |L / L_rest - 1| over the edges of H               }
  inverted_tets                         tets of H whose volume is not positive             }
  displacement_max                      how far the vertex that went farthest went

Depths are exact where the collider's triangles are known (mesh_to_sdf gives them along), else they are samples of the SDF. Faces can be deeper than vertices:
a warning says where one of them is deeper than 1e-3 of the diagonal. A body that lies in the colliders with every vertex at rest has no right way out; a warning says so. Other reports are
merged in, later ones last. `volume_change`, for pictures, is H's local volume over its rest volume minus 1, at M's vertices; it needs `lattice` too, and is 0
without.)";

constexpr double kTooDeep = 1e-3;  // of the diagonal: a depth that is seen in a picture

class Measure : public Node {
 public:
  In<Surface> surface{this, "surface", {.unit = "world", .doc = "M, deformed"}};
  In<Surface> rest{this, "rest", {.unit = "world", .doc = "M at rest"}};
  ManyIn<Sdf> sdf{this, "sdf", {.unit = "world", .doc = "the colliders"}};
  OptionalIn<TetMesh> tets{this, "tets", {.doc = "H at rest"}};
  OptionalIn<Points> points{this, "points", {.unit = "cells", .shape = "vertices of H", .doc = "H, deformed, in tet space"}};
  OptionalIn<Lattice> lattice{this, "lattice", {.doc = "M in H, for volume_change"}};
  ManyIn<Report> reports{this, "report", {.doc = "reports to merge in: of the loop, of build_tets"}};
  Param<int> face_samples{
      this,
      "face_samples",
      10,
      {.min = 0, .max = 10000, .doc = "points on every triangle to look at, a grid: 10 are thirds of its sides, 45 eighths; 0: vertices only"}};
  Out<Report> report{this, "report", {.doc = "the figures"}};
  Out<Weights> change{this, "volume_change", {.shape = "vertices of M", .doc = "local volume of H over its rest volume, minus 1"}};

  void evaluate(Context& context) const override {
    const Surface &after = context.get(surface), &before = context.get(rest);
    if (after.vertices() != before.vertices())
      throw Error(ErrorCode::kInput, "surface has " + std::to_string(after.vertices()) + " vertices, rest has " + std::to_string(before.vertices()),
                  "measure a result against the mesh it was made from");
    Report figures;
    const double diagonal = before.diagonal() * before.placement.scale;
    const auto with_relative = [&](const std::string& name, double value) {
      figures.set(name, value);
      if (diagonal > 0) figures.set(name + "_relative", value / diagonal);
    };
    measure_contact(context, before, after, diagonal, with_relative, figures);
    measure_volume(context, before, after, diagonal, figures);
    with_relative("displacement_max", largest_displacement(context.executor(), before, after));
    context.set(change, Weights{measure_body(context, after, figures)});
    for (size_t i = 0; i < context.count(reports); ++i)
      for (const auto& [name, value] : context.get(reports, i).entries) std::visit([&, &key = name](const auto& v) { figures.set(key, v); }, value);
    context.set(report, std::move(figures));
  }

 private:
  template <class WithRelative>
  void measure_contact(Context& context, const Surface& before, const Surface& after, double diagonal, const WithRelative& with_relative,
                       Report& figures) const {
    if (context.count(sdf) == 0) return;
    ColliderDistance colliders;
    for (size_t i = 0; i < context.count(sdf); ++i) {
      const Sdf& field = context.get(sdf, i);
      colliders.add(field, searchable_mesh(context, field));
    }
    const Penetration depth = measure_penetration(context.executor(), after, colliders, face_samples());
    with_relative("penetration_max", depth.vertices_max);
    with_relative("penetration_rms", depth.vertices_rms);
    figures.set("vertices_inside", static_cast<double>(depth.vertices_inside));
    if (face_samples() > 0) with_relative("penetration_faces_max", depth.faces_max);
    tell_deepest(context, depth, colliders, diagonal, figures);
    const std::span<const Vec3f> at_rest = before.points.host();
    const auto swallowed = [&](const Vec3f& point) { return colliders(before.placement.apply(to_double(point))) < 0; };
    if (!at_rest.empty() && std::all_of(at_rest.begin(), at_rest.end(), swallowed))
      context.warn(
          "the colliders swallow the body: every vertex lies inside them at rest, and is pushed out wherever it is nearest; "
          "move or shrink the collider");
  }

  static void tell_deepest(Context& context, const Penetration& depth, const ColliderDistance& colliders, double diagonal, Report& figures) {
    const double deepest = std::max(depth.vertices_max, depth.faces_max);
    if (!(deepest > 0)) return;
    const std::string at = fmt::format("{:.4g}, {:.4g}, {:.4g}", depth.deepest_at.x, depth.deepest_at.y, depth.deepest_at.z);
    const size_t which = colliders.nearest(depth.deepest_at) + 1;
    figures.set("penetration_at", at);
    figures.set("penetration_of", static_cast<double>(which));
    if (!(deepest > kTooDeep * diagonal)) return;
    const bool faces = depth.vertices_max <= kTooDeep * diagonal;
    context.warn(fmt::format("{} of the surface are inside collider {}, up to {:.2g} deep ({:.2g} of the diagonal), at ({}); {}",
                             faces ? "faces" : "vertices", which, deepest, deepest / diagonal, at,
                             faces ? "the surface is coarser there than the collider: a finer surface would do"
                                   : "a body that comes to rest, and collide_sdf in mode project after it, have none"));
  }

  static void measure_volume(Context& context, const Surface& before, const Surface& after, double diagonal, Report& figures) {
    if (!before.topology) return;
    const auto volume = [&](const Surface& s) {
      return std::pow(s.placement.scale, 3) * signed_volume(context.executor(), s.points.host(), before.topology->triangles);
    };
    // Inside-out meshes enclose a negative volume; the sign is that of the rest shape.
    const double at_rest = volume(before), sign = at_rest < 0 ? -1 : 1, now = sign * volume(after);
    figures.set("volume_rest", std::abs(at_rest));
    figures.set("volume", now);
    if (std::abs(at_rest) > 1e-12 * diagonal * diagonal * diagonal) figures.set("volume_error", now / std::abs(at_rest) - 1);
  }

  Buffer<float> measure_body(Context& context, const Surface& after, Report& figures) const {
    const TetMesh* mesh = context.get(tets);
    const Points* now = context.get(points);
    if (!mesh != !now)
      throw Error(ErrorCode::kInput, std::string(mesh ? "tets" : "points") + " without " + (mesh ? "points" : "tets"), "connect both, or neither");
    if (mesh) {
      const TetFigures body = measure_tets(context.executor(), now->values, *mesh);
      if (body.rest_volume > 0) figures.set("volume_tets_error", body.volume / body.rest_volume - 1);
      figures.set("stretch_mean", body.stretch_mean);
      figures.set("stretch_max", body.stretch_max);
      figures.set("inverted_tets", static_cast<double>(body.inverted));
      if (body.inverted > 0)
        context.warn(fmt::format(
            "{} tets of H are inside out, so that the surface may be folded there: a coarser H, `split_pieces` where parts of the body are "
            "close together, or a collider that is in less deep would help",
            body.inverted));
    }
    const Lattice* bound = context.get(lattice);
    if (mesh && bound) return volume_change(context.executor(), now->values, *mesh, *bound);
    return Buffer<float>(std::vector<float>(after.vertices(), 0.0f));
  }
};

}  // namespace

KNEAD_REGISTER(measure, Measure, 2, kManual)

}  // namespace knead
