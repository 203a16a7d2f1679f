// What the launchers of collide share.
#pragma once
#include "graph/executor.h"
#include "kernels/loop/collide.h"
#include "kernels/loop/collide_body.h"

namespace knead {

// The push without places to write to: colliders as seen from M, and what the vertices remember.
CollidePush make_push(Executor& executor, const CollideInput& input);

}  // namespace knead
