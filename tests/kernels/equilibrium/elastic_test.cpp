#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <vector>

#include "kernels/equilibrium/energy_simd.h"
#include "kernels/simd_level.h"

namespace knead {
namespace elastic_test {

// `count` tets with corners of their own, some sheared, stretched or turned inside out.
struct Tets {
  std::vector<Row4> u, forces;
  std::vector<uint32_t> corners;
  std::vector<float> shape, mu, lambda, guard;
  size_t stride;
  ElasticTerm term;

  Tets(size_t count, ElasticTerm which, float amount, uint32_t seed) : stride((count + 15) / 16 * 16), term(which) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<float> part(-1, 1);
    u.assign(4 * stride, {0, 0, 0, 0});
    forces.assign(4 * stride, {0, 0, 0, 0});
    corners.assign(4 * stride, 0);
    shape.assign(9 * stride, 0);
    mu.assign(stride, 0);
    lambda.assign(stride, 0);
    for (size_t t = 0; t < count; ++t) {
      const Vec3d e[3] = {
          {1 + 0.3 * part(random), 0.2 * part(random), 0.1}, {0.1, 1 + 0.3 * part(random), 0.2 * part(random)}, {0.2 * part(random), 0.1, 1}};
      const double over = 1 / dot(e[0], cross(e[1], e[2]));
      const Vec3d g[3] = {over * cross(e[1], e[2]), over * cross(e[2], e[0]), over * cross(e[0], e[1])};
      for (size_t c = 0; c < 3; ++c)
        for (int d = 0; d < 3; ++d)
          shape[(3 * c + static_cast<size_t>(d)) * stride + t] = static_cast<float>(term == ElasticTerm::kEdges ? e[c][d] : g[c][d]);
      for (size_t c = 0; c < 4; ++c) {
        corners[c * stride + t] = static_cast<uint32_t>(4 * t + c);
        u[4 * t + c] = {amount * part(random), amount * part(random), amount * part(random), 0};
      }
      mu[t] = 1 + 0.5f * part(random);
      lambda[t] = 10 + 5 * part(random);
    }
  }
  ElasticTets body() {
    return {u.data(), corners.data(), shape.data(), mu.data(), lambda.data(), forces.data(), stride, term, guard.empty() ? nullptr : guard.data()};
  }
};

class Elastic : public testing::TestWithParam<ElasticTerm> {};

TEST_P(Elastic, HasTheGradientOfItsEnergy) {
  for (const float amount : {0.01f, 0.1f, 0.25f}) {
    Tets tets(16, GetParam(), amount, 7);
    for (uint32_t t = 0; t < 16; ++t) {
      tets.body()(t);
      const std::vector<Row4> forces = tets.forces;
      for (size_t c = 0; c < 4; ++c) {
        const Row4 force = forces[c * tets.stride + t];
        for (int d = 0; d < 3; ++d) {
          float& at = (&tets.u[4 * t + c].x)[d];
          const float was = at, h = 0.02f * std::max(amount, 0.05f);
          // Fourth order, since float32 leaves no room for a small step.
          double e[4];
          const float places[4] = {-2 * h, -h, h, 2 * h};
          for (int k = 0; k < 4; ++k) {
            at = was + places[k];
            e[k] = static_cast<double>(tets.body()(t).energy);
          }
          at = was;
          const double slope = (e[0] - 8 * e[1] + 8 * e[2] - e[3]) / (12.0 * static_cast<double>(h));
          EXPECT_NEAR((&force.x)[d], slope, 2e-3 * (0.05 + std::abs(slope)))
              << "tet " << t << " corner " << c << " axis " << d << " amount " << amount;
        }
      }
    }
  }
}

// With a guard only where a tet is nearly flat.
TEST_P(Elastic, HasTheGradientOfItsGuardWhereATetIsNearlyFlat) {
  if (GetParam() == ElasticTerm::kEdges) GTEST_SKIP() << "springs have no guard";
  Tets tets(1, GetParam(), 0, 5);
  for (size_t c = 0; c < 3; ++c)
    for (size_t d = 0; d < 3; ++d) tets.shape[(3 * c + d) * tets.stride] = c == d ? 1.0f : 0.0f;
  for (const float squash : {0.5f, 0.8f, 1.1f}) {  // J = 1 - squash
    tets.u[3] = {0, 0, -squash, 0};
    tets.guard.clear();
    const float without = tets.body()(0).energy, force = tets.forces[3 * tets.stride].z;
    tets.guard.assign(tets.stride, 20);
    const float over = std::min(0.0f, 1 - squash - ElasticTets::kGuarded);
    EXPECT_NEAR(tets.body()(0).energy - without, 10 * over * over, 1e-4);
    EXPECT_NEAR(tets.forces[3 * tets.stride].z - force, 20 * over, 1e-4);
  }
}

TEST_P(Elastic, IsExactlyZeroAtRestAndUnderTranslation) {
  Tets tets(16, GetParam(), 0, 3);
  for (const float offset : {0.0f, 0.75f}) {
    for (Row4& u : tets.u) u = {offset, -offset, 2 * offset, 0};
    for (uint32_t t = 0; t < 16; ++t) {
      EXPECT_EQ(tets.body()(t).energy, 0.0f);
      for (size_t c = 0; c < 4; ++c) EXPECT_EQ(tets.forces[c * tets.stride + t].x, 0.0f);
    }
  }
}

TEST_P(Elastic, DoesNotSeeARotation) {
  // One tet at its rest shape, turned by 40 degrees about z: u = (R - I) x.
  Tets tets(1, GetParam(), 0, 5);
  const Vec3d corners[4] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  for (size_t c = 0; c < 3; ++c)
    for (size_t d = 0; d < 3; ++d) tets.shape[(3 * c + d) * tets.stride] = c == d ? 1.0f : 0.0f;
  const double angle = 0.7, cosine = std::cos(angle), sine = std::sin(angle);
  for (size_t c = 0; c < 4; ++c) {
    const Vec3d& x = corners[c];
    tets.u[c] = {static_cast<float>((cosine - 1) * x.x - sine * x.y), static_cast<float>(sine * x.x + (cosine - 1) * x.y), 0, 0};
  }
  const auto result = tets.body()(0);
  EXPECT_NEAR(result.energy, 0, 1e-5);
  EXPECT_NEAR(result.volume, 1, 1e-5);
  for (size_t c = 0; c < 4; ++c) EXPECT_NEAR(length(to_vec(tets.forces[c * tets.stride])), 0, 2e-5);
}

TEST_P(Elastic, HasLamesModuliAtRest) {
  // Small strains of the unit tet: energy mu |eps|^2 + lambda/2 tr(eps)^2 per volume; springs have other moduli in shear, so only the volume part is
  // theirs.
  if (GetParam() == ElasticTerm::kEdges) GTEST_SKIP() << "springs are not isotropic";
  const double mu = 1.5, lame = 4;
  const float strain = 0.01f;
  Tets tets(1, GetParam(), 0, 5);
  for (size_t c = 0; c < 3; ++c)
    for (size_t d = 0; d < 3; ++d) tets.shape[(3 * c + d) * tets.stride] = c == d ? 1.0f : 0.0f;
  tets.mu[0] = static_cast<float>(mu);
  tets.lambda[0] = static_cast<float>(GetParam() == ElasticTerm::kStableNeoHookean ? lame + mu : lame);
  tets.u[1] = {strain, 0, 0, 0};
  EXPECT_NEAR(tets.body()(0).energy / (strain * strain), mu + lame / 2, 0.05);
  tets.u[1] = {0, strain / 2, 0, 0};
  tets.u[2] = {strain / 2, 0, 0, 0};
  EXPECT_NEAR(tets.body()(0).energy / (strain * strain), mu / 2, 0.02);
}

TEST_P(Elastic, IsTheSameInEveryInstructionSet) {
  Tets tets(100, GetParam(), 0.2f, 11);
  const ElasticSum plain = energy_simd_scalar()->elastic(tets.body(), 0, static_cast<uint32_t>(tets.stride));
  const std::vector<Row4> forces = tets.forces;
  const struct {
    SimdLevel level;
    const EnergySimd* lanes;
  } all[] = {{SimdLevel::kBaseline, energy_simd_baseline()}, {SimdLevel::kAvx2, energy_simd_avx2()}, {SimdLevel::kAvx512, energy_simd_avx512()}};
  for (const auto& [level, lanes] : all) {
    const auto levels = simd_levels();
    if (!lanes || std::find(levels.begin(), levels.end(), level) == levels.end()) continue;
    const ElasticSum sum = lanes->elastic(tets.body(), 0, static_cast<uint32_t>(tets.stride));
    EXPECT_NEAR(sum.energy, plain.energy, 1e-5 * plain.energy) << name_of(level);
    EXPECT_NEAR(sum.least_volume, plain.least_volume, 1e-5) << name_of(level);
    for (size_t i = 0; i < forces.size(); ++i)
      EXPECT_NEAR(length(to_vec(tets.forces[i]) - to_vec(forces[i])), 0, 1e-4) << name_of(level) << " row " << i;
  }
}

INSTANTIATE_TEST_SUITE_P(Terms, Elastic, testing::Values(ElasticTerm::kEdges, ElasticTerm::kCorotated, ElasticTerm::kStableNeoHookean));

}  // namespace elastic_test
}  // namespace knead
