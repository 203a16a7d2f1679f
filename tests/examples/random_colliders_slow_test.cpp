#include "tests/nodes/random_colliders.h"

namespace knead {

TEST(RandomCollidersSlow, TouchTheBodyIfTheyOverlapAndAsDeepAsTheyDo) {
  // Three are known not to be: a blade of 4e-4 that stands in the body is missed (docs/limits.md), and two wedges that are pressed in by an edge come to rest on
  // another side of the edge with many triangles than with few.
  random_colliders::expect_contact_as_they_overlap(150, 2, 3);
}

}  // namespace knead
