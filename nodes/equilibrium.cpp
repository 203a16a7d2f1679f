#include "kernels/equilibrium/equilibrium.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>

#include "graph/opaque_value.h"
#include "graph/registry.h"
#include "io/vdb/near_field.h"
#include "kernels/equilibrium/mesh_transfer.h"
#include "kernels/loop/lattice_map.h"

namespace knead {
namespace {

// What the frames share: the tables and the metric of one rest shape.
struct PreparedRest {
  static constexpr const char* kOpaqueName = "PreparedRest";
  std::shared_ptr<const EquilibriumRest> rest;
};

// How displacements get from one H to another: shared by the frames too.
struct PreparedTransfer {
  static constexpr const char* kOpaqueName = "PreparedTransfer";
  std::shared_ptr<const MeshTransfer> table;
};

// What M at rest is, whichever handle it comes by: one that the cache had no room for is another buffer when it is made again.
struct Contents {
  static constexpr const char* kOpaqueName = "Contents";
  Key key;
};

// A field that is on a device, where the host can read it.
struct FieldOnHost {
  static constexpr const char* kOpaqueName = "FieldOnHost";
  Buffer<std::byte> grid;
  void each_buffer(auto&& f) { f(grid); }
};

const char* const kManual =
    R"(The shape in which a soft body comes to rest against hard colliders: the minimum of one energy over H (method.md 4). Takes the place of the loop.

  tets:   {type: build_tets, surface: head}
  press:  {type: equilibrium, surface: head, sdf: solid, tets: tets, lattice: tets.lattice}
  exact:  {type: collide_sdf, mode: project, surface: press, sdf: solid}

The energy is elastic + hold + contact, every part dimensionless, so that a parameter means the same at any size and at any fineness of H:
  elastic  `material`: stable_neo_hookean (Smith, de Goes, Kim 2018), corotated, or edges (springs along H's edges); `poisson_ratio` says how well volume is
           kept: 0.45 lets flesh give a little; nearer to 0.5 is slower. What M encloses as a whole is kept by `keep_volume`
  hold     a pull to rest, `hold`, over the body, 0 by default, since it bends the answer: it moves the contour of a torus squeezed between plates by 0.5 % of
           the squeeze at 1, by 10 % at 20 (docs/convergence.md). 200 keeps dents local. `pins` hold for good.
  contact  every vertex of M outside every collider: a stiff force with a memory, the multiplier of an augmented Lagrangian, so that contacts end exact, not
           merely stiff. Where a collider is thin beside M's triangles, points inside these are kept outside too, found from M at rest and the collider's
           thickness; and where a face is still pierced at the end, the solve goes on with more. `contact_samples: 4` takes such points everywhere.
           The force begins a little way outside, at `contact_gap`, from nothing: a vertex that meets a collider does not jolt. What is pressed hard touches;
           what is pressed lightly keeps some gap.
           With `friction` skin clings to where it met the collider on its way in, and slides when pulled harder.

What nothing holds, neither pins nor a pull, keeps its place (`keep_place`): every part of the body that hangs together neither moves nor turns in the mean,
weighted by mass. A pull on its mass, even like weight, and a couple balance the colliders. Without, a free body against one collider is pushed aside as a
whole, undented, and one between several finds its own place among them.

H sticks out of M, and what sticks out is no flesh: connect `inside: tets.inside`, and each tet has stiffness, volume term and hold by its part inside M, at
least `outside_stiffness` of it. Corners with little flesh follow the continuation of what their neighbours do (a ghost penalty, as finite elements on cut
cells have it), and next to empty tets resist before they are squeezed flat. A torus of 64 x 32 quads squeezed between plates is then 5 %
of a plate's way off CalculiX instead of 17 %, with cells of half the size below 3 % (docs/convergence.md). With `keep_volume` its shape is that of
Poisson's ratio 0.499, whatever `poisson_ratio` says; without, that of `poisson_ratio`.

Which side of a collider the flesh is on is told from M at rest: by the normals of what is inside the collider, or, when it is in deeper than its middle, by a
way in along which it then comes in over the first iterations (`way_in_iterations`). `entry` says it for certain: with it a ball can be swept into a body until
it is out of sight; far deeper flesh lets it through. The report counts `undecided_colliders`, where the nearest way out was taken, and `enclosed_colliders`,
which lie in the body and touch nothing, as bones do and what was let through.

The report's `contact_forces` are the forces on the colliders, x y z in world directions for each in turn, over Young's modulus and the square of M's diagonal:
times both they are forces. `contact_force` is the size of the largest. Measured against CalculiX in docs/convergence.md.

It never starts from the frame before, but a fine H can start from where a coarse one of the same surface came to rest, roughly: the same result within the stop
rule, in fewer iterations; `started` in the report says so. The coarse solve decides on which side of a collider the flesh is. What `start` brings passes
through the host. Give both the same contact_samples, else contacts begin without their forces.

  coarse: {type: build_tets, surface: head, max_depth: 4}
  first:  {type: equilibrium, surface: head, sdf: solid, tets: coarse, lattice: coarse.lattice, threshold: 1.0e-2, displacement: 1.0e-2, penetration: 2.0e-2}
  tets:   {type: build_tets, surface: head, max_depth: 6}
  press:  {type: equilibrium, surface: head, sdf: solid, tets: tets, lattice: tets.lattice, start: first.state}

Only ratios count: twice the stiffness everywhere is the same shape. So stiffness is painted (`stiffness_weights`), not given.

It starts from rest and runs L-BFGS over a metric (Liu, Bouaziz, Kavan 2017): one multigrid cycle with the energy's second derivative, kept positive, a block of
three by three per edge of H. Its grids belong to the rest shape and are made once; where the shape has changed the matrix follows it, and what pushes, after
4, 8, 16, 32 iterations and so on, and when steps are refused. An H of more than 8,000 vertices moves as the coarsest of these grids can at first, then as finer
ones, each for as long as an iteration takes a tenth of the energy away: its own tets would crumple under fresh contacts. It ends when the forces balance to
`threshold` of the contact forces, the last step was short and no contact is off by more than `penetration`, or a twentieth of it in the mean: the
report says `at rest`. Else it says `rounding` (a touch so light that float32 gets it no nearer to balance), `iteration limit` or `stalled`. What is left of penetration (below 1e-4 of the
diagonal) is taken out by collide_sdf in mode project. Where no collider is nearer than the gap, M comes out untouched.
The same bits for any number of threads.

On a device a descent stays there: after an evaluation of the energy the host reads a few sums. The tables and the grids are made on the host, once, and so is,
in a frame, the search for the way in.)";

ElasticTerm term_of(const std::string& name) {
  return name == "edges" ? ElasticTerm::kEdges : name == "corotated" ? ElasticTerm::kCorotated : ElasticTerm::kStableNeoHookean;
}

class Equilibrium : public Node {
 public:
  In<Surface> surface{this, "surface", {.unit = "world", .doc = "M at rest, as build_tets had it"}};
  ManyIn<Sdf> sdf{this, "sdf", {.unit = "world", .doc = "the colliders; none or several"}};
  In<TetMesh> tets{this, "tets", {.doc = "H at rest"}};
  In<Lattice> lattice{this, "lattice", {.doc = "M in H"}};
  OptionalIn<Weights> inside{
      this, "inside", {.shape = "tets of H", .doc = "the part of each tet that lies inside M, build_tets.inside; without, H is flesh throughout"}};
  OptionalIn<Weights> pins{this, "pins", {.shape = "vertices of M", .doc = "0 free, 1 pinned"}};
  OptionalIn<Weights> stiffness_weights{
      this, "stiffness_weights", {.shape = "vertices of M", .doc = "how stiff, relative to elsewhere; inside H the mean"}};
  OptionalIn<Weights> volume_weights{this, "volume_weights", {.shape = "vertices of M", .doc = "of the volume's part in the material"}};
  OptionalIn<Weights> hold_weights{this, "hold_weights", {.shape = "vertices of M", .doc = "of `hold`"}};
  OptionalIn<EquilibriumState> start{
      this, "start", {.doc = "the state of another equilibrium of the same surface, to begin there instead of at rest"}};
  Param<std::string> material{
      this, "material", "stable_neo_hookean", {.choices = {"stable_neo_hookean", "corotated", "edges"}, .doc = "the elastic energy"}};
  Param<double> poisson_ratio{
      this, "poisson_ratio", EquilibriumMaterial{}.poisson_ratio, {.min = 0, .max = 0.4999, .doc = "how well volume is kept"}};
  Param<bool> keep_volume{
      this, "keep_volume", EquilibriumMaterial{}.keep_volume, {.doc = "M as a whole keeps the volume that it encloses; closed surfaces only"}};
  Param<double> hold{this, "hold", EquilibriumMaterial{}.hold, {.min = 0, .doc = "pull to rest, relative to stiffness over the diagonal squared"}};
  Param<bool> keep_place{
      this, "keep_place", EquilibriumMaterial{}.keep_place, {.doc = "what neither pins nor `hold` keep neither moves nor turns as a whole"}};
  Param<double> outside_stiffness{this,
                                  "outside_stiffness",
                                  EquilibriumMaterial{}.outside_stiffness,
                                  {.min = 1e-3, .max = 1, .doc = "of what H has outside M, where `inside` tells; 1: as flesh"}};
  Param<double> margin{this, "margin", 0, {.min = 0, .unit = "world", .doc = "distance to keep from the colliders"}};
  Param<Triple> entry{
      this, "entry", {0, 0, 0}, {.doc = "the way that the colliders came in, world; [0, 0, 0]: told from M at rest, where it can be told"}};
  Param<int> contact_samples{
      this,
      "contact_samples",
      0,
      {.min = 0, .max = 16, .doc = "into how many pieces a triangle's sides are cut, at least, whose ends are kept outside too"}};
  Param<double> contact{
      this, "contact", EquilibriumSettings{}.contact, {.min = 1e-3, .max = 1e3, .doc = "stiffness of a contact before its memory fills"}};
  Param<double> contact_gap{
      this,
      "contact_gap",
      EquilibriumSettings{}.contact_gap,
      {.min = 0, .max = 0.1, .unit = "diagonals", .doc = "how far outside a collider its force begins; 0: at touch, not smooth in time"}};
  Param<double> friction{
      this, "friction", 0, {.min = 0, .max = 10, .doc = "Coulomb's: how much of a contact's force may pull skin back to where its contact began"}};
  Param<int> max_iterations{this, "max_iterations", EquilibriumSettings{}.max_iterations, {.min = 1, .doc = "after which it ends in any case"}};
  Param<double> threshold{
      this, "threshold", EquilibriumSettings{}.threshold, {.min = 1e-6, .max = 1, .doc = "sum of forces over contact forces at rest"}};
  Param<double> displacement{
      this, "displacement", EquilibriumSettings{}.displacement, {.min = 0, .unit = "diagonals", .doc = "longest last step at rest"}};
  Param<double> penetration{this,
                            "penetration",
                            EquilibriumSettings{}.penetration,
                            {.min = 0, .unit = "diagonals", .doc = "largest error of a contact at rest; in the mean a twentieth of it"}};
  Param<int> memory_interval{this,
                             "memory_interval",
                             EquilibriumSettings{}.memory_interval,
                             {.min = 1, .doc = "iterations after which the contact memory is updated in any case"}};
  Param<double> memory_gradient{this, "memory_gradient", EquilibriumSettings{}.memory_gradient, {.min = 0, .doc = "or below this relative gradient"}};
  Param<double> memory_limit{
      this, "memory_limit", 1e-9 * EquilibriumMaterial{}.memory_limit, {.min = 0, .unit = "GB", .doc = "an H whose metric takes more is refused"}};
  Out<Surface> result{this, "surface", {.unit = "world", .doc = "M at its equilibrium"}};
  Out<Points> points{this, "points", {.unit = "cells", .shape = "vertices of H", .doc = "H at its equilibrium, in tet space"}};
  Out<Report> report{
      this,
      "report",
      {.doc =
           "iterations, ended, gradient, last_step, contacts, contact_error (of the diagonal), contact_force, contact_forces, undecided_colliders, "
           "enclosed_colliders, least_tet_volume, times"}};

  Out<EquilibriumState> state{this, "state", {.doc = "where it ended, for the start of one with a finer H"}};

  Runs runs() const override { return Runs::kAnyDevice; }
  std::string what_became_of(const std::string& member) const override {
    return member == "metric" ? "there is one metric now, for any size: leave it out" : std::string{};
  }

  bool shares_parts() const override { return true; }
  void make_parts(Context& context) const override { prepared(context, key(context)); }

  void evaluate(Context& context) const override {
    const Surface& body = context.get(surface);
    const Lattice& bound = context.get(lattice);
    if (body.points.id() != bound.rest.points.id() && contents(context, body.points) != contents(context, bound.rest.points))
      throw Error(ErrorCode::kInput, "surface is not the one that the lattice binds", "connect the surface that build_tets has");
    const Key rest_key = key(context);
    const Value shared = prepared(context, rest_key);
    const EquilibriumRest& rest = *shared.as<PreparedRest>().rest;

    std::vector<const Sdf*> given;
    for (size_t k = 0; k < context.count(sdf); ++k) given.push_back(&context.get(sdf, k));
    const NearFields fields(context, given, near_body(body, margin() / body.placement.scale + contact_gap() * body.diagonal()));
    const std::span<const Sdf* const> colliders = fields.colliders();
    EquilibriumSettings settings;
    settings.max_iterations = max_iterations();
    settings.threshold = threshold();
    settings.displacement = displacement();
    settings.penetration = penetration();
    settings.contact = contact();
    settings.memory_interval = memory_interval();
    settings.memory_gradient = memory_gradient();
    settings.margin = margin() / body.placement.scale;
    settings.contact_gap = contact_gap();
    settings.friction = friction();
    settings.entry = {entry()[0], entry()[1], entry()[2]};
    settings.on_host = [&](size_t k) {
      if (fields.on_host(k)) return *fields.on_host(k);
      Sdf field = *colliders[k];  // its grid is the same one in all frames of a rigid motion
      const Key key = Hasher().add("field on the host").add(field.grid.id()).key();
      field.grid = context.once(key, [&] { return Value::of(FieldOnHost{context.on_host(field.grid)}); }).as<FieldOnHost>().grid;
      return field;
    };
    settings.check_cancelled = [&] { context.check_cancelled(); };
    EquilibriumFigures figures;
    Value transfer;
    settings.start = context.get(start);
    if (settings.start) {
      transfer = transfer_from(context, *settings.start, rest, rest_key, contents(context, body.points));
      settings.transfer = transfer.as<PreparedTransfer>().table.get();
    }
    EquilibriumState end;
    const Buffer<Vec3f> moved =
        solve_equilibrium(context.executor(), rest, body.placement, colliders, settings, figures, context.wants(state) ? &end : nullptr);
    end.rest = shared.as<PreparedRest>().rest;
    end.key = rest_key;
    if (context.wants(state)) end.surface = contents(context, body.points);
    Surface pressed = body;
    if (figures.ended != Ended::kNoContact) pressed.points = map_to_surface(context.executor(), moved, bound);
    context.add_time("elastic", figures.elastic_seconds);
    context.add_time("contact", figures.contact_seconds);
    context.add_time("directions", figures.direction_seconds);
    context.set(result, std::move(pressed));
    context.set(points, Points{moved});
    context.set(state, std::move(end));
    context.set(report, describe(figures, figures_of(rest)));
    if (!is_rest(figures.ended)) context.warn(restless(figures, body.placement));
  }

 private:
  static Key contents(Context& context, const Buffer<Vec3f>& points) {
    const auto make = [&] {
      const Buffer<Vec3f> here = context.on_host(points);
      return Value::of(Contents{Hasher().bytes(here.host().data(), here.bytes()).key()});
    };
    return context.once(Hasher().add("contents").add(points.id()).key(), make).as<Contents>().key;
  }

  static Value transfer_from(Context& context, const EquilibriumState& from, const EquilibriumRest& to, const Key& key, const Key& surface) {
    if (from.surface != surface)
      throw Error(ErrorCode::kInput, "start is of another surface", "start from an equilibrium of the same surface, with a coarser H around it");
    return context.once(Hasher().add("transfer").add(from.key).add(key).key(), [&] {
      return Value::of(PreparedTransfer{std::make_shared<MeshTransfer>(make_mesh_transfer(context.executor(), *from.rest, to))});
    });
  }

  // What belongs to the rest shape.
  Value prepared(Context& context, const Key& key) const {
    return context.once(key, [&] { return Value::of(PreparedRest{prepare(context)}); });
  }

  Key key(Context& context) const {
    const TetMesh& mesh = context.get(tets);
    const Lattice& bound = context.get(lattice);
    Hasher key;
    key.add("equilibrium")
        .add(material())
        .add(poisson_ratio())
        .add(hold())
        .add(keep_volume())
        .add(keep_place())
        .add(contact_samples())
        .add(memory_limit())
        .add(outside_stiffness());
    key.add(mesh.rest.id()).add(mesh.tets.id()).add(bound.map.values.id()).add(bound.map.indices.id()).add(bound.rest.points.id());
    if (bound.rest.topology) key.bytes(bound.rest.topology->triangles.data(), bound.rest.topology->triangles.size() * sizeof(uint32_t));
    for (const OptionalIn<Weights>* port : {&inside, &pins, &stiffness_weights, &volume_weights, &hold_weights}) {
      const Weights* painted = context.get(*port);
      key.add(painted ? painted->values.id() : 0);
    }
    return key.key();
  }

  std::shared_ptr<const EquilibriumRest> prepare(Context& context) const {
    const TetMesh& mesh = context.get(tets);
    const Lattice& bound = context.get(lattice);
    EquilibriumMaterial settings;
    settings.term = term_of(material());
    settings.poisson_ratio = poisson_ratio();
    settings.hold = hold();
    settings.keep_volume = keep_volume();
    settings.keep_place = keep_place();
    settings.contact_samples = contact_samples();
    settings.memory_limit = 1e9 * memory_limit();
    settings.check_cancelled = [&] { context.check_cancelled(); };
    Buffer<float> painted[5];
    const auto on_host = [&](const OptionalIn<Weights>& port, Buffer<float>& to) -> const Buffer<float>* {
      if (!context.get(port)) return nullptr;
      to = context.on_host(context.get(port)->values);
      return &to;
    };
    settings.outside_stiffness = outside_stiffness();
    settings.inside = on_host(inside, painted[4]);
    settings.pins = on_host(pins, painted[0]);
    settings.stiffness_weights = on_host(stiffness_weights, painted[1]);
    settings.volume_weights = on_host(volume_weights, painted[2]);
    settings.hold_weights = on_host(hold_weights, painted[3]);
    TetMesh tets_here = mesh;
    tets_here.rest = context.on_host(mesh.rest);
    Lattice lattice_here = bound;
    PortTraits<Lattice>::each_buffer(lattice_here, [&](auto& buffer) { buffer = context.on_host(buffer); });
    return prepare_equilibrium(context.executor(), tets_here, lattice_here, settings);
  }

  std::string restless(const EquilibriumFigures& figures, const Similarity& placement) const {
    std::string text = fmt::format("not at rest after {} iterations: forces are off balance by {:.1e} (threshold {:.1e})", figures.iterations,
                                   figures.gradient, threshold());
    if (figures.unsettled.collider < std::numeric_limits<size_t>::max()) {
      const Vec3d at = placement.apply(figures.unsettled.at);
      text +=
          fmt::format(", most at collider {} where the body at rest has ({:.4g}, {:.4g}, {:.4g})", figures.unsettled.collider + 1, at.x, at.y, at.z);
    }
    return text + (figures.ended == Ended::kIterationLimit ? "; more max_iterations, a coarser H or a collider that is in less deep would help"
                                                           : "; no step makes it better: a coarser H or a collider that is in less deep would help");
  }

  // "x y z; x y z", in the order of the colliders.
  static std::string words_of(const std::vector<Vec3d>& forces) {
    std::string words;
    for (const Vec3d& force : forces) words += fmt::format("{}{:.6g} {:.6g} {:.6g}", words.empty() ? "" : "; ", force.x, force.y, force.z);
    return words;
  }

  static Report describe(const EquilibriumFigures& figures, const RestFigures& rest) {
    Report report;
    report.set("ended", text_of(figures.ended));
    report.set("iterations", figures.iterations);
    report.set("started", figures.started ? "state" : "rest");
    report.set("way_in_iterations", figures.way_in);
    report.set("undecided_colliders", static_cast<double>(figures.undecided));
    report.set("enclosed_colliders", static_cast<double>(figures.enclosed));
    report.set("evaluations", figures.evaluations);
    report.set("memory_updates", figures.updates);
    report.set("gradient", figures.gradient);
    report.set("last_step", figures.step);
    report.set("contacts", static_cast<double>(figures.contacts));
    report.set("contact_error", figures.penetration);
    double hardest = 0;
    for (const Vec3d& force : figures.forces) hardest = std::max(hardest, length(force));
    report.set("contact_force", hardest);
    report.set("contact_forces", words_of(figures.forces));
    report.set("least_tet_volume", figures.least_volume);
    report.set("energy", figures.energy);
    report.set("solve_milliseconds", 1e3 * figures.seconds);
    report.set("elastic_milliseconds", 1e3 * figures.elastic_seconds);
    report.set("contact_milliseconds", 1e3 * figures.contact_seconds);
    report.set("direction_milliseconds", 1e3 * figures.direction_seconds);
    report.set("metric_renewal_milliseconds", 1e3 * figures.renewal_seconds);
    report.set("metric_megabytes", 1e-6 * rest.metric_bytes);
    report.set("metric_set_up_milliseconds", 1e3 * rest.metric_seconds);
    report.set("prepare_milliseconds", 1e3 * rest.seconds);
    return report;
  }
};

}  // namespace

KNEAD_REGISTER(equilibrium, Equilibrium, 4, kManual)

}  // namespace knead
