// What deform and deform_equilibrium share: the words of their manual pages, and the graphs that they stand for but for the press itself.
#pragma once
#include <string>

namespace knead {

// What one of the two has of its own, as it stands in the section of its name.
struct DeformGraph {
  const char* surface_depth;                                              // the default
  const char *inputs = "", *parameters = "", *nodes = "", *outputs = "";  // `nodes` makes press.surface, press.points and press.report from tets

  std::string text() const {
    return std::string(R"(
knead: 1
inputs:
  surface: {type: Surface, doc: "the soft surface M, at rest"}
  sdf: {type: Sdf, many: true, optional: true, doc: "the colliders; none or several"}
  pins: {type: Weights, optional: true, doc: "vertices of M that stay: 0 free, 1 pinned"}
)") + inputs +
           R"(parameters:
  max_depth: {default: 6, doc: "of the tet mesh's octree: M's box is at most 2^max_depth cells wide"}
  surface_depth: {default: )" +
           surface_depth + R"(, doc: "of the octree's cells that M touches, however few of M's vertices they have; beyond max_depth nothing"}
  split_pieces: {default: false, doc: "keep apart what is closer than a cell, such as lips or fingers"}
  lattice: {default: barycentric, doc: "coordinates of M in the tet mesh: barycentric, trilinear or mean_value"}
)" + parameters +
           R"(  margin: {default: 0, doc: "distance to keep from the colliders, world units"}
  face_samples: {default: 10, doc: "points of every triangle in which the figures look for penetration; 0: vertices only"}
nodes:
  tets: {type: build_tets, surface: inputs.surface, max_depth: $max_depth, surface_depth: $surface_depth, split_pieces: $split_pieces, lattice: $lattice}
)" + nodes +
           R"(  exact: {type: collide_sdf, mode: project, surface: press.surface, sdf: inputs.sdf, margin: $margin, samples: 8}
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
)" + outputs +
           R"(  tets: tets.tets
  lattice: tets.lattice
)";
  }
};

struct DeformManual {
  const char* does;     // the first sentence
  const char* node;     // "deform, surface: head, sdf: solid"
  const char* source;   // what tells the method
  const char* nodes;    // between the tet mesh and the projection
  const char* remarks;  // paragraphs
  const char* inner;    // a parameter inside

  std::string text() const {
    return std::string(does) + R"(

  solid:  {type: mesh_to_sdf, mesh: fist}
  result: {type: )" +
           node + R"(}
  save:   {type: write_mesh, surface: result, path: out/head.####.obj}

It is a group that stands for these nodes ()" +
           source + R"():
  tets     build_tets: a tet mesh around the surface, built once
)" + nodes +
           R"(  exact    collide_sdf in mode project, with samples: no vertex of the result is left inside a collider, and no face that can be kept out of it
  figures  measure

)" + remarks +
           R"(

Inner nodes are reached from outside as NAME.press, and their parameters by --set NAME.)" +
           inner + ".";
  }
};

}  // namespace knead
