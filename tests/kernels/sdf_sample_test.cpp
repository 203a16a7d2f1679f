#include "kernels/sdf_sample.h"

#include <gtest/gtest.h>
#include <nanovdb/util/OpenToNanoVDB.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/Interpolation.h>
#include <openvdb/tools/LevelSetSphere.h>

#include <random>

namespace {

using knead::SdfSampler;
using knead::SdfView;
using knead::Vec3d;
using knead::Vec3f;

// A sphere of radius 12.3 voxels with a band of 4 on both sides.
struct SampledSphere {
  openvdb::FloatGrid::Ptr grid;
  nanovdb::GridHandle<nanovdb::HostBuffer> blob;
  SdfView view;

  SampledSphere() {
    openvdb::initialize();
    grid = openvdb::tools::createLevelSetSphere<openvdb::FloatGrid>(12.3f, openvdb::Vec3f(0.4f, -0.3f, 0.2f), 1.0f, 4.0f);
    blob = nanovdb::openToNanoVDB(*grid);
    view = {blob.grid<float>(), {-18, -18, -18}, {18, 18, 18}};
  }
};

TEST(SdfSample, AgreesWithOpenVdbsOwnSamplerAcrossLeavesAndTiles) {
  const SampledSphere sphere;
  std::mt19937 random(7);
  std::uniform_real_distribution<float> coordinate(-17, 17);
  const auto accessor = sphere.grid->getConstAccessor();
  for (int i = 0; i < 20000; ++i) {
    const Vec3f p{coordinate(random), coordinate(random), coordinate(random)};
    const float oracle = openvdb::tools::BoxSampler::sample(accessor, openvdb::Vec3d(p.x, p.y, p.z));
    SdfSampler sampler(sphere.view);
    Vec3f gradient;
    ASSERT_NEAR(sampler.value(p), oracle, 2e-6f) << p.x << ' ' << p.y << ' ' << p.z;
    ASSERT_EQ(sampler.value(p), sampler.value_and_gradient(p, gradient));
  }
}

TEST(SdfSample, IsTheDistanceToASphereInsideTheBand) {
  const SampledSphere sphere;
  std::mt19937 random(8);
  std::normal_distribution<float> normal;
  std::uniform_real_distribution<float> radius(11.1f, 13.5f);  // where neither gradient sees the ends of the band
  for (int i = 0; i < 5000; ++i) {
    Vec3f n{normal(random), normal(random), normal(random)};
    n = n * (1 / length(n));
    const float r = radius(random);
    const Vec3f p = n * r + Vec3f{0.4f, -0.3f, 0.2f};
    SdfSampler sampler(sphere.view);
    Vec3f gradient;
    ASSERT_NEAR(sampler.value_and_gradient(p, gradient), r - 12.3f, 0.05f);
    ASSERT_GT(dot(gradient, n), 0.95f);  // that of the interpolant is off by half a voxel's turn
    const Vec3f smooth = sampler.smooth_gradient(p);
    ASSERT_GT(dot(smooth, n), 0.995f);
    ASSERT_NEAR(length(smooth), 1, 0.02f);
  }
}

TEST(SdfSample, GradientIsTheSlopeOfTheInterpolant) {
  const SampledSphere sphere;
  std::mt19937 random(9);
  std::uniform_real_distribution<float> coordinate(-9, 9), inside(0.1f, 0.9f);
  for (int i = 0; i < 2000; ++i) {
    const Vec3f p{std::floor(coordinate(random)) + inside(random), std::floor(coordinate(random)) + inside(random),
                  std::floor(coordinate(random)) + inside(random)};
    SdfSampler sampler(sphere.view);
    Vec3f gradient;
    sampler.value_and_gradient(p, gradient);
    const float h = 0.05f;
    for (int k = 0; k < 3; ++k) {
      Vec3f a = p, b = p;
      a[k] -= h;
      b[k] += h;
      ASSERT_NEAR(gradient[k], (sampler.value(b) - sampler.value(a)) / (2 * h), 1e-3f);
    }
  }
}

TEST(SdfSample, SmoothGradientDoesNotJumpWhereAVoxelEnds) {
  const SampledSphere sphere;
  SdfSampler sampler(sphere.view);
  for (float y = -8; y < 8; y += 0.37f) {
    const Vec3f before = sampler.smooth_gradient({8 - 1e-4f, y, 3.3f}), after = sampler.smooth_gradient({8 + 1e-4f, y, 3.3f});
    EXPECT_LT(length(before - after), 1e-3f);
  }
}

double spline(double t) {  // the quadratic one, of degree 0 to 1.5
  const double a = std::abs(t);
  return a < 0.5 ? 0.75 - a * a : a < 1.5 ? 0.5 * (1.5 - a) * (1.5 - a) : 0;
}

TEST(SdfSample, SplineIsThatOfTheVoxelsAround) {
  const SampledSphere sphere;
  std::mt19937 random(10);
  std::uniform_real_distribution<double> coordinate(-16, 16);
  const auto accessor = sphere.grid->getConstAccessor();
  const auto value = [&](const Vec3d& p) {
    double sum = 0;
    for (int i = static_cast<int>(p.x) - 3; i <= p.x + 3; ++i)
      for (int j = static_cast<int>(p.y) - 3; j <= p.y + 3; ++j)
        for (int k = static_cast<int>(p.z) - 3; k <= p.z + 3; ++k)
          sum += spline(p.x - i) * spline(p.y - j) * spline(p.z - k) * static_cast<double>(accessor.getValue({i, j, k}));
    return sum;
  };
  for (int i = 0; i < 3000; ++i) {
    const Vec3d p{coordinate(random), coordinate(random), coordinate(random)};
    SdfSampler sampler(sphere.view);
    Vec3f gradient;
    ASSERT_NEAR(static_cast<double>(sampler.spline(p, gradient)), value(p), 5e-6) << p.x << ' ' << p.y << ' ' << p.z;
    for (int k = 0; k < 3; ++k) {
      Vec3d a = p, b = p;
      a[k] -= 1e-3;
      b[k] += 1e-3;
      ASSERT_NEAR(static_cast<double>(gradient[k]), (value(b) - value(a)) / 2e-3, 1e-3);
    }
  }
}

TEST(SdfSample, NoSurfaceIsNearerThanTheLeast) {
  SampledSphere sphere;
  sphere.view.voxel = 1;
  std::mt19937 random(11);
  std::uniform_real_distribution<float> coordinate(-40, 40);
  float largest = 0;
  for (int i = 0; i < 20000; ++i) {
    const Vec3f p{coordinate(random), coordinate(random), coordinate(random)};
    SdfSampler sampler(sphere.view);
    const float least = sampler.least(p), distance = length(p - Vec3f{0.4f, -0.3f, 0.2f}) - 12.3f;
    ASSERT_LE(least, std::max(distance, -4.0f) + 0.01f) << p.x << ' ' << p.y << ' ' << p.z;
    if (distance > 0) largest = std::max(largest, least / distance);
    Vec3f gradient;
    ASSERT_EQ(sampler.reaches(p, 1), sampler.least(p) < 1);
    if (!sampler.reaches(p, 1)) {
      ASSERT_GE(sampler.spline(to_double(p), gradient), 1);
    }
  }
  EXPECT_GT(largest, 0.5f) << "far away it tells how far";
}

TEST(SdfSample, IsTheBackgroundOutsideAndForPositionsThatAreNotNumbers) {
  const SampledSphere sphere;
  SdfSampler sampler(sphere.view);
  Vec3f gradient;
  for (const Vec3f& p : {Vec3f{100, 0, 0}, Vec3f{-1e30f, 3e38f, 0}, Vec3f{NAN, 0, 0}, Vec3f{0, INFINITY, 0}, Vec3f{17, 17, 17}}) {
    EXPECT_EQ(sampler.value_and_gradient(p, gradient), 4.0f);
    EXPECT_EQ(length(gradient), 0);
    EXPECT_EQ(length(sampler.smooth_gradient(p)), 0);
  }
}

}  // namespace
