// Any number of colliders: those that the body never comes near change nothing, and those that it comes near late are felt like the others.
#include "kernels/equilibrium/met_colliders.h"

#include <gtest/gtest.h>

#include <cstring>
#include <map>

#include "tests/kernels/equilibrium/pressed_bodies.h"
#include "tests/kernels/on_device.h"

namespace knead {
namespace met_colliders_test {

using pressed_bodies::ball;

struct Solved {
  std::vector<Vec3f> points;  // of H
  EquilibriumFigures figures;
};

class MetColliders : public testing::TestWithParam<const char*> {
 protected:
  void SetUp() override {
    executor_ = std::string(GetParam()) == "cpu" ? make_cpu_executor(2) : on_device::device_named(GetParam());
    KNEAD_NEEDS(executor_);
    std::vector<std::string> warnings;
    BuildTetsOptions options;
    options.max_depth = 3;
    options.min_depth = 3;
    built_ = build_tets(make_sphere(1, 3), options, *executor_on_host_, warnings);
  }

  Solved solve(const std::vector<Sdf>& colliders, EquilibriumMaterial material = {}) const {
    const bool far = executor_->device() != Device{};
    const auto rest = prepare_equilibrium(*executor_, built_.tets, built_.lattice, material);
    std::vector<Sdf> fields = colliders;
    std::map<uint64_t, Buffer<std::byte>> there;
    for (Sdf& sdf : fields) {
      if (!far) continue;
      Buffer<std::byte>& grid = there[sdf.grid.id()];
      if (!grid) grid = on_device::there(*executor_, sdf.grid);
      sdf.grid = grid;
    }
    std::vector<const Sdf*> pointers;
    for (const Sdf& sdf : fields) pointers.push_back(&sdf);
    EquilibriumSettings settings;
    settings.on_host = [&](size_t k) { return colliders[k]; };
    Solved solved;
    const Buffer<Vec3f> moved = solve_equilibrium(*executor_, *rest, built_.lattice.rest.placement, pointers, settings, solved.figures);
    solved.points = far ? on_device::back(*executor_, moved) : std::vector<Vec3f>(moved.host().begin(), moved.host().end());
    return solved;
  }

  static bool same_bits(const Solved& a, const Solved& b) {
    return a.points.size() == b.points.size() && std::memcmp(a.points.data(), b.points.data(), a.points.size() * sizeof(Vec3f)) == 0;
  }

  std::unique_ptr<Executor> executor_on_host_ = make_cpu_executor(2), executor_;
  BuiltTets built_;
};

// A ring of balls: `count` of them, three of which touch.
std::vector<Sdf> ring(size_t count) {
  std::vector<Sdf> balls{ball(0.3, {0, 1.15, 0}), ball(0.3, {1.15, 0.1, 0}), ball(0.3, {0, -0.2, 1.1})};
  for (size_t k = balls.size(); k < count; ++k) {
    Sdf one = balls[0];
    const double turn = 0.7 * static_cast<double>(k), away = 2.2 + 0.02 * static_cast<double>(k);
    one.placement.translation = {away * std::cos(turn), away * std::sin(turn), 0.3};
    balls.push_back(one);
  }
  return balls;
}

TEST_P(MetColliders, OfWhichManyAreFarGiveTheBitsOfThoseThatTouch) {
  const Solved few = solve(ring(3)), many = solve(ring(60));
  EXPECT_EQ(few.figures.ended, Ended::kAtRest);
  EXPECT_GT(few.figures.contacts, 10u);
  EXPECT_EQ(many.figures.contacts, few.figures.contacts);
  EXPECT_TRUE(same_bits(few, many));
}

// The body hangs by a thread: one ball drives it into another, which is more than its diameter away.
TEST_P(MetColliders, ThatTheBodyIsDrivenIntoHoldIt) {
  EquilibriumMaterial material;
  material.hold = 0.02;
  const std::vector<Sdf> driver{ball(0.8, {0, 0.6, 0})};
  std::vector<Sdf> both = driver;
  both.push_back(ball(0.2, {0.05, -2.15, 0}));
  const Solved free = solve(driver, material), held = solve(both, material);
  const auto lowest = [&](const Solved& solved) {
    float y = 1e30f;
    for (const Vec3f& p : solved.points) y = std::min(y, p.y);
    return static_cast<double>(y) * built_.lattice.to_local.scale;
  };
  ASSERT_LT(lowest(free), -1.95 - 0.2) << "it goes into the place of the other";
  EXPECT_GT(held.figures.contacts, free.figures.contacts);
  EXPECT_LT(held.figures.penetration, 1e-3);
  double nearest = 1e300;
  const Buffer<Vec3f> surface = map_to_surface(*executor_on_host_, Buffer<Vec3f>(held.points), built_.lattice);
  for (const Vec3f& p : surface.host()) nearest = std::min(nearest, length(to_double(p) - Vec3d{0.05, -2.15, 0}) - 0.2);
  EXPECT_GT(nearest, -0.01);
  EXPECT_LT(nearest, 0.01);
}

INSTANTIATE_TEST_SUITE_P(On, MetColliders, testing::Values("cpu", "fake", "cuda"));

}  // namespace met_colliders_test
}  // namespace knead
