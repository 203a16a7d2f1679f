// The law of a contact and of friction by itself: each force is the slope of its energy, and what a contact at rest obeys however stiff the way there.
#include "kernels/equilibrium/contact_law.h"

#include <gtest/gtest.h>

#include <cmath>

namespace knead {
namespace contact_law_test {

struct Case {
  const char* name;
  ContactLaw law;
  double t;  // lambda - phi
};

// The interior of each branch, both ends of the gap from either side, and far on both sides. Finite differences span a kink of the slope only.
constexpr Case kCases[] = {
    {"far away", {0.1f, 0.5f}, -1e3},
    {"just outside the gap", {0.1f, 0.5f}, -0.11},
    {"at the gap's beginning", {0.1f, 0.5f}, -0.1},
    {"just inside the gap", {0.1f, 0.5f}, -0.09},
    {"at touch", {0.1f, 0.5f}, 0},
    {"within a gentle gap", {0.1f, 0.03f}, -0.02},
    {"within a gap that is straight", {0.1f, 1.0f}, -0.02},
    {"within a steep gap", {0.1f, 2.0f}, 0.05},
    {"at the end of a gap", {0.1f, 0.5f}, 0.05},
    {"beyond the gap", {0.1f, 0.5f}, 0.3},
    {"far inside", {0.1f, 0.5f}, 40},
    {"no gap, away", {0, 1}, -0.1},
    {"no gap, inside", {0, 1}, 0.3},
    {"no gap and not gentle at all, inside", {0, 1e6f}, 0.3},
    {"a gap like nothing", {1e-6f, 0.5f}, 0.3},
};

TEST(ContactLaw, ForceAndSlopeAreDerivatives) {
  for (const Case& c : kCases) {
    const double size = std::max(0.1, std::abs(c.t)), step = 2e-3 * size;
    const auto low = c.law.at(static_cast<float>(c.t - step)), high = c.law.at(static_cast<float>(c.t + step)),
               at = c.law.at(static_cast<float>(c.t));
    EXPECT_NEAR((static_cast<double>(high.energy) - static_cast<double>(low.energy)) / (2 * step), static_cast<double>(at.force), 5e-3 * size)
        << c.name;
    EXPECT_NEAR((static_cast<double>(high.force) - static_cast<double>(low.force)) / (2 * step), static_cast<double>(at.slope), 0.04) << c.name;
    EXPECT_GE(at.force, 0) << c.name;
    EXPECT_GE(at.energy, 0) << c.name;
  }
}

TEST(ContactLaw, ForceGrowsWithoutAJumpOrAStepBack) {
  for (const float gentle : {0.03f, 0.5f, 1.0f, 2.0f}) {
    const ContactLaw law{0.1f, gentle};
    ContactForce before = law.at(-0.15f);
    for (double t = -0.15; t < 0.5; t += 1e-3) {
      const ContactForce at = law.at(static_cast<float>(t));
      ASSERT_GE(at.force, before.force) << gentle << " " << t;
      ASSERT_GE(at.energy, before.energy - 1e-7f) << gentle << " " << t;
      ASSERT_LT(at.force - before.force, 2e-3f) << gentle << " " << t;
      before = at;
    }
  }
}

TEST(ContactLaw, WithoutAGapIsThePlainOne) {
  const ContactLaw law{0, 1};
  EXPECT_EQ(law.at(-0.1f).force, 0);
  EXPECT_EQ(law.at(0.0f).force, 0);
  EXPECT_EQ(law.at(0.3f).force, 0.3f);
  EXPECT_FLOAT_EQ(law.at(0.3f).energy, 0.045f);
}

TEST(ContactLaw, HasNoForceForWhatIsNoNumber) {
  EXPECT_EQ((ContactLaw{0.1f, 0.5f}.at(std::nanf("")).force), 0);
}

// Filled multipliers (lambda = force) lie on one curve of force over distance, whatever the stiffness that got them there.
TEST(ContactLaw, AtRestIsTheSameForEveryStiffness) {
  const float gap = 0.1f, pressure = 2;
  for (const float stiffness : {5.0f, 20.0f, 40.0f, 600.0f}) {
    const ContactLaw law{gap, pressure / (gap * stiffness)};
    for (const float phi : {0.0f, 0.01f, 0.05f, 0.09f}) {
      float lambda = 0;
      for (int round = 0; round < 20000; ++round) lambda = law.at(lambda - phi).force;
      const double root = 1 - std::sqrt(static_cast<double>(phi / gap));
      EXPECT_NEAR(static_cast<double>(stiffness * lambda), static_cast<double>(pressure) * root * root, 0.01 * static_cast<double>(pressure))
          << stiffness << " " << phi;
    }
  }
}

TEST(FrictionLaw, IsASpringUpToItsBoundAlongTheSurface) {
  const Vec3f n{0, 0.6f, 0.8f};
  struct Held {
    const char* name;
    Vec3f away;
    float bound;
  };
  constexpr float kBound = 0.05f;
  for (const Held& c : {Held{"held", {0.02f, 0.01f, -0.03f}, kBound}, Held{"slides", {0.2f, -0.1f, 0.3f}, kBound},
                        Held{"has gone far", {30, -20, 5}, kBound}, Held{"has not moved", {0, 0, 0}, kBound},
                        Held{"moved out only", {0, 0.6f, 0.8f}, kBound}, Held{"has no bound to speak of", {0.2f, -0.1f, 0.3f}, 0}}) {
    const FrictionForce at = friction_force(c.away, n, c.bound);
    const double size = std::max(1.0, static_cast<double>(length(c.away)));
    EXPECT_NEAR(static_cast<double>(dot(at.gradient, n)), 0, 1e-6 * size) << c.name << ": none across the surface";
    EXPECT_LE(static_cast<double>(length(at.gradient)), static_cast<double>(c.bound) * 1.00001) << c.name;
    const float step = static_cast<float>(1e-3 * size);
    const auto slope = [&](const Vec3f& d) {
      return static_cast<double>((friction_force(c.away + step * d, n, c.bound).energy - friction_force(c.away + -step * d, n, c.bound).energy) /
                                 (2 * step));
    };
    EXPECT_NEAR(slope({1, 0, 0}), static_cast<double>(at.gradient.x), 2e-4) << c.name;
    EXPECT_NEAR(slope({0, 1, 0}), static_cast<double>(at.gradient.y), 2e-4) << c.name;
    EXPECT_NEAR(slope({0, 0, 1}), static_cast<double>(at.gradient.z), 2e-4) << c.name;
  }
}

}  // namespace contact_law_test
}  // namespace knead
