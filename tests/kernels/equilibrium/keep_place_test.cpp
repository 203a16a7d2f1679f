// What neither pins nor the hold keep neither moves nor turns as a whole.
#include "kernels/equilibrium/keep_place.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <random>

#include "tests/kernels/equilibrium/pressed_bodies.h"

namespace knead {
namespace keep_place_test {

using namespace pressed_bodies;

// A bent row of cubes of tets, in `parts` parts that do not hang together.
struct Blocks {
  std::vector<std::array<uint32_t, 4>> corners;
  std::vector<Vec3d> rest;
  std::vector<double> mass;
  std::vector<uint8_t> held;

  Blocks(uint32_t parts, uint32_t length) {
    std::mt19937 random(7);
    std::uniform_real_distribution<double> some(0.2, 2);
    for (uint32_t k = 0; k < parts; ++k)
      for (uint32_t i = 0; i < length; ++i) {
        const uint32_t p = static_cast<uint32_t>(rest.size());
        if (i >= 3) corners.push_back({p - 3, p - 2, p - 1, p});
        rest.push_back({10.0 * k + some(random), 0.1 * i + some(random), some(random)});
      }
    for (size_t p = 0; p < rest.size(); ++p) mass.push_back(some(random));
    held.assign(rest.size(), 0);
  }
  FloatingParts parts() const { return floating_parts(corners, rest, mass, held); }
};

TEST(FloatingParts, AreWhatHangsTogetherAndIsNotHeld) {
  Blocks blocks(4, 50);
  blocks.held[50 + 49] = 1;  // the last vertex of the second
  const FloatingParts parts = blocks.parts();
  ASSERT_EQ(parts.count, 3u);
  const uint32_t expected[] = {0, FloatingParts::kNone, 1, 2};
  for (size_t p = 0; p < blocks.rest.size(); ++p) EXPECT_EQ(parts.of_vertex[p], expected[p / 50]) << p;
  EXPECT_EQ(parts.members.size(), 150u);
  for (const size_t first : {0, 50, 100, 150}) blocks.held[first] = 1;
  EXPECT_EQ(blocks.parts().count, 0u);
}

TEST(FloatingParts, SumEveryMemberOnceWhateverTheSize) {
  for (const uint32_t length : {4u, 32u, 33u, 1100u, 40000u}) {
    const FloatingParts parts = Blocks(2, length).parts();
    ASSERT_EQ(parts.tree.back().size(), parts.count + 1);
    ASSERT_LE(parts.tree.size(), FloatingParts::kMostRows);
    size_t terms = parts.members.size();
    for (const auto& offsets : parts.tree) {
      EXPECT_EQ(offsets.back(), terms);
      for (size_t k = 0; k + 1 < offsets.size(); ++k) EXPECT_LE(offsets[k + 1] - offsets[k], FloatingParts::kFan);
      terms = offsets.size() - 1;
    }
  }
}

TEST(FloatingParts, HaveTheInverseOfTheirInertia) {
  const Blocks blocks(2, 40);
  const FloatingParts parts = blocks.parts();
  for (uint32_t k = 0; k < parts.count; ++k) {
    const SixRows motions{parts.arms.data(), nullptr, nullptr}, momenta{parts.arms.data(), nullptr, parts.mass.data()};
    for (uint32_t a = 0; a < 6; ++a) {
      double factors[6] = {}, sums[6] = {};
      factors[a] = 1;
      std::vector<Row4> motion(blocks.rest.size());
      for (uint32_t p = 0; p < motion.size(); ++p) {
        motion[p] = to_row(motions.combined(factors, p));
        if (parts.of_vertex[p] == k) momenta.add_products(motion.data(), p, sums);
      }
      for (uint32_t b = 0; b < 6; ++b) {
        double product = 0;
        for (uint32_t c = 0; c < 6; ++c) product += parts.inverse[36 * size_t{k} + 6 * b + c] * sums[c];
        EXPECT_NEAR(product, a == b, 1e-5) << k << a << b;
      }
    }
  }
}

TEST(KeepPlace, InvertsSixBySix) {
  std::mt19937 random(2);
  std::uniform_real_distribution<double> some(-1, 1);
  for (int round = 0; round < 20; ++round) {
    double m[36], inverse[36];
    for (int k = 0; k < 36; ++k) m[k] = inverse[k] = k % 7 == 0 && round % 2 == 0 ? 0 : some(random);  // without a diagonal it needs pivots
    invert_six(inverse);
    for (int r = 0; r < 6; ++r)
      for (int c = 0; c < 6; ++c) {
        double product = 0;
        for (int k = 0; k < 6; ++k) product += m[6 * r + k] * inverse[6 * k + c];
        EXPECT_NEAR(product, r == c, 1e-9);
      }
  }
  double none[36] = {1, 2};
  invert_six(none);
  for (const double entry : none) EXPECT_EQ(entry, 0);
}

// How far the body as a whole has gone and turned, in parts of its size: by the sums that the conditions are made of.
struct Drift {
  double gone = 0, turned = 0;
  Drift(const BuiltTets& built, const Buffer<Vec3f>& moved, const EquilibriumMaterial& material) {
    std::vector<double> mass(built.tets.vertices(), 0);
    for (size_t t = 0; t < built.tets.tets.size(); ++t) {
      const double part = material.inside ? std::max(static_cast<double>(material.inside->host()[t]), material.outside_stiffness) : 1;
      for (const uint32_t v : built.tets.tets.host()[t]) mass[v] += 0.25 * part * static_cast<double>(built.tets.rest_volumes.host()[t]);
    }
    const auto rest = built.tets.rest.host(), now = moved.host();
    double all = 0, spread = 0;
    Vec3d centre{0, 0, 0}, move{0, 0, 0}, turn{0, 0, 0};
    for (size_t v = 0; v < mass.size(); ++v) {
      all += mass[v];
      centre += mass[v] * to_double(rest[v]);
    }
    centre = (1 / all) * centre;
    for (size_t v = 0; v < mass.size(); ++v) {
      const Vec3d r = to_double(rest[v]) - centre, u = to_double(now[v] - rest[v]);
      move += mass[v] * u;
      turn += mass[v] * cross(r, u);
      spread += mass[v] * dot(r, r);
    }
    gone = length(move) / all / std::sqrt(spread / all);
    turned = length(turn) / spread;
  }
};

// One collider against a body that nothing else holds: it is dented, not pushed away, and stays where it was.
TEST(KeepPlace, OfAFreeBodyAgainstOneCollider) {
  const Surface sphere = make_sphere(1, 3);
  const Sdf collider = ball(0.4, {0.25, 1.15, 0.1});
  for (const bool weighted : {false, true}) {
    const Pressed shape(sphere);
    EquilibriumMaterial material;
    if (weighted) material.inside = &shape.built.inside;
    Pressed pressed(sphere, material);
    pressed.by({&collider}, weighted ? "weighted" : "flesh throughout");
    EXPECT_EQ(pressed.figures.ended, Ended::kAtRest);
    EXPECT_LT(pressed.figures.iterations, 60);
    const Drift drift(pressed.built, pressed.tets, material);
    EXPECT_LT(drift.gone, 1e-5);
    EXPECT_LT(drift.turned, 1e-5);
    EquilibriumMaterial free = material;
    free.keep_place = false;
    free.hold = 0.1;
    Pressed pushed(sphere, free);
    pushed.by({&collider}, "pushed away");
    EXPECT_GT(Drift(pushed.built, pushed.tets, free).gone, 0.05) << "what there is to keep";
  }
}

// Two balls in one surface, of which one is pressed: it cannot push itself off the other, which stays as it is.
TEST(KeepPlace, OfEachPartByItself) {
  const Surface one = make_sphere(0.5, 2);
  const uint32_t count = static_cast<uint32_t>(one.vertices());
  const Surface two = mended(one, [&](auto& points, auto& triangles) {
    const size_t corners = triangles.size();
    for (uint32_t v = 0; v < count; ++v) points.push_back(points[v] + Vec3f{4, 0, 0});
    for (size_t c = 0; c < corners; ++c) triangles.push_back(triangles[c] + count);
  });
  Pressed pressed(two, {}, 5);
  const Sdf collider = ball(0.3, {0.1, 0.7, 0});
  pressed.by({&collider}, "one of two");
  EXPECT_EQ(pressed.figures.ended, Ended::kAtRest);
  const auto before = two.points.host(), after = pressed.points.host();
  float most[2] = {0, 0};
  Vec3f mean{0, 0, 0};
  for (uint32_t v = 0; v < 2 * count; ++v) {
    most[v / count] = std::max(most[v / count], length(after[v] - before[v]));
    if (v < count) mean += (1.0f / static_cast<float>(count)) * (after[v] - before[v]);
  }
  EXPECT_GT(most[0], 0.07f) << "a dent";
  EXPECT_LT(length(mean), 0.03f) << "not a body that is pushed away";
  EXPECT_LT(most[1], 0.02f * most[0]) << "no more than the enclosed volume, which is kept as a whole, asks for";
}

TEST(KeepPlace, ChangesNothingWherePinsOrTheHoldKeepTheBody) {
  const Surface sphere = make_sphere(1, 2);
  const Sdf collider = ball(0.4, {0.25, 1.15, 0.1});
  std::vector<float> low;
  for (const Vec3f& p : sphere.points.host()) low.push_back(p.y < -0.5f ? 1.0f : 0.0f);
  const Buffer<float> pins(low);
  for (const bool pinned : {false, true}) {
    EquilibriumMaterial material;
    if (pinned)
      material.pins = &pins;
    else
      material.hold = 5;
    std::vector<Vec3f> result[2];
    for (const bool keep : {false, true}) {
      material.keep_place = keep;
      Pressed pressed(sphere, material);
      pressed.by({&collider}, "held");
      result[keep].assign(pressed.points.host().begin(), pressed.points.host().end());
    }
    EXPECT_EQ(std::memcmp(result[0].data(), result[1].data(), result[0].size() * sizeof(Vec3f)), 0) << pinned;
  }
}

}  // namespace keep_place_test
}  // namespace knead
