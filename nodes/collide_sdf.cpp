#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include "graph/registry.h"
#include "io/vdb/near_field.h"
#include "kernels/loop/collide.h"
#include "kernels/port_types.h"
#include "kernels/surface/searchable_mesh.h"

namespace knead {

namespace {

const char* const kManual = R"(Pushes the soft surface out of rigid colliders (paper 3.1; method.md 3).

`mode: push` is the step of the loop. Where a vertex is inside, phi < 0, it is pushed by d = -phi grad phi, in the surface's own space; several colliders act
as their union: the one that a vertex is deepest in decides, and no grids are merged. Without `memory` that is all. With it, each vertex keeps a contact
memory lambda >= 0: lambda <- max(0, lambda - memory_rate * phi), and the push is lambda along grad phi. The other steps of the loop average a push away; the
memory grows until it holds, and decays as soon as the vertex is outside. It is bounded by `memory_limit` times the surface's diagonal.

The nearest way out may be the wrong one where a collider stands deep in the body: `approach` makes the memory that a loop begins with so that such a collider
comes in from outside over the first iterations.

`mode: project` is the last step after the loop: every vertex that is inside goes to the nearest place outside, exactly against the collider's own triangles
where the field carries them (else against the field's interpolant), a few rounding errors outside. A vertex squeezed between colliders goes to and fro, and
if no place is found stays at the least deep one; the report counts these. Only vertices are looked at: a coarse face can still cut a convex collider.
`samples: 8` also keeps 42 points inside each triangle and its edges outside, by moving its corners, each along its own way out, so that what a slow collider
does stays smooth in time.

Vertices that are not in contact keep their bits, and without any contact the surface comes out as the very same buffer. `margin` keeps a skin's distance; it
must lie within the field's outside band. Displacements and memory are in the surface's local units; the report is in world units.)";

class CollideSdf : public Node {
 public:
  In<Surface> surface{this, "surface", {.unit = "world", .doc = "the soft surface, as it is now"}};
  ManyIn<Sdf> sdf{this, "sdf", {.unit = "world", .doc = "colliders; their union counts"}};
  OptionalIn<Contacts> memory{
      this,
      "memory",
      {.unit = "local", .shape = "vertices", .doc = "contact memory from the iteration before, or from approach; none: no memory yet"}};
  Param<std::string> mode{this, "mode", "push", {.choices = {"push", "project"}, .doc = "a step of the loop, or the exact end of a frame"}};
  Param<double> margin{this, "margin", 0, {.min = 0, .unit = "world", .doc = "distance to keep from the colliders"}};
  Param<double> memory_rate{this, "memory_rate", 1, {.min = 0, .max = 10, .doc = "how much of phi goes into the memory each time"}};
  Param<double> memory_limit{
      this, "memory_limit", 0.1, {.min = 0, .unit = "diagonals", .doc = "upper bound of the memory, as a fraction of the surface's diagonal"}};
  Param<int> rounds{this, "rounds", 32, {.min = 1, .max = 1000, .doc = "project: attempts at a vertex between several colliders"}};
  Param<int> samples{this,
                     "samples",
                     0,
                     {.min = 0, .max = 32, .doc = "project: subdivisions of a triangle's sides whose points are kept outside too; 0: vertices only"}};
  Out<Points> displacement{
      this, "displacement", {.unit = "local", .shape = "vertices", .doc = "the push of each vertex, in the surface's local space"}};
  Out<Surface> pushed{this, "surface", {.unit = "world", .doc = "the surface with the push applied"}};
  Out<Contacts> contacts{this, "memory", {.unit = "local", .shape = "vertices", .doc = "contact memory for the next iteration"}};
  Out<Report> report{
      this,
      "report",
      {.doc = "vertices_in_collision, penetration_max (world), penetration_max_relative (of the diagonal); project adds what is left"}};

  Runs runs() const override { return mode() == "project" ? Runs::kHost : Runs::kAnyDevice; }
  std::string what_became_of(const std::string& member) const override {
    return member == "way_in" ? "the node 'approach' took it over: connect its memory to the loop's state" : "";
  }

  void evaluate(Context& context) const override {
    const Surface& body = context.get(surface);
    std::array<const Sdf*, 32> few;  // a loop allocates nothing
    std::vector<const Sdf*> many(context.count(sdf) > few.size() ? context.count(sdf) : 0);
    const std::span<const Sdf*> colliders(many.empty() ? few.data() : many.data(), context.count(sdf));
    for (size_t k = 0; k < colliders.size(); ++k) colliders[k] = &context.get(sdf, k);
    const Contacts* before = context.get(memory);
    if (before && before->memory && before->memory.size() != body.vertices())
      throw Error(ErrorCode::kInput,
                  "the contact memory has " + std::to_string(before->memory.size()) + " entries for " + std::to_string(body.vertices()) + " vertices",
                  "it must come from the same surface");
    if (mode() == "project") return project(context, body, colliders, before);
    if (before && !before->fields.empty()) return push_by_fields(context, body, colliders, *before);
    const NearBody place = near_body(body, margin() / body.placement.scale);
    if (std::all_of(colliders.begin(), colliders.end(), [&](const Sdf* one) { return knows(*one, place); }))
      return push(context, body, colliders, before);
    const NearFields fields(context, colliders, place);
    if (fields.any_made()) {
      Contacts with_fields = before ? *before : Contacts{};
      with_fields.fields = fields.copies();
      return push_by_fields(context, body, colliders, with_fields);
    }
    push(context, body, colliders, before);
  }

 private:
  // The memory holds what the colliders have to be for this body.
  void push_by_fields(Context& context, const Surface& body, std::span<const Sdf*> colliders, const Contacts& before) const {
    check_count("fields of", before.fields.size(), colliders.size());
    for (size_t k = 0; k < colliders.size(); ++k) colliders[k] = &before.fields[k];
    push(context, body, colliders, &before);
  }

  static void check_count(const std::string& what, size_t known, size_t given) {
    if (known == given) return;
    throw Error(ErrorCode::kInput,
                "the contact memory knows " + what + " " + std::to_string(known) + " colliders, and there are " + std::to_string(given),
                "give approach and collide_sdf the same colliders");
  }

  void push(Context& context, const Surface& body, std::span<const Sdf* const> colliders, const Contacts* before) const {
    Executor& executor = context.executor();
    const Device device = executor.device();
    const size_t n = body.vertices();
    Points moves{Buffer<Vec3f>(n, context.memory())};
    Contacts after{Buffer<float>(n, context.memory()), Buffer<ContactProgress>(1, context.memory()), {}, {}, {}, {}};
    CollideInput input;
    input.points = body.points.view(device);
    if (before) {
      after.stand_back = before->stand_back;
      input.memory = before->memory.view(device);
      input.before = before->progress.view(device).data();
      input.stand_back = before->stand_back.view(device);
      after.fields = before->fields;
      if (!input.stand_back.empty()) check_count("the ways of", input.stand_back.size(), colliders.size());
    }
    input.placement = body.placement;
    input.colliders = colliders;
    input.margin = margin() / body.placement.scale;
    input.rate = memory_rate();
    input.most = memory_limit() * body.diagonal();
    input.diagonal = body.diagonal();
    if (device != Device{}) {
      after.colliders_of = key_of_given(context, body.placement);
      after.colliders = before && before->colliders_of == after.colliders_of ? before->colliders : prepare_colliders(executor, input);
      input.prepared = after.colliders;
    }
    collide_push(executor, input, moves.values.data_for_write(), after.memory.data_for_write(), after.progress.data_for_write());

    Surface moved = body;
    if (context.wants(pushed) && (device != Device{} || after.progress.host()[0].pushed > 0)) {
      moved.points = Buffer<Vec3f>(n, context.memory());
      add_displacement(executor, input.points, moves.values.view(device).data(), moved.points.data_for_write());
    }
    Report figures;
    if (context.wants(report)) {
      const Buffer<ContactProgress> progress = context.on_host(after.progress);
      figures = describe(progress.host()[0].inside, progress.host()[0].deepest, body);
    }
    context.set(displacement, std::move(moves));
    context.set(pushed, std::move(moved));
    context.set(contacts, std::move(after));
    context.set(report, std::move(figures));
  }

  // Of the colliders as they are given: fields near the body follow from them.
  Key key_of_given(Context& context, const Similarity& placement) const {
    Hasher key;
    const auto add = [&](const Similarity& place) {
      key.add(place.scale).add(place.translation.x).add(place.translation.y).add(place.translation.z);
      for (const double r : place.rotation) key.add(r);
    };
    add(placement);
    for (size_t k = 0; k < context.count(sdf); ++k) {
      key.add(context.get(sdf, k).grid.id());
      add(context.get(sdf, k).placement);
    }
    return key.key();
  }

  void project(Context& context, const Surface& body, std::span<const Sdf* const> colliders, const Contacts* before) const {
    Executor& executor = context.executor();
    const size_t n = body.vertices();
    std::vector<std::shared_ptr<const ExactDistance>> kept;
    std::vector<const ExactDistance*> meshes;
    for (const Sdf* collider : colliders) meshes.push_back(kept.emplace_back(searchable_mesh(context, *collider)).get());
    context.check_cancelled();
    constexpr double kClearance = 4e-7;  // of the diagonal: a few roundings of a float coordinate
    ProjectInput input;
    input.points = body.points.host();
    input.placement = body.placement;
    input.colliders = colliders;
    input.meshes = meshes;
    input.margin = margin() / body.placement.scale;
    input.clearance = kClearance * body.diagonal();
    input.rounds = rounds();
    if (body.topology) input.triangles = body.topology->triangles;
    input.samples = samples();

    Surface moved = body;
    Buffer<Vec3f> points(n, context.memory());
    const ProjectFigures figures = project_outside(executor, input, points.data_for_write());
    Points moves{Buffer<Vec3f>(n, context.memory())};
    Vec3f* move = moves.values.data_for_write();
    for (size_t i = 0; i < n; ++i) {
      const bool same = std::memcmp(&points.host()[i], &input.points[i], sizeof(Vec3f)) == 0;
      move[i] = same ? Vec3f{0, 0, 0} : points.host()[i] - input.points[i];
    }
    if (figures.moved > 0) moved.points = std::move(points);

    Contacts after{before && before->memory ? before->memory : zeros(n, context), Buffer<ContactProgress>(1), {}, {}, {}, {}};
    ContactProgress& progress = after.progress.data_for_write()[0];
    progress = {};
    progress.unrest = relative(figures.deepest_before, body);
    progress.deepest = static_cast<float>(figures.deepest_before);
    progress.inside = static_cast<uint32_t>(figures.inside);
    progress.pushed = static_cast<uint32_t>(figures.moved);
    Report result = describe(figures.inside, figures.deepest_before, body);
    result.set("vertices_left_inside", static_cast<double>(figures.left));
    result.set("penetration_left", figures.deepest_left * body.placement.scale);
    result.set("penetration_left_relative", relative(figures.deepest_left, body));
    result.set("vertices_projected", static_cast<double>(figures.moved));
    if (samples() > 1) result.set("penetration_samples", figures.deepest_sample * body.placement.scale);
    context.set(displacement, std::move(moves));
    context.set(pushed, std::move(moved));
    context.set(contacts, std::move(after));
    context.set(report, std::move(result));
  }

  static double relative(double depth, const Surface& body) { return body.diagonal() > 0 ? depth / body.diagonal() : 0; }

  static Buffer<float> zeros(size_t n, Context& context) {
    Buffer<float> buffer(n, context.memory());
    std::fill_n(buffer.data_for_write(), n, 0.0f);
    return buffer;
  }

  static Report describe(size_t inside, double deepest, const Surface& body) {
    Report report;
    report.set("vertices_in_collision", static_cast<double>(inside));
    report.set("penetration_max", deepest * body.placement.scale);
    report.set("penetration_max_relative", relative(deepest, body));
    return report;
  }
};

}  // namespace

KNEAD_REGISTER(collide_sdf, CollideSdf, 4, kManual)

}  // namespace knead
