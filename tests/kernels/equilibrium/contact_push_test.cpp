// The push of a contact: its energy's slope, its slope's slope, and what a contact at rest obeys however stiff it is on the way there.
#include <gtest/gtest.h>

#include <cmath>

#include "kernels/equilibrium/contact_body.h"

namespace knead {
namespace contact_push_test {

ContactEnergy contact(float gap, float gentle) {
  ContactEnergy made{};
  made.gap = gap;
  made.gentle = gentle;
  return made;
}

TEST(ContactPush, IsTheSlopeOfItsEnergy) {
  for (const float gentle : {0.03f, 0.5f, 1.0f, 2.0f}) {
    const ContactEnergy c = contact(0.1f, gentle);
    const double step = 2e-3;
    for (double t = -0.15; t < 0.5; t += 0.0137) {
      const auto low = c.push_of(static_cast<float>(t - step)), high = c.push_of(static_cast<float>(t + step)), at = c.push_of(static_cast<float>(t));
      EXPECT_NEAR((static_cast<double>(high.energy) - static_cast<double>(low.energy)) / (2 * step), static_cast<double>(at.push), 5e-4)
          << gentle << " " << t;
      EXPECT_NEAR((static_cast<double>(high.push) - static_cast<double>(low.push)) / (2 * step), static_cast<double>(at.slope), 0.04)
          << gentle << " " << t;
    }
  }
}

TEST(ContactPush, WithoutAGapIsThePlainOne) {
  const ContactEnergy c = contact(0, 1);
  EXPECT_EQ(c.push_of(-0.1f).push, 0);
  EXPECT_EQ(c.push_of(0.0f).push, 0);
  EXPECT_EQ(c.push_of(0.3f).push, 0.3f);
  EXPECT_FLOAT_EQ(c.push_of(0.3f).energy, 0.045f);
}

// Filled memories (lambda = push) lie on one curve of force over distance, whatever the stiffness that got them there.
TEST(ContactPush, AtRestObeysOneLawForEveryStiffness) {
  const float gap = 0.1f, pressure = 2;
  for (const float stiffness : {5.0f, 20.0f, 40.0f, 600.0f}) {
    const ContactEnergy c = contact(gap, pressure / (gap * stiffness));
    for (const float phi : {0.0f, 0.01f, 0.05f, 0.09f}) {
      float lambda = 0;
      for (int round = 0; round < 20000; ++round) lambda = c.push_of(lambda - phi).push;
      const double root = 1 - std::sqrt(static_cast<double>(phi / gap));
      EXPECT_NEAR(static_cast<double>(stiffness * lambda), static_cast<double>(pressure) * root * root, 0.01 * static_cast<double>(pressure))
          << stiffness << " " << phi;
    }
  }
}

TEST(ContactPush, FrictionIsASpringUpToItsBoundAlongTheSurface) {
  const ContactEnergy c = contact(0, 1);
  const Vec3f n{0, 0.6f, 0.8f};
  const float bound = 0.05f, step = 1e-3f;
  for (const Vec3f& away : {Vec3f{0.02f, 0.01f, -0.03f}, Vec3f{0.2f, -0.1f, 0.3f}, Vec3f{0, 0.6f, 0.8f}}) {
    Vec3f pull{0, 0, 0}, unused{0, 0, 0};
    c.stick(away, n, bound, pull);
    EXPECT_NEAR(static_cast<double>(dot(pull, n)), 0, 1e-6) << "none across the surface";
    EXPECT_LE(static_cast<double>(length(pull)), static_cast<double>(bound) * 1.00001);
    const auto slope = [&](const Vec3f& d) {
      return static_cast<double>((c.stick(away + step * d, n, bound, unused) - c.stick(away + -step * d, n, bound, unused)) / (2 * step));
    };
    EXPECT_NEAR(slope({1, 0, 0}), static_cast<double>(pull.x), 2e-4);
    EXPECT_NEAR(slope({0, 1, 0}), static_cast<double>(pull.y), 2e-4);
    EXPECT_NEAR(slope({0, 0, 1}), static_cast<double>(pull.z), 2e-4);
  }
}

}  // namespace contact_push_test
}  // namespace knead
