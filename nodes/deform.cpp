// deform: the loop of the paper with its beginning and its end, as one node. It is a graph like any other, built in.
#include "graph/registry.h"
#include "io/graph_file.h"
#include "nodes/deform_parts.h"

namespace knead {

namespace {

const DeformManual kManual{
    .does = "Presses a soft surface by hard colliders: the whole main job in one node, for those who need not see the loop.",
    .node = "deform, surface: head, sdf: solid, stiffness: 0.7",
    .source = "paper 3; method.md 3",
    .nodes = R"(  way      approach: how colliders that stand deep in the surface come in
  press    iterate, at most `max_iterations` times, until nothing moves more than `threshold`:
             push     collide_sdf with contact memory        lift    map_to_tets
             volume   restore_volume by `relaxation`         stiff   enforce_stiffness
             held     hold, with `pins`                      map     map_to_surface
)",
    .remarks = R"(Where nothing touches, the surface comes out untouched.)",
    .inner = "press.volume.relaxation=0.2",
};

const DeformGraph kGraph{
    // The loop keeps the volume less well on an H finer than M: 2.6 % for 2 % on a pressed block of 602 vertices.
    .surface_depth = "0",
    .parameters = R"(  stiffness: {default: 0.5, doc: "0 soft: the dent stays local; 1 stiff: the whole body gives way"}
  relaxation: {default: 0.4, doc: "part of the volume step that is taken, on the mean over the sweeps; half and more does not settle"}
  sweeps: {default: 2, doc: "volume steps in every iteration; more keep the volume better and take longer"}
  hold: {default: 0.002, doc: "pull to rest in every iteration"}
  max_iterations: {default: 250, doc: "after which the loop ends in any case"}
  threshold: {default: 1.0e-4, doc: "at rest when M moves less than this fraction of its diagonal, and is nowhere deeper"}
)",
    .nodes = R"(  way: {type: approach, surface: inputs.surface, sdf: inputs.sdf, margin: $margin}
  press:
    type: iterate
    max_iterations: $max_iterations
    threshold: $threshold
    state: {points: tets.points, surface: inputs.surface, memory: way}
    body:
      push: {type: collide_sdf, surface: state.surface, sdf: inputs.sdf, memory: state.memory, margin: $margin}
      lift: {type: map_to_tets, displacement: push.displacement, points: state.points, lattice: tets.lattice, tets: tets}
      volume: {type: restore_volume, points: lift, tets: tets, relaxation: $relaxation, sweeps: $sweeps}
      stiff: {type: enforce_stiffness, points: volume, tets: tets, stiffness: $stiffness}
      held: {type: hold, points: stiff, tets: tets, lattice: tets.lattice, pins: inputs.pins, strength: $hold}
      map: {type: map_to_surface, points: held, lattice: tets.lattice}
    next: {points: held, surface: map, memory: push.memory}
)",
};

}  // namespace

void register_deform(Registry& registry) {
  registry.add({"deform", 1, kManual.text(), nullptr, [] {
                  static const GraphSpec group = read_graph_text(kGraph.text(), "the built-in graph of deform");
                  return group;
                }});
}

}  // namespace knead
