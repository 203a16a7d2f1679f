// On which side of the colliders each vertex of M belongs, decided from M at rest. A distance field knows only the nearest way out. For the tip of a nose that
// is past a thumb's middle, or in front of the thumb already, that way draws a spike of flesh through the thumb; the nose has to go back into the face.
#pragma once
#include <span>

#include "graph/executor.h"
#include "kernels/collide.h"

namespace knead {

class MeshDistance;

// M at rest falls into the vertices in collision, the largest piece of what is left of each shell, and islands, which vertices in collision cut off from it.
// Vertices in collision and the islands beside them form patches. A patch has an inward direction D, against its vector area: the normal of the hole that
// it would leave. It is pressed along D if it is a cap rather than a tube (vector area above a quarter of its area) and if at least three quarters of what
// faces D would come out of the colliders before the body ends, and not too far away. Then D times the body's thickness behind the patch is the way of its vertices, and its
// islands are trapped. `input.points` is M at rest; `rest_mesh` gives M's triangles for ray casts and is asked for only when something is in collision.
// Buffers are empty where no patch is pressed along a way.
struct ContactSides {
  Buffer<Vec3f> ways;        // [vertices] M's local space: unit direction times how far it may go; zero: the nearest way out
  Buffer<uint8_t> trapped;   // [vertices] not 0: an island's vertex, outside the colliders on their wrong side
};
ContactSides contact_sides(Executor& executor, const CollideInput& input, std::span<const uint32_t> triangles, FunctionRef<const MeshDistance&()> rest_mesh);

}  // namespace knead
