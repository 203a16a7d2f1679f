#include "tests/nodes/random_colliders.h"

namespace knead {

// Many more of them: tests/examples/random_colliders_slow_test.cpp.
TEST(RandomColliders, TouchTheBodyIfTheyOverlapAndAsDeepAsTheyDo) {
  random_colliders::expect_contact_as_they_overlap(10, 1);
}

}  // namespace knead
