#include "kernels/loop/restore_volume.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cstring>

#include "graph/error.h"
#include "kernels/simd_level.h"
#include "tests/kernels/loop/loop_fixture.h"

namespace {

namespace fixture = knead::loop_fixture;
using knead::Buffer;
using knead::RestoreVolumeSettings;
using knead::SimdLevel;
using knead::TetMesh;
using knead::Vec3d;
using knead::Vec3f;

RestoreVolumeSettings one_full_step() {
  RestoreVolumeSettings settings;
  settings.relaxation = 1;
  settings.sweeps = 1;
  settings.max_step = 1e6;
  return settings;
}

// The step of one vertex by a dense solve in double: Tikhonov's rows below the weighted equations Base . delta = 6 V - 6 V0, by orthogonal decomposition.
Vec3d dense_volume_step(const TetMesh& mesh, const std::vector<Vec3f>& x, uint32_t vertex, double lambda, bool relative) {
  std::vector<Eigen::RowVector3d> rows;
  std::vector<double> right;
  const auto tets = mesh.tets.host();
  for (size_t t = 0; t < tets.size(); ++t)
    for (size_t corner = 0; corner < 4; ++corner) {
      if (tets[t][corner] != vertex) continue;
      // 6 V is affine in the corner's position: its gradient by differences of the exact determinant.
      const double now = fixture::six_volume(x, tets[t]), rest = fixture::six_volume(fixture::vector_of(mesh.rest), tets[t]);
      Eigen::RowVector3d gradient;
      for (int k = 0; k < 3; ++k) {
        std::array<Vec3d, 4> q;
        for (size_t v = 0; v < 4; ++v) q[v] = to_double(x[tets[t][v]]);
        q[corner][k] += 1;
        gradient(k) = dot(cross(q[1] - q[0], q[2] - q[0]), q[3] - q[0]) - now;
      }
      const double weight = relative ? 1 / std::sqrt(rest) : 1;
      rows.push_back(weight * gradient);
      right.push_back(weight * (rest - now));
    }
  double trace = 0;
  for (const auto& row : rows) trace += row.squaredNorm();
  Eigen::MatrixXd a(rows.size() + 3, 3);
  Eigen::VectorXd b = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(rows.size() + 3));
  for (size_t i = 0; i < rows.size(); ++i) {
    a.row(static_cast<Eigen::Index>(i)) = rows[i];
    b(static_cast<Eigen::Index>(i)) = right[i];
  }
  a.bottomRows(3) = std::sqrt(lambda * trace / 3) * Eigen::Matrix3d::Identity();
  const Eigen::Vector3d step = a.colPivHouseholderQr().solve(b);
  return {step(0), step(1), step(2)};
}

TEST(RestoreVolume, StepsAsTheDenseLeastSquaresSolution) {
  const auto executor = knead::make_serial_executor();
  const fixture::Scene scene = fixture::ball(0.4, 1, *executor);
  const Buffer<Vec3f> shaken = fixture::shaken(scene.tets.rest, 0.15f, 3);
  const std::vector<Vec3f> x = fixture::vector_of(shaken);
  for (const bool relative : {true, false})
    for (const double lambda : {1e-3, 0.03, 1.0}) {
      RestoreVolumeSettings settings = one_full_step();
      settings.regularisation = lambda;
      settings.relative = relative;
      const Buffer<Vec3f> moved = restore_volume(*executor, shaken, scene.tets, settings);
      for (uint32_t j = 0; j < x.size(); j += 3) {
        const Vec3d step = to_double(moved.host()[j]) - to_double(x[j]), oracle = dense_volume_step(scene.tets, x, j, lambda, relative);
        ASSERT_NEAR(length(step - oracle), 0, 2e-4 * (0.01 + length(oracle))) << "vertex " << j << ", lambda " << lambda << ", relative " << relative;
      }
    }
}

TEST(RestoreVolume, RestStaysAtRestToTheBit) {
  const auto executor = knead::make_cpu_executor(2);
  const fixture::Scene scene = fixture::ball(0.3, 1, *executor);
  const Buffer<Vec3f> same = restore_volume(*executor, scene.tets.rest, scene.tets, {});
  EXPECT_EQ(std::memcmp(same.host().data(), scene.tets.rest.host().data(), same.bytes()), 0);
}

TEST(RestoreVolume, CommutesWithRigidMotion) {
  const auto executor = knead::make_serial_executor();
  const fixture::Scene scene = fixture::ball(0.4, 1, *executor);
  const Buffer<Vec3f> x = fixture::shaken(scene.tets.rest, 0.1f, 5);
  const auto turned = [](const Vec3f& p) { return Vec3f{0.6f * p.x - 0.8f * p.y + 3, 0.8f * p.x + 0.6f * p.y - 2, p.z + 1}; };
  std::vector<Vec3f> moved;
  for (const Vec3f& p : x.host()) moved.push_back(turned(p));
  const Buffer<Vec3f> a = restore_volume(*executor, x, scene.tets, {}), b = restore_volume(*executor, Buffer<Vec3f>(moved), scene.tets, {});
  for (size_t j = 0; j < a.size(); ++j) ASSERT_LT(length(turned(a.host()[j]) - b.host()[j]), 2e-5f) << j;
}

TEST(RestoreVolume, BringsVolumesBackAndRightsInvertedTets) {
  const auto executor = knead::make_cpu_executor(2);
  const fixture::Scene scene = fixture::ball(0.25, 1, *executor);
  std::vector<Vec3f> flat = fixture::vector_of(scene.tets.rest);
  for (Vec3f& p : flat) p.y *= 0.3f;
  flat[flat.size() / 2] += Vec3f{1.5f, 0, 0};  // through its neighbours
  const auto inverted = [&](const std::vector<Vec3f>& x) {
    size_t count = 0;
    for (const auto& t : scene.tets.tets.host()) count += fixture::six_volume(x, t) <= 0;
    return count;
  };
  EXPECT_GT(inverted(flat), 0u);
  Buffer<Vec3f> x(flat);
  for (int i = 0; i < 100; ++i) x = restore_volume(*executor, x, scene.tets, {});
  double total = 0, rest = 0;
  for (size_t t = 0; t < scene.tets.tets.size(); ++t) {
    total += fixture::six_volume(fixture::vector_of(x), scene.tets.tets.host()[t]) / 6;
    rest += scene.tets.rest_volumes.host()[t];
  }
  EXPECT_NEAR(total / rest, 1, 0.02);
  EXPECT_EQ(inverted(fixture::vector_of(x)), 0u);
}

TEST(RestoreVolume, MovesNoFurtherThanMaxStep) {
  const auto executor = knead::make_serial_executor();
  const fixture::Scene scene = fixture::ball(0.4, 1, *executor);
  std::vector<Vec3f> grown = fixture::vector_of(scene.tets.rest);
  for (Vec3f& p : grown) p = p * 3.0f;
  RestoreVolumeSettings settings = one_full_step();
  settings.max_step = 0.01;
  const Buffer<Vec3f> x = restore_volume(*executor, Buffer<Vec3f>(grown), scene.tets, settings);
  float longest = 0;
  for (size_t j = 0; j < x.size(); ++j) longest = std::max(longest, length(x.host()[j] - grown[j]));
  EXPECT_LE(longest, 0.01f * scene.tets.mean_edge + 1e-5f);
  EXPECT_GT(longest, 0.009f * scene.tets.mean_edge);
}

TEST(RestoreVolume, CollapsedAndFlatNeighbourhoodsStayFinite) {
  const auto executor = knead::make_cpu_executor(1);
  const fixture::Scene scene = fixture::ball(0.4, 1, *executor);
  for (const float squash : {0.0f, 1e-12f}) {
    std::vector<Vec3f> flat = fixture::vector_of(scene.tets.rest), point = flat;
    for (Vec3f& p : flat) p.z *= squash;
    for (Vec3f& p : point) p = p * squash;
    for (const auto& start : {flat, point}) {
      const Buffer<Vec3f> x = restore_volume(*executor, Buffer<Vec3f>(start), scene.tets, {});
      for (const Vec3f& p : x.host()) ASSERT_TRUE(std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z));
    }
  }
}

// Lanes and scalars differ in fused multiply-adds and in how the compiler groups sums, so by some units in the last place of the terms, whose conditioning the
// regularisation bounds: 2e-5 cells at coordinates of about 5 cells.
TEST(RestoreVolume, EveryLevelAgreesWithTheSerialExecutor) {
  const auto serial = knead::make_serial_executor(), cpu = knead::make_cpu_executor(1);
  const fixture::Scene scene = fixture::ball(0.2, 1, *serial);
  const Buffer<Vec3f> x = fixture::shaken(scene.tets.rest, 0.1f, 7);
  const Buffer<Vec3f> expected = restore_volume(*serial, x, scene.tets, {});
  const SimdLevel best = knead::simd_levels().back();
  for (const SimdLevel level : knead::simd_levels()) {
    knead::use_simd_level(level);
    const Buffer<Vec3f> got = restore_volume(*cpu, x, scene.tets, {});
    for (size_t j = 0; j < x.size(); ++j) ASSERT_LT(length(got.host()[j] - expected.host()[j]), 2e-5f) << knead::name_of(level) << " vertex " << j;
  }
  knead::use_simd_level(best);
}

TEST(RestoreVolume, IsTheSameBitsForAnyNumberOfThreads) {
  const auto one = knead::make_cpu_executor(1), two = knead::make_cpu_executor(2), five = knead::make_cpu_executor(5);
  const fixture::Scene scene = fixture::ball(0.15, 1, *one);
  const Buffer<Vec3f> x = fixture::shaken(scene.tets.rest, 0.1f, 9);
  const Buffer<Vec3f> a = restore_volume(*one, x, scene.tets, {});
  for (const auto* executor : {&two, &five}) {
    const Buffer<Vec3f> b = restore_volume(**executor, x, scene.tets, {});
    EXPECT_EQ(std::memcmp(a.host().data(), b.host().data(), a.bytes()), 0);
  }
}

TEST(RestoreVolume, TakesOneTetNoTetsAndWrappedStorage) {
  const auto executor = knead::make_cpu_executor(2);
  const TetMesh one = fixture::make_tet_mesh({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, {{0, 1, 2, 3}}, *executor);
  const std::vector<Vec3f> squashed{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 0.5f}};
  const auto wrapped = Buffer<Vec3f>::wrap(squashed.data(), squashed.size(), {}, [] {});
  const Buffer<Vec3f> x = restore_volume(*executor, wrapped, one, {});
  EXPECT_GT(fixture::six_volume(fixture::vector_of(x), {0, 1, 2, 3}), 0.5);
  const TetMesh none = fixture::make_tet_mesh({}, {}, *executor);
  EXPECT_EQ(restore_volume(*executor, Buffer<Vec3f>(size_t{0}), none, {}).size(), 0u);
}

TEST(RestoreVolume, RefusesPointsOfAnotherMesh) {
  const auto executor = knead::make_serial_executor();
  const fixture::Scene scene = fixture::ball(0.4, 1, *executor);
  EXPECT_THROW(restore_volume(*executor, Buffer<Vec3f>(std::vector<Vec3f>(3)), scene.tets, {}), knead::Error);
}

TEST(RestoreVolume, SweepsTakePartsOfChebyshevsPolynomial) {
  EXPECT_NEAR(knead::sweep_relaxation(0.4, 0, 1), 0.4, 1e-12);
  for (const int sweeps : {1, 2, 3, 4, 5, 8, 16}) {
    const double settled = 2 / (4 + 1.0 / sweeps);
    double worst = 0;  // of what is left of an error after all sweeps, over the interval that they are made for
    for (double eigenvalue = 1.0 / sweeps; eigenvalue <= 4; eigenvalue += 0.01) {
      double left = 1;
      for (int k = 0; k < sweeps; ++k) left *= 1 - knead::sweep_relaxation(settled, k, sweeps) * eigenvalue;
      worst = std::max(worst, std::abs(left));
    }
    const double ratio = (4 + 1.0 / sweeps) / (4 - 1.0 / sweeps);
    EXPECT_NEAR(worst, 1 / std::cosh(sweeps * std::acosh(ratio)), 2e-3) << sweeps;
  }
}

}  // namespace
