// deform: the loop of the paper with its beginning and its end, as one node. It is a graph like any other, built in.
#include "graph/registry.h"
#include "io/graph_file.h"

namespace knead {

namespace {

const char* const kManual = R"(Presses a soft surface by hard colliders: the whole main job in one node, for those who need not see the loop.

  solid:  {type: mesh_to_sdf, mesh: fist}
  result: {type: deform, surface: head, sdf: solid, stiffness: 0.7}
  save:   {type: write_mesh, surface: result, path: out/head.####.obj}

It is a group that stands for these nodes (paper 3; method.md 3):
  tets     build_tets: a tet mesh around the surface, built once
  way      approach: how colliders that stand deep in the surface come in
  press    iterate, at most `max_iterations` times, until nothing moves more than `threshold`:
             push     collide_sdf with contact memory        lift    map_to_tets
             volume   restore_volume by `relaxation`         stiff   enforce_stiffness
             held     hold, with `pins`                      map     map_to_surface
  exact    collide_sdf in mode project: no vertex of the result is left inside a collider
  figures  measure

Where nothing touches, the surface comes out untouched. Inner nodes are reached from outside as NAME.press, and their parameters by
--set NAME.press.volume.relaxation=0.2.)";

const char* const kGraph = R"(
knead: 1
inputs:
  surface: {type: Surface, doc: "the soft surface M, at rest"}
  sdf: {type: Sdf, many: true, optional: true, doc: "the colliders; none or several"}
  pins: {type: Weights, optional: true, doc: "vertices of M that stay: 0 free, 1 pinned"}
parameters:
  max_depth: {default: 6, doc: "of the tet mesh's octree: M's box is at most 2^max_depth cells wide"}
  split_pieces: {default: false, doc: "keep apart what is closer than a cell, such as lips or fingers"}
  lattice: {default: barycentric, doc: "coordinates of M in the tet mesh: barycentric, trilinear or mean_value"}
  stiffness: {default: 0.5, doc: "0 soft: the dent stays local; 1 stiff: the whole body gives way"}
  relaxation: {default: 0.4, doc: "part of the volume step that is taken, on the mean over the sweeps; half and more does not settle"}
  sweeps: {default: 2, doc: "volume steps in every iteration; more keep the volume better and take longer"}
  hold: {default: 0.002, doc: "pull to rest in every iteration"}
  margin: {default: 0, doc: "distance to keep from the colliders, world units"}
  max_iterations: {default: 250, doc: "after which the loop ends in any case"}
  threshold: {default: 1.0e-4, doc: "at rest when M moves less than this fraction of its diagonal, and is nowhere deeper"}
  face_samples: {default: 0, doc: "points of every triangle in which the figures look for penetration; 0: vertices only"}
nodes:
  tets: {type: build_tets, surface: inputs.surface, max_depth: $max_depth, split_pieces: $split_pieces, lattice: $lattice}
  way: {type: approach, surface: inputs.surface, sdf: inputs.sdf, margin: $margin}
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
  exact: {type: collide_sdf, mode: project, surface: press.surface, sdf: inputs.sdf, margin: $margin}
  figures:
    type: measure
    surface: exact.surface
    rest: inputs.surface
    sdf: inputs.sdf
    tets: tets
    points: press.points
    lattice: tets.lattice
    report: press.report
    face_samples: $face_samples
outputs:
  surface: exact.surface
  report: figures.report
  volume_change: figures.volume_change
  points: press.points
  tets: tets.tets
  lattice: tets.lattice
)";

}  // namespace

void register_deform(Registry& registry) {
  registry.add({"deform", 1, kManual, nullptr, [] {
                  static const GraphSpec group = read_graph_text(kGraph, "the built-in graph of deform");
                  return group;
                }});
}

}  // namespace knead
