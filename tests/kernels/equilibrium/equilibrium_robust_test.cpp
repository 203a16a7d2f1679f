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
namespace equilibrium_robust_test {

using namespace pressed_bodies;

TEST(EquilibriumRobust, TakesSurfacesOfEveryKind) {
  const Surface sphere = make_sphere(1, 2);
  std::mt19937 random(3);
  const std::map<std::string, Surface> surfaces{{"open", mended(sphere, [](auto&, auto& t) { t.resize(t.size() * 3 / 4); })},
                                                {"inside out", mended(sphere, [](auto&, auto& t) { std::reverse(t.begin(), t.end()); })},
                                                {"mixed", mended(sphere, [](auto&, auto& t) { std::reverse(t.begin(), t.begin() + 150); })},
                                                {"soup", mended(sphere,
                                                                [&](auto& p, auto& t) {
                                                                  std::uniform_real_distribution<float> at(-1, 1);
                                                                  p.clear(), t.clear();
                                                                  for (uint32_t i = 0; i < 180; ++i)
                                                                    p.push_back({at(random), at(random), at(random)}), t.push_back(i);
                                                                })},
                                                {"flat", mended(sphere,
                                                                [](auto& p, auto&) {
                                                                  for (Vec3f& v : p) v.y *= 1e-6f;
                                                                })},
                                                {"shells", mended(sphere,
                                                                  [](auto& p, auto& t) {
                                                                    const size_t n = p.size(), m = t.size();
                                                                    for (size_t i = 0; i < n; ++i)
                                                                      p.push_back(0.5f * p[i]), p.push_back(p[i] + Vec3f{2.5f, 0, 0});
                                                                    for (size_t c = 0; c < m; ++c)
                                                                      t.push_back(static_cast<uint32_t>(n + 2 * t[m - 1 - c]));
                                                                    for (size_t c = 0; c < m; ++c)
                                                                      t.push_back(static_cast<uint32_t>(n + 2 * t[c] + 1));
                                                                  })},
                                                {"slivers and repeats", mended(sphere, [](auto& p, auto& t) {
                                                   for (size_t i = 0; i + 1 < p.size(); i += 5) p[i] = p[i + 1];
                                                   t.insert(t.end(), {3, 3, 4, 7, 7, 7});
                                                 })}};
  const Sdf above = ball(0.5, {0.05, 1.2, 0.02}), through = ball(0.5, {0.05, 0.1, 0.02});
  for (const auto& [name, surface] : surfaces) {
    EquilibriumMaterial material;
    material.contact_samples = name == "open" ? 3 : 0;
    Pressed pressed(surface, material);
    pressed.settings.max_iterations = 40;
    pressed.by({&above}, name);
    pressed.by({&through}, name + ", from within");
  }
}

TEST(EquilibriumRobust, TakesTinyHugeAndFarBodies) {
  for (const double size : {1e-4, 1e4}) {
    const Vec3d at{1e6 * size, -1e6 * size, 1e6 * size};
    Surface surface = make_sphere(1, 2);
    surface.placement.scale = size;
    surface.placement.translation = at;
    const Sdf collider = ball(0.5, at + size * Vec3d{0, 1.3, 0}, size);
    Pressed pressed(surface);
    pressed.by({&collider}, "size " + std::to_string(size));
    EXPECT_EQ(pressed.figures.ended, Ended::kAtRest) << size;
  }
}

TEST(EquilibriumRobust, TakesCollidersThatSwallowOrMissOrSqueeze) {
  Pressed pressed(make_sphere(1, 2));
  pressed.settings.max_iterations = 40;
  const Sdf swallows = ball(3, {0.2, 0, 0}), misses = ball(0.5, {9, 0, 0}), upper = ball(1, {0, 1.5, 0}), lower = ball(1, {0, -1.5, 0});
  pressed.by({&swallows}, "swallowed", 3);
  EXPECT_NE(pressed.figures.ended, Ended::kAtRest);
  pressed.by({&upper, &lower, &misses}, "squeezed");
  pressed.by({&upper, &upper}, "twice the same");
  pressed.by({}, "none");
  EXPECT_EQ(pressed.figures.ended, Ended::kNoContact);
  pressed.by({&misses}, "missed");
  EXPECT_EQ(pressed.figures.ended, Ended::kNoContact);
  EXPECT_EQ(pressed.tets.id(), pressed.built.tets.rest.id());
}

// The ball goes down by 1/1000 of the diagonal a frame. Without a gap the largest second difference here is 12 % of a step.
TEST(EquilibriumRobust, IsSmoothInTime) {
  const Surface body = make_sphere(1, 4);
  Pressed pressed(body, {}, 4);
  const double step = 1e-3 * body.diagonal();
  std::vector<std::vector<Vec3f>> frames;
  for (int frame = 0; frame < 8; ++frame) {
    const Sdf above = ball(0.5, {0.05, 1.15 - step * frame, 0.02});
    pressed.by({&above}, "frame " + std::to_string(frame));
    EXPECT_EQ(pressed.figures.ended, Ended::kAtRest);
    frames.emplace_back(pressed.points.host().begin(), pressed.points.host().end());
  }
  float most = 0;
  for (size_t f = 1; f + 1 < frames.size(); ++f)
    for (size_t i = 0; i < frames[f].size(); ++i) most = std::max(most, length(frames[f - 1][i] - 2.0f * frames[f][i] + frames[f + 1][i]));
  EXPECT_LT(static_cast<double>(most), 0.025 * step);
}

// Between two balls that leave a third of it: a metric of the shape at rest does not get there in 150.
TEST(EquilibriumRobust, ItsMetricFollowsTheShape) {
  Pressed pressed(make_sphere(1, 4), {}, 5);
  const Sdf above = ball(1.2, {0, 1.5, 0}), below = ball(1.2, {0, -1.5, 0});
  pressed.by({&above, &below}, "crush");
  EXPECT_EQ(pressed.figures.ended, Ended::kAtRest);
  EXPECT_LT(pressed.figures.iterations, 75);
}

// What the rule of rest leaves, in the mean over M: a part of the diagonal.
TEST(EquilibriumRobust, IsNearlyThereWhenItSaysRest) {
  Pressed pressed(make_sphere(1, 3), {}, 4);
  const Sdf above = ball(0.5, {0.05, 1.15, 0.02});
  pressed.by({&above}, "default rule");
  EXPECT_EQ(pressed.figures.ended, Ended::kAtRest);
  const std::vector<Vec3f> at_rest(pressed.points.host().begin(), pressed.points.host().end());
  pressed.settings.threshold = 1e-6;
  pressed.settings.displacement = pressed.settings.penetration = 0;
  pressed.settings.max_iterations = 400;
  pressed.by({&above}, "far beyond it");
  double squares = 0;
  for (size_t i = 0; i < at_rest.size(); ++i) squares += std::pow(static_cast<double>(length(at_rest[i] - pressed.points.host()[i])), 2);
  const double off = std::sqrt(squares / static_cast<double>(at_rest.size())) / pressed.built.lattice.rest.diagonal();
  EXPECT_LT(off, 1e-5);
}

// A contact is as stiff as its share of the area, and one with hardly any would hold up all others.
TEST(EquilibriumRobust, VerticesOfNoTriangleSettleAsSoonAsOthers) {
  const Surface loose = mended(make_sphere(1, 3), [](auto& p, auto&) {
    for (int k = -3; k <= 3; ++k) p.push_back({0.08f * static_cast<float>(k), 0.99f, 0.05f});
  });
  Pressed pressed(loose, {}, 4);
  const Sdf above = ball(0.5, {0.05, 1.3, 0.02});
  pressed.by({&above}, "vertices of no triangle");
  EXPECT_EQ(pressed.figures.ended, Ended::kAtRest);
  EXPECT_LT(pressed.figures.iterations, 60);
}

// Under a ball that comes straight down, skin that clings does not go sideways.
TEST(EquilibriumRobust, ClingsWithFriction) {
  Pressed pressed(make_sphere(1, 3), {}, 3);
  const Sdf above = ball(0.5, {0, 1.15, 0});
  std::vector<double> slid;
  for (const double friction : {0.0, 0.3, 2.0}) {
    pressed.settings.friction = friction;
    pressed.by({&above}, "friction " + std::to_string(friction));
    EXPECT_EQ(pressed.figures.ended, Ended::kAtRest) << friction;
    EXPECT_GT(pressed.figures.least_volume, 0.3) << friction;
    double sum = 0;
    const auto rest = pressed.built.lattice.rest.points.host(), now = pressed.points.host();
    for (size_t i = 0; i < rest.size(); ++i)
      if (length(rest[i] - Vec3f{0, 1.15f, 0}) < 0.4f) sum += static_cast<double>(std::hypot(now[i].x - rest[i].x, now[i].z - rest[i].z));
    slid.push_back(sum);
  }
  EXPECT_LT(slid[1], 0.75 * slid[0]);
  EXPECT_LT(slid[2], 0.75 * slid[0]);
}

// A ball as wide as the body's radius goes in until it is out of sight. The shape follows it step by step as long as it is told, or can tell, where it came in.
TEST(EquilibriumRobust, FollowsABallThatIsSweptIn) {
  EquilibriumMaterial held;
  held.hold = 20;  // A free body lets so large a ball through: tets are inverted from y = 0.2 on.
  Pressed pressed(make_sphere(1, 3), held, 3);
  const double step = 0.1;
  for (const bool told : {false, true}) {
    pressed.settings.entry = told ? Vec3d{0, -1, 0} : Vec3d{0, 0, 0};
    pressed.settings.max_iterations = 300;
    std::vector<Vec3f> before;
    for (double y = 1.3; y > (told ? 0.2 : 0.58); y -= step) {
      const Sdf in = ball(0.5, {0.05, y, 0.02});
      pressed.by({&in}, "ball at " + std::to_string(y));
      EXPECT_EQ(pressed.figures.ended, Ended::kAtRest) << y;
      EXPECT_GT(pressed.figures.least_volume, 0.2) << y;
      EXPECT_EQ(pressed.figures.enclosed, 0u) << y;
      float most = 0;
      for (size_t i = 0; i < before.size(); ++i) most = std::max(most, length(pressed.points.host()[i] - before[i]));
      EXPECT_LT(static_cast<double>(most), 2 * step) << y;
      before.assign(pressed.points.host().begin(), pressed.points.host().end());
    }
  }
  pressed.settings.entry = {0, 0, 0};
  const Sdf inside = ball(0.5, {0.05, 0.3, 0.02});
  pressed.by({&inside}, "enclosed");
  EXPECT_EQ(pressed.figures.ended, Ended::kNoContact);
  EXPECT_EQ(pressed.figures.enclosed, 1u);
}

Sdf ring(double radius, double tube, const Vec3d& at) {
  const auto executor = make_serial_executor();
  SdfPlan plan;
  plan.voxel_size = tube / 6;
  plan.lower = {-radius - tube, -tube, -radius - tube};
  plan.upper = {radius + tube, tube, radius + tube};
  Sdf sdf = build_sdf(*executor, plan, [&](const Vec3d& p, uint32_t&) { return std::hypot(std::hypot(p.x, p.z) - radius, p.y) - tube; });
  sdf.placement.translation = at;
  return sdf;
}

// A ring that has cut off a cap of a ball: in steps as long as half its thickness flesh gets past its middle, or is let through.
TEST(EquilibriumRobust, ThinCollidersKeepTheFleshOnItsSide) {
  Pressed pressed(make_sphere(1, 4), {}, 4);
  for (const double tube : {0.06, 0.08, 0.1}) {
    const Sdf in = ring(0.4, tube, {0.1, 0.8, 0.05});
    pressed.by({&in}, "tube of " + std::to_string(tube));
    EXPECT_EQ(pressed.figures.ended, Ended::kAtRest) << tube;
    EXPECT_GT(pressed.figures.way_in, 0) << tube;
    EXPECT_LT(pressed.figures.iterations - pressed.figures.way_in, 100) << tube;  // 48 to 64 while vertices alone were kept outside, 66 to 82 now
    EXPECT_GT(pressed.figures.least_volume, 0.5) << tube;
    EXPECT_LT(pressed.figures.least_volume, 0.9) << tube << ": let through";
  }
}

// Many contacts on few vertices of H fill their memories slowly, unless they become stiff.
TEST(EquilibriumRobust, SettlesWhereHIsTooCoarseForItsContacts) {
  Pressed pressed(make_sphere(1, 5), {}, 3);
  const Sdf in = ball(0.3, {0.05, 1.2, 0.02});
  pressed.by({&in}, "coarse");
  EXPECT_EQ(pressed.figures.ended, Ended::kAtRest);
  EXPECT_LT(pressed.figures.iterations, 68);
}

// Told where it came in, flesh goes along with a ball, as far as it can; what it lets through in the end is counted.
TEST(EquilibriumRobust, CountsWhatItLetThroughOnTheWayIn) {
  Pressed pressed(make_sphere(1, 3), {}, 4);
  pressed.settings.entry = {0, -1, 0};
  for (const double y : {0.8, 0.6, 0.4, 0.2, 0.0}) {
    const Sdf in = ball(0.2, {0.05, y, 0.02});
    pressed.by({&in}, "ball at " + std::to_string(y));
    EXPECT_EQ(pressed.figures.enclosed, pressed.figures.contacts == 0 ? 1u : 0u) << y;
    if (y == 0.8) EXPECT_GT(pressed.figures.contacts, 0u);
  }
  EXPECT_EQ(pressed.figures.enclosed, 1u);
}

TEST(EquilibriumRobust, CountsCollidersWhoseSideCannotBeTold) {
  Pressed pressed(make_sphere(1, 3));
  const Sdf above = ball(0.5, {0, 1.2, 0}), around = ball(3, {0.1, 0, 0}), away = ball(0.5, {0, 4, 0});
  pressed.by({&above}, "a press");
  EXPECT_EQ(pressed.figures.undecided, 0u);
  pressed.by({&around}, "a body swallowed", 3);
  EXPECT_EQ(pressed.figures.undecided, 1u);
  pressed.by({&away}, "away");
  EXPECT_EQ(pressed.figures.undecided, 0u);
  EXPECT_EQ(pressed.figures.enclosed, 0u);
}

}  // namespace equilibrium_robust_test
}  // namespace knead
