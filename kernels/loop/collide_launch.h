// What the launchers of collide share.
#pragma once
#include <vector>

#include "graph/executor.h"
#include "kernels/loop/collide.h"
#include "kernels/loop/collide_body.h"

namespace knead {

// The push without places to write to: colliders as seen from M, and what the vertices remember. `many` holds the colliders where they are more than the body
// takes along; it must stay.
struct ManyColliders {
  std::vector<PushCollider> here;
  Buffer<std::byte> there;  // in the memory of a device
};
CollidePush make_push(Executor& executor, const CollideInput& input, ManyColliders& many);

}  // namespace knead
