#include "tests/nodes/random_colliders.h"

namespace knead {

TEST(RandomCollidersSlow, TouchTheBodyIfTheyOverlapAndAsDeepAsTheyDo) {
  random_colliders::expect_contact_as_they_overlap(150, 2);
}

}  // namespace knead
