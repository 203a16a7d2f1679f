// The forces on the colliders, against the work that they do.
#include <gtest/gtest.h>

#include <cmath>

#include "tests/kernels/equilibrium/pressed_bodies.h"

namespace knead {
namespace contact_forces_test {

using namespace pressed_bodies;

double energy_at(Pressed& pressed, const Vec3d& at) {
  const Sdf collider = ball(0.4, at);
  pressed.by({&collider}, "pressed");
  return pressed.figures.energy;
}

// At rest the energy changes by the force times the collider's way, whatever holds the body.
TEST(ContactForces, AreTheEnergysDerivativeByTheCollidersPlace) {
  const Vec3d at{0.3, 1.1, 0.1};
  constexpr double kStep = 0.01;
  Surface sphere = make_sphere(1, 3);
  for (const bool held : {false, true}) {
    EquilibriumMaterial material;
    material.keep_volume = false;
    material.hold = held ? 20 : 0;
    Pressed pressed(sphere, material, 4);
    pressed.settings.threshold = 3e-5;
    pressed.settings.penetration = 1e-5;
    energy_at(pressed, at);
    ASSERT_EQ(pressed.figures.forces.size(), 1u);
    const Vec3d force = pressed.figures.forces[0];
    EXPECT_GT(force.y, 0) << "the body pushes the ball away";
    const double cell = pressed.built.tets.to_local.scale, diagonal = sphere.diagonal() / cell, young = 2 * (1 + material.poisson_ratio);
    for (int axis = 0; axis < 3; ++axis) {
      Vec3d step{0, 0, 0};
      step[axis] = kStep;
      const double by = (energy_at(pressed, at + step) - energy_at(pressed, at - step)) / (2 * kStep / cell);
      EXPECT_NEAR(-by / (young * diagonal * diagonal), force[axis], 0.02 * length(force)) << held << axis;
    }
  }
}

// Turned and scaled with its scene: the same numbers, in world directions.
TEST(ContactForces, TurnWithTheSceneAndKnowNoUnits) {
  Surface sphere = make_sphere(1, 3);
  const Vec3d at{0.2, 1.15, 0.1};
  Pressed plain(sphere);
  energy_at(plain, at);
  const Vec3d force = plain.figures.forces[0];
  sphere.placement.rotation = {0, -1, 0, 1, 0, 0, 0, 0, 1};
  sphere.placement.scale = 3;
  sphere.placement.translation = {10, 0, 4};
  Pressed placed(sphere);
  const Sdf collider = ball(0.4, sphere.placement.apply(at), 3);
  placed.by({&collider}, "placed");
  const Vec3d turned = sphere.placement.rotate(force);
  EXPECT_LT(length(placed.figures.forces[0] - turned), 1e-3 * length(force));
}

TEST(ContactForces, AreToldByCollider) {
  Pressed pressed(make_sphere(1, 3), {}, 4);
  const Sdf above = ball(0.6, {0, 1.4, 0}), away = ball(0.5, {5, 0, 0}), below = ball(0.6, {0, -1.4, 0});
  pressed.by({&above, &away, &below}, "between two");
  ASSERT_EQ(pressed.figures.forces.size(), 3u);
  const Vec3d up = pressed.figures.forces[0], down = pressed.figures.forces[2];
  EXPECT_GT(up.y, 1e-3);
  EXPECT_LT(length(up + down), 0.1 * length(up)) << "H is not the same above and below";
  EXPECT_EQ(length(pressed.figures.forces[1]), 0);
  pressed.by({&away}, "nothing touches");
  EXPECT_EQ(pressed.figures.ended, Ended::kNoContact);
  EXPECT_TRUE(pressed.figures.forces.empty());
}

}  // namespace contact_forces_test
}  // namespace knead
