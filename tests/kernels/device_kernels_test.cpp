// Every kernel of the loop on devices, against the serial executor. The fake device runs the same code and gives the same bits. CUDA rounds each operation as
// the host does, so that only sums that are taken in another order (the rigid fit) and hosts that contract products and sums differ, by a few roundings
// times what the step amplifies: a volume step solves a 3x3 system whose condition the regularisation bounds by about 100; the others amplify nothing.
#include <gtest/gtest.h>

#include <cstring>

#include "io/vdb/vdb.h"
#include "kernels/largest_move_body.h"
#include "kernels/loop/collide.h"
#include "kernels/loop/enforce_stiffness.h"
#include "kernels/loop/hold.h"
#include "kernels/loop/lattice_map.h"
#include "kernels/loop/restore_volume.h"
#include "kernels/loop/rigid_fit_body.h"
#include "kernels/parallel.h"
#include "tests/kernels/loop/loop_fixture.h"
#include "tests/kernels/on_device.h"

namespace knead {
namespace device_kernels_test {

using on_device::back;
using on_device::moved;
using on_device::there;

constexpr double kRoundings = 2e-5, kSolve = 5e-4;  // cells, about coordinates up to 5 cells

const loop_fixture::Scene& scene() {
  static const loop_fixture::Scene made = [] {
    const auto executor = make_serial_executor();
    return loop_fixture::ball(0.3, 3, *executor);
  }();
  return made;
}
Buffer<Vec3f> bent_points() {
  return loop_fixture::shaken(scene().tets.rest, 0.1f, 11);
}
Buffer<float> paint(float most) {
  std::vector<float> values;
  for (const Vec3f& p : scene().surface.points.host()) values.push_back(p.y < -0.5f ? most : p.y < 0 ? 0.25f * most : 0);
  return Buffer<float>(values);
}

Sdf ball_at(double radius, const Vec3d& at) {
  SdfPlan plan;
  plan.voxel_size = 0.04;
  plan.lower = {-radius, -radius, -radius};
  plan.upper = {radius, radius, radius};
  const auto executor = make_serial_executor();
  Sdf sdf = build_sdf(*executor, plan, [&](const Vec3d& p, uint32_t&) { return length(p) - radius; });
  sdf.placement.translation = at;
  return sdf;
}

class DeviceKernels : public testing::TestWithParam<const char*> {
 protected:
  void SetUp() override {
    device_ = on_device::device_named(GetParam());
    KNEAD_NEEDS(device_);
    serial_ = make_serial_executor();
    tets_ = moved(*device_, scene().tets);
    lattice_ = moved(*device_, scene().lattice);
  }
  bool exact() const { return std::string(GetParam()) == "fake"; }

  void expect_near(const std::vector<Vec3f>& is, std::span<const Vec3f> should_be, double bound) const {
    ASSERT_EQ(is.size(), should_be.size());
    if (exact()) {
      EXPECT_EQ(std::memcmp(is.data(), should_be.data(), is.size() * sizeof(Vec3f)), 0);
      return;
    }
    double worst = 0;
    for (size_t i = 0; i < is.size(); ++i) worst = std::max(worst, length(to_double(is[i]) - to_double(should_be[i])));
    EXPECT_LT(worst, bound);
  }
  // `step(executor, points, tets, lattice)` on both; on the device twice, which must give the same bits.
  template <class Step>
  void compare(const Buffer<Vec3f>& points, double bound, const Step& step) {
    const Buffer<Vec3f> expected = step(*serial_, points, scene().tets, scene().lattice), far = there(*device_, points);
    const std::vector<Vec3f> first = back(*device_, step(*device_, far, tets_, lattice_));
    expect_near(first, expected.host(), bound);
    const std::vector<Vec3f> again = back(*device_, step(*device_, far, tets_, lattice_));
    EXPECT_EQ(std::memcmp(first.data(), again.data(), first.size() * sizeof(Vec3f)), 0) << "not the same bits again";
  }

  std::unique_ptr<Executor> device_, serial_;
  TetMesh tets_;
  Lattice lattice_;
};

TEST_P(DeviceKernels, RestoreVolume) {
  for (const bool relative : {true, false})
    compare(bent_points(), kSolve, [&](Executor& on, const Buffer<Vec3f>& points, const TetMesh& tets, const Lattice&) {
      RestoreVolumeSettings settings;
      settings.relative = relative;
      settings.sweeps = 3;
      return restore_volume(on, points, tets, settings);
    });
}

TEST_P(DeviceKernels, EnforceStiffness) {
  const Buffer<float> weights(std::vector<float>(scene().tets.vertices(), 0.5f)), far = there(*device_, weights);
  for (const bool weighted : {true, false})
    for (const bool stretched_only : {true, false})
      compare(bent_points(), kRoundings, [&](Executor& on, const Buffer<Vec3f>& points, const TetMesh& tets, const Lattice&) {
        EnforceStiffnessSettings settings{.stiffness = 0.8, .stretched_only = stretched_only};
        if (weighted) settings.weights = on.device() == Device{} ? &weights : &far;
        return enforce_stiffness(on, points, tets, settings);
      });
}

TEST_P(DeviceKernels, MapToTets) {
  const Buffer<Vec3f> push = loop_fixture::shaken(Buffer<Vec3f>(std::vector<Vec3f>(scene().surface.vertices(), Vec3f{0, 0, 0})), 0.05f, 7);
  const Buffer<Vec3f> far = there(*device_, push);
  compare(bent_points(), kRoundings, [&](Executor& on, const Buffer<Vec3f>& points, const TetMesh&, const Lattice& lattice) {
    return map_to_tets(on, on.device() == Device{} ? push : far, points, lattice, {.gain = 1.5, .max_step = 0.1, .mean_edge = 1});
  });
}

TEST_P(DeviceKernels, MapToSurface) {
  compare(bent_points(), kRoundings,
          [&](Executor& on, const Buffer<Vec3f>& points, const TetMesh&, const Lattice& lattice) { return map_to_surface(on, points, lattice); });
}

TEST_P(DeviceKernels, Hold) {
  const Buffer<float> weights = paint(1), pins = paint(1), none = paint(0);
  const Buffer<float> far_weights = there(*device_, weights), far_pins = there(*device_, pins), far_none = there(*device_, none);
  struct Case {
    bool rigid;
    const Buffer<float>*pins, *far_pins, *weights, *far_weights;
  };
  // Moved as a whole, too: the rigid motion is what is taken out.
  const Buffer<Vec3f> bent = bent_points();
  std::vector<Vec3f> turned;
  for (const Vec3f& p : bent.host()) turned.push_back({0.8f * p.x - 0.6f * p.y + 1, 0.6f * p.x + 0.8f * p.y - 2, p.z + 0.5f});
  for (const Case& one : {Case{true, nullptr, nullptr, nullptr, nullptr},
                          {false, nullptr, nullptr, &weights, &far_weights},
                          {true, &pins, &far_pins, &weights, &far_weights},
                          {true, &none, &far_none, nullptr, nullptr}})
    compare(Buffer<Vec3f>(turned), 2 * kRoundings, [&](Executor& on, const Buffer<Vec3f>& points, const TetMesh& tets, const Lattice& lattice) {
      const bool here = on.device() == Device{};
      HoldSettings settings{.strength = 0.1, .remove_rigid = one.rigid};
      settings.pins = here ? one.pins : one.far_pins;
      settings.weights = here ? one.weights : one.far_weights;
      return hold(on, points, tets, &lattice, settings);
    });
}

TEST_P(DeviceKernels, LeavesHAtRestToTheBit) {
  const Buffer<Vec3f> rest = tets_.rest;
  RestoreVolumeSettings volume;
  Buffer<Vec3f> x = restore_volume(*device_, rest, tets_, volume);
  x = enforce_stiffness(*device_, x, tets_, {.stiffness = 1});
  x = hold(*device_, x, tets_, &lattice_, {.strength = 0.5});
  const auto host = scene().tets.rest.host();
  EXPECT_EQ(std::memcmp(back(*device_, x).data(), host.data(), scene().tets.rest.bytes()), 0);
  const auto surface = scene().surface.points.host();
  EXPECT_EQ(std::memcmp(back(*device_, map_to_surface(*device_, x, lattice_)).data(), surface.data(), scene().surface.points.bytes()), 0);
}

TEST_P(DeviceKernels, CollidePushWithMemoryOnTheWayIn) {
  const Sdf ball = ball_at(0.5, {0, 1, 0}), other = ball_at(0.4, {1.1, 0, 0});
  const Sdf far_ball = moved(*device_, ball), far_other = moved(*device_, other);
  const Buffer<Vec3f> points = scene().surface.points, far_points = there(*device_, points);
  const size_t n = points.size();
  const auto push = [&](Executor& on, const Buffer<Vec3f>& at, const Sdf& first, const Sdf& second, const Contacts& before, Contacts& after) {
    const Sdf* colliders[] = {&first, &second};
    CollideInput input;
    input.points = at.view(on.device());
    input.memory = before.memory.view(on.device());
    input.colliders = colliders;
    input.most = 0.3;
    input.diagonal = 2;
    input.before = before.progress.view(on.device()).data();
    input.stand_back = before.stand_back.view(on.device());
    after = {Buffer<float>(n, on.memory()), Buffer<ContactProgress>(1, on.memory()), before.stand_back, {}, {}, {}};
    Buffer<Vec3f> displacement(n, on.memory()), result(n, on.memory());
    collide_push(on, input, displacement.data_for_write(), after.memory.data_for_write(), after.progress.data_for_write());
    add_displacement(on, input.points, displacement.view(on.device()).data(), result.data_for_write());
    return result;
  };
  Contacts here{{}, Buffer<ContactProgress>(1), Buffer<Vec3f>(std::vector<Vec3f>{{0, 0.2f, 0}, {0, 0, 0}}), {}, {}, {}};
  here.progress.data_for_write()[0] = {};
  here.progress.data_for_write()[0].steps = 2;
  Contacts away = moved(*device_, here);
  for (int round = 0; round < 4; ++round) {
    Contacts here_after, away_after;
    const Buffer<Vec3f> expected = push(*serial_, points, ball, other, here, here_after);
    expect_near(back(*device_, push(*device_, far_points, far_ball, far_other, away, away_after)), expected.host(), kRoundings);
    const ContactProgress is = back(*device_, away_after.progress)[0], should_be = here_after.progress.host()[0];
    EXPECT_EQ(is.step, should_be.step);
    EXPECT_EQ(should_be.step, std::min(round, 2));
    EXPECT_EQ(is.steps, 2);
    EXPECT_NEAR(is.unrest, should_be.unrest, exact() ? 0 : 1e-6);
    EXPECT_NEAR(is.inside, should_be.inside, exact() ? 0 : 2);
    EXPECT_GT(should_be.inside, 0u);
    here = here_after;
    away = away_after;
  }
}

TEST_P(DeviceKernels, UnrestIsTheLargestMoveAndInfiniteForNoNumber) {
  const Surface& rest = scene().surface;
  std::vector<Vec3f> points(rest.points.host().begin(), rest.points.host().end());
  points[5] = points[5] + Vec3f{0, 0.25f, 0};
  Surface before = rest, after = rest;
  after.points = Buffer<Vec3f>(points);
  const auto unrest = [&] {
    const Surface b = moved(*device_, before), a = moved(*device_, after);
    return back(*device_, PortTraits<Surface>::unrest(b, a, *device_))[0];
  };
  EXPECT_NEAR(unrest(), 0.25 / rest.diagonal(), 1e-6);
  points[7].x = std::nanf("");
  after.points = Buffer<Vec3f>(points);
  EXPECT_FALSE(std::isfinite(unrest()));
}

// Around warps, blocks, and the number of pieces from which on a block takes more than one index a thread. The sums are exact in any order.
TEST_P(DeviceKernels, ReductionsTakeEveryIndexOnce) {
  for (const uint32_t n : {0u, 1u, 31u, 32u, 33u, 255u, 256u, 257u, 262'143u, 262'144u, 262'145u, 1'000'003u}) {
    std::vector<float> values(n);
    double sum = 0;
    for (uint32_t i = 0; i < n; ++i) sum += values[i] = static_cast<float>(i % 13);
    if (n > 0) sum += 100 - values.back(), values.back() = 100;
    const Buffer<float> paint = there(*device_, Buffer<float>(values));
    Buffer<float> figures(2, device_->memory());
    float* const most = figures.data_for_write();
    reduce(*device_, n, SumPaint{paint.view(device_->device()).data(), n, most, most + 1});
    const std::vector<float> is = back(*device_, figures);
    EXPECT_EQ(is[0], n > 0 ? 100.0f : 0.0f) << n;
    EXPECT_EQ(is[1], n > 0 ? static_cast<float>(sum / n) : 0.0f) << n;
  }
}

TEST_P(DeviceKernels, TooLittleMemoryIsAnErrorAndTheDeviceLivesOn) {
  try {
    Buffer<float> too_large(size_t{1} << 48, device_->memory());
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::kMemory);
    EXPECT_NE(std::string(error.what()).find("bytes were asked for"), std::string::npos);
    EXPECT_NE(std::string(error.what()).find("are free"), std::string::npos);
  }
  EXPECT_EQ(back(*device_, map_to_surface(*device_, tets_.rest, lattice_)).size(), scene().surface.vertices());
}

INSTANTIATE_TEST_SUITE_P(On, DeviceKernels, testing::Values("fake", "cuda"), [](const auto& info) { return std::string(info.param); });

}  // namespace device_kernels_test
}  // namespace knead
