// deform_equilibrium: the energy solver with its beginning and its end, as one node. It is a graph like any other, built in.
#include "graph/registry.h"
#include "io/graph_file.h"
#include "nodes/deform_parts.h"

namespace knead {

namespace {

const DeformManual kManual{
    .does = "Presses a soft surface by hard colliders to where it is truly at rest: the main job in one node. The one to pick first.",
    .node = "deform_equilibrium, surface: head, sdf: solid",
    .source = "method.md 4",
    .nodes = R"(  press    equilibrium: the minimum of one energy; its tables are made once for all frames
)",
    .remarks =
        R"(`deform` is the same job by the paper's loop. That one stops where it moves little, so its dents creep with the number of iterations and ripple when they
are deep; this one ends at rest, keeps the volume to a few hundredths of a percent, and is smooth in time. Where no collider is nearer than contact_gap, the
surface comes out untouched.

One of a million tets and more gets there sooner from where a coarse one roughly came to rest: the same result within the stop rule, in 16 to 26 iterations
instead of 30 to 42 (docs/convergence.md). A smaller one gains nothing.
  first:  {type: deform_equilibrium, surface: head, sdf: solid, max_depth: 5, threshold: 1.0e-2, displacement: 1.0e-2, penetration: 2.0e-2}
  result: {type: deform_equilibrium, surface: head, sdf: solid, max_depth: 7, start: first.state})",
    .inner = "press.threshold=1e-4",
};

const DeformGraph kGraph{
    .surface_depth = "4",
    .inputs = R"(  stiffness_weights: {type: Weights, optional: true, doc: "by vertex of M: how stiff, relative to elsewhere"}
  hold_weights: {type: Weights, optional: true, doc: "by vertex of M: of `hold`"}
  start: {type: EquilibriumState, optional: true, doc: "the state of a coarser one of the same surface, to begin there instead of at rest"}
)",
    .parameters = R"(  material: {default: stable_neo_hookean, doc: "the elastic energy: stable_neo_hookean, corotated or edges"}
  poisson_ratio: {default: 0.45, doc: "how well volume is kept everywhere; 0.5 cannot be reached"}
  hold: {default: 0, doc: "pull to rest, which bends the shape: 200 keeps dents local"}
  keep_place: {default: true, doc: "what neither pins nor `hold` keep neither moves nor turns as a whole"}
  friction: {default: 0, doc: "above 0: skin clings to a collider"}
  entry: {default: [0, 0, 0], doc: "the way that the colliders came in, world; zero: told from M at rest"}
  contact_gap: {default: 2.0e-3, doc: "how far outside a collider its force begins, in diagonals"}
  contact_samples: {default: 0, doc: "4: more points inside the triangles are kept outside while it solves, for a coarse M under a sharp collider"}
  max_iterations: {default: 300, doc: "after which it ends in any case"}
  threshold: {default: 3.0e-4, doc: "sum of forces over contact forces at rest"}
  displacement: {default: 2.0e-5, doc: "longest last step at rest, in diagonals"}
  penetration: {default: 1.0e-4, doc: "largest error of a contact at rest, in diagonals; in the mean a twentieth of it"}
)",
    .nodes = R"(  press:
    type: equilibrium
    surface: inputs.surface
    sdf: inputs.sdf
    tets: tets
    lattice: tets.lattice
    inside: tets.inside
    pins: inputs.pins
    stiffness_weights: inputs.stiffness_weights
    hold_weights: inputs.hold_weights
    start: inputs.start
    material: $material
    poisson_ratio: $poisson_ratio
    hold: $hold
    keep_place: $keep_place
    friction: $friction
    entry: $entry
    margin: $margin
    contact_gap: $contact_gap
    contact_samples: $contact_samples
    max_iterations: $max_iterations
    threshold: $threshold
    displacement: $displacement
    penetration: $penetration
)",
    .outputs = R"(  state: press.state
)",
};

}  // namespace

void register_deform_equilibrium(Registry& registry) {
  registry.add({"deform_equilibrium", 2, kManual.text(), nullptr, [] {
                  static const GraphSpec group = read_graph_text(kGraph.text(), "the built-in graph of deform_equilibrium");
                  return group;
                }});
}

}  // namespace knead
