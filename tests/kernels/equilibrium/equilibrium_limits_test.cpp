// What the equilibrium does not depend on, and what it refuses.
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <cstring>
#include <functional>
#include <map>
#include <numeric>
#include <random>

#include "graph/error.h"
#include "tests/kernels/equilibrium/pressed_bodies.h"

namespace knead {
namespace equilibrium_limits_test {

using namespace pressed_bodies;

TEST(EquilibriumLimits, TakesPinsEverywhereAndNothingThatHolds) {
  const Surface sphere = make_sphere(1, 2);
  const Sdf collider = ball(0.5, {0, 1.2, 0}), other = ball(0.5, {0, -1.2, 0});
  const Buffer<float> pins(std::vector<float>(sphere.vertices(), 1.0f));
  EquilibriumMaterial pinned;
  pinned.pins = &pins;
  Pressed stays(sphere, pinned);
  stays.settings.max_iterations = 30;
  stays.by({&collider}, "pinned");
  EXPECT_EQ(std::memcmp(stays.points.host().data(), sphere.points.host().data(), sphere.points.bytes()), 0);
  EXPECT_NE(stays.figures.ended, Ended::kAtRest) << "the collider is still inside";
  EquilibriumMaterial free;
  free.hold = 0;
  Pressed floats(sphere, free);
  floats.by({&collider}, "free");
  floats.by({&collider, &other}, "held by colliders alone");
}

TEST(EquilibriumLimits, DoesNotDependOnTheOrderOfVerticesAndFaces) {
  const Surface sphere = make_sphere(1, 2);
  const Sdf collider = ball(0.5, {0.1, 1.2, 0.05});
  std::vector<uint32_t> to(sphere.vertices());
  std::iota(to.begin(), to.end(), 0u);
  std::mt19937 random(5);
  std::shuffle(to.begin(), to.end(), random);
  const Surface shuffled = mended(sphere, [&](auto& p, auto& t) {
    for (size_t i = 0; i < to.size(); ++i) p[to[i]] = sphere.points.host()[i];
    for (uint32_t& v : t) v = to[v];
    std::rotate(t.begin(), t.begin() + 99, t.end());
  });
  Pressed plain(sphere), other(shuffled);
  plain.by({&collider}, "as made");
  other.by({&collider}, "shuffled");
  for (size_t i = 0; i < to.size(); ++i) ASSERT_LT(length(plain.points.host()[i] - other.points.host()[to[i]]), 2e-4f) << i;
}

TEST(EquilibriumLimits, TurnsWithItsScene) {
  Surface surface = make_sphere(1, 2);
  const Vec3d at{0.1, 1.2, 0.05};
  Pressed plain(surface);
  const Sdf collider = ball(0.5, at);
  plain.by({&collider}, "as made");
  Similarity turn;  // by 90 degrees about z and then moved: the same numbers in other places
  turn.rotation = {0, -1, 0, 1, 0, 0, 0, 0, 1};
  turn.translation = {3, -5, 7};
  surface.placement = turn;
  Pressed turned(surface);
  const Sdf other = ball(0.5, turn.apply(at));
  turned.by({&other}, "turned");
  for (size_t i = 0; i < surface.vertices(); ++i) ASSERT_LT(length(plain.points.host()[i] - turned.points.host()[i]), 2e-4f) << i;
}

// H may lie turned in M's local space.
TEST(EquilibriumLimits, TakesATetSpaceThatIsTurned) {
  const Surface sphere = make_sphere(1, 2);
  const Sdf collider = ball(0.5, {0.1, 1.2, 0.05});
  Pressed plain(sphere), turned(sphere);
  const std::array<double, 9> turn{0, -1, 0, 1, 0, 0, 0, 0, 1};
  Similarity& space = turned.built.tets.to_local;
  std::vector<Vec3f> places;
  for (const Vec3f& x : turned.built.tets.rest.host()) places.push_back({x.y, -x.x, x.z});  // the inverse turn
  turned.built.tets.rest = turned.built.lattice.tet_rest = Buffer<Vec3f>(places);
  space.rotation = turned.built.lattice.to_local.rotation = turn;
  turned.rest = prepare_equilibrium(*turned.executor, turned.built.tets, turned.built.lattice, {});
  plain.by({&collider}, "plain");
  const auto& s = turned.settings;
  const Buffer<Vec3f> moved =
      solve_equilibrium(*turned.executor, *turned.rest, sphere.placement, std::vector<const Sdf*>{&collider}, s, turned.figures);
  double most = 0;
  for (size_t v = 0; v < moved.size(); ++v) {
    const Vec3f x = moved.host()[v], there{-x.y, x.x, x.z};
    most = std::max(most, static_cast<double>(length(there - plain.tets.host()[v])) * space.scale);
  }
  EXPECT_LT(most, 2e-4);
}

TEST(EquilibriumLimits, RefusesAFactorAboveTheLimitBeforeMakingIt) {
  EquilibriumMaterial material;
  material.memory_limit = 1000;
  try {
    Pressed pressed(make_sphere(1, 2), material);
    FAIL() << "not refused";
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::kMemory);
    EXPECT_NE(std::string(error.what()).find("vertices"), std::string::npos) << error.what();
  }
}

TEST(EquilibriumLimits, StopsWhereverItIsCancelled) {
  const Surface sphere = make_sphere(1, 2);
  const Sdf collider = ball(0.5, {0, 1.2, 0});
  std::atomic<int> left = 1 << 30;
  const auto ask = [&] {
    if (left-- <= 0) throw Error(ErrorCode::kCancelled, "cancelled");
  };
  EquilibriumMaterial material;
  material.check_cancelled = ask;
  Pressed whole(sphere, material);
  const int asked_to_prepare = (1 << 30) - left;
  EXPECT_GE(asked_to_prepare, 3);
  for (int after = 0; after < asked_to_prepare; ++after) {
    left = after;
    EXPECT_THROW(Pressed(sphere, material), Error) << after;
  }
  whole.settings.check_cancelled = ask;
  for (const int after : {0, 1, 10}) {
    left = after;
    EXPECT_THROW(whole.by({&collider}, "cancelled"), Error) << after;
  }
}

}  // namespace equilibrium_limits_test
}  // namespace knead
