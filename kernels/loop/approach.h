// How a collider that stands deep in the body came in. A distance field knows only the nearest way out: for the tip of a nose that is past a thumb's
// middle, or flesh above a bar that is pressed in deeper than it is thick, that way draws a spike of flesh through the collider. A frame knows
// nothing of the frames before it, so the way in is told from M at rest, and the loop lets the collider come in along it over its first iterations.
#pragma once
#include <span>
#include <vector>

#include "graph/executor.h"
#include "kernels/loop/collide.h"

namespace knead {

class MeshDistance;

// How one collider came in: along the unit `direction`, in M's local space. `length` is the longest way that a vertex of the patch needs along it to
// leave the collider; 0: the nearest way out is taken.
struct WayIn {
  Vec3d direction{0, 0, 0};
  double length = 0;
  bool undecided = false;  // the nearest way out is wrong somewhere, and there is no better one to be seen
};

// Per collider.
//
// Vertices in collision are the collider's patch, with the islands that they cut off from the largest piece of their shell, if these would have to
// pass the collider on their way into the body (what stands in a ring's hole need not). Its way in, D, is against the patch's vector area: the normal
// of the holes that it would leave. There is one if
//   - the nearest way out is wrong somewhere: it leads against D, or there are islands; a plain press needs no way in,
//   - the patch is a cap rather than a tube: its vector area is above a quarter of its area (a ring around a finger has no way in),
//   - of what faces D at least three quarters leave the collider before the body ends, and not too far away (a bar's length is no way in).
// `input.points` is M at rest; `rest_mesh` gives M's triangles for ray casts and is asked for only when something is in collision.
std::vector<WayIn> ways_in(Executor& executor, const CollideInput& input, std::span<const uint32_t> triangles,
                           FunctionRef<const MeshDistance&()> rest_mesh);

// Per collider how far, and where, it stands back when the loop begins, in M's local space; zero where it begins in its place. Empty: all do.
std::vector<Vec3d> stand_back(Executor& executor, const CollideInput& input, std::span<const uint32_t> triangles,
                              FunctionRef<const MeshDistance&()> rest_mesh);

}  // namespace knead
