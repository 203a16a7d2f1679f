// Keeps a body in its place: pins, a pull to rest, and removal of the net rigid motion. Nothing else in the paper's loop does, so that its true fixed
// point is the body moved aside, undeformed (method.md 3, finding 3).
#pragma once
#include "graph/executor.h"
#include "kernels/loop/rigid_fit_body.h"
#include "kernels/port_types.h"

namespace knead {

struct HoldSettings {
  double strength = 0;  // part of the way to rest that every vertex goes, 0 to 1
  bool remove_rigid = true;
  const Buffer<float>* pins = nullptr;     // per vertex of M, 0 free to 1 pinned
  const Buffer<float>* weights = nullptr;  // of the strength, per vertex of M
};

// The rotation and translation that take x_rest nearest to x, least squares weighted by each vertex's share of the rest volume (Kabsch). Sums are
// taken in fixed pieces. `moved` is false when no vertex has left its rest position. Host executors only.
RigidFit rigid_fit(Executor& executor, const Buffer<Vec3f>& points, const TetMesh& tets);

// Paint on M, brought to H: per vertex the largest weight of the vertices of M it influences, or their mean by lattice weight. A vertex that
// influences none gets `elsewhere`. Host executors only.
Buffer<float> paint_to_tets(Executor& executor, const Buffer<float>& paint, const Lattice& lattice, bool largest, float elsewhere);

// `points` in tet space. First the rigid motion is taken out (not when any vertex is pinned: the pins hold the frame), then x += strength (x_rest -
// x), then pinned vertices go back to rest, to the bit at weight 1. Every vertex of H that influences a pinned vertex of M is pinned, so that vertex
// of M is at rest. H's vertices inside, which influence none, take the mean of the painted `weights`, and no pin. Throws Error(kInput) when sizes
// disagree, or when paint comes without a lattice.
Buffer<Vec3f> hold(Executor& executor, const Buffer<Vec3f>& points, const TetMesh& tets, const Lattice* lattice, const HoldSettings& settings);

}  // namespace knead
