// A push by more colliders than travel with its body, and by colliders that the body is clear of.
#include <gtest/gtest.h>

#include <cstring>
#include <random>

#include "io/vdb/vdb.h"
#include "kernels/loop/collide.h"
#include "kernels/loop/collide_launch.h"
#include "tests/kernels/on_device.h"

namespace knead {
namespace many_colliders_test {

struct Pushed {
  std::vector<Vec3f> displacement;
  std::vector<float> memory;
  ContactProgress progress;
};

// Balls on a grid around the points, and some far from them.
std::vector<Sdf> balls(int side, double step) {
  const auto executor = make_serial_executor();
  SdfPlan plan;
  plan.voxel_size = 0.02;
  plan.lower = {-0.15, -0.15, -0.15};
  plan.upper = {0.15, 0.15, 0.15};
  const Sdf ball = build_sdf(*executor, plan, [&](const Vec3d& p, uint32_t&) { return length(p) - 0.15; });
  std::vector<Sdf> all;
  for (int i = 0; i < side; ++i)
    for (int j = 0; j < side; ++j)
      for (int k = 0; k < 2; ++k) {
        all.push_back(ball);
        all.back().placement.translation = {step * (i - side / 2), step * (j - side / 2), 0.35 * k};
      }
  return all;
}

Pushed push(Executor& executor, const std::vector<Vec3f>& points, const std::vector<float>& memory, const std::vector<Sdf>& colliders,
            const std::vector<Vec3f>& stand_back = {}) {
  const bool far = executor.device() != Device{};
  std::vector<Sdf> fields;
  for (const Sdf& sdf : colliders) fields.push_back(far ? on_device::moved(executor, sdf) : sdf);
  std::vector<const Sdf*> pointers;
  for (const Sdf& sdf : fields) pointers.push_back(&sdf);
  const auto there = [&](const auto& values) {
    using T = std::remove_cvref_t<decltype(values[0])>;
    const Buffer<T> host{std::span<const T>(values)};
    return far ? on_device::there(executor, host) : host;
  };
  const Buffer<Vec3f> y = there(points), back = there(stand_back);
  const Buffer<float> kept = there(memory);
  CollideInput input;
  input.points = y.view(executor.device());
  input.memory = kept.view(executor.device());
  input.colliders = pointers;
  input.stand_back = back.view(executor.device());
  input.most = 0.3;
  input.diagonal = 2;
  input.prepared = prepare_colliders(executor, input);
  Buffer<Vec3f> displacement(points.size(), executor.memory());
  Buffer<float> after(points.size(), executor.memory());
  Buffer<ContactProgress> progress(1, executor.memory());
  collide_push(executor, input, displacement.data_for_write(), after.data_for_write(), progress.data_for_write());
  const auto read = [&](const auto& buffer) {
    using T = std::remove_cvref_t<decltype(buffer.host()[0])>;
    return far ? on_device::back(executor, buffer) : std::vector<T>(buffer.host().begin(), buffer.host().end());
  };
  return {read(displacement), read(after), read(progress)[0]};
}

bool same_bits(const Pushed& a, const Pushed& b) {
  return std::memcmp(a.displacement.data(), b.displacement.data(), a.displacement.size() * sizeof(Vec3f)) == 0 &&
         std::memcmp(a.memory.data(), b.memory.data(), a.memory.size() * sizeof(float)) == 0 && a.progress.deepest == b.progress.deepest &&
         a.progress.inside == b.progress.inside && a.progress.pushed == b.progress.pushed;
}

struct Cloud {
  std::vector<Vec3f> points;
  std::vector<float> memory;
  Cloud() {
    std::mt19937 random(5);
    std::uniform_real_distribution<float> coordinate(-0.7f, 0.7f);
    for (int i = 0; i < 4000; ++i) points.push_back({coordinate(random), coordinate(random), coordinate(random)});
    memory.assign(points.size(), 0.0f);
    for (size_t i = 0; i < memory.size(); i += 3) memory[i] = 0.05f;
  }
};

TEST(ManyColliders, PushEachVertexOutOfTheOneThatItIsDeepestIn) {
  const auto executor = make_serial_executor();
  const Cloud cloud;
  const std::vector<Sdf> all = balls(10, 0.33);  // 200
  ASSERT_EQ(all.size(), 200u);
  const std::vector<float> none(cloud.points.size(), 0.0f);
  const Pushed together = push(*executor, cloud.points, none, all);
  std::vector<Vec3f> expected(cloud.points.size(), Vec3f{0, 0, 0});
  for (const Sdf& one : all) {
    const Pushed alone = push(*executor, cloud.points, none, {one});
    for (size_t i = 0; i < expected.size(); ++i)  // the balls do not overlap
      if (length(alone.displacement[i]) > 0) expected[i] = alone.displacement[i];
  }
  EXPECT_EQ(std::memcmp(expected.data(), together.displacement.data(), expected.size() * sizeof(Vec3f)), 0);
  EXPECT_GT(together.progress.inside, 100u);
}

// With a way in, though it has no length, all colliders are looked at.
TEST(ManyColliders, ThatTheBodyIsClearOfAreLeftOutWithoutChangingABit) {
  const auto executor = make_serial_executor();
  const Cloud cloud;
  for (const double step : {0.33, 1.9, 5.0}) {
    const std::vector<Sdf> all = balls(6, step);
    const std::vector<Vec3f> in_place(all.size(), Vec3f{0, 0, 0});
    EXPECT_TRUE(same_bits(push(*executor, cloud.points, cloud.memory, all), push(*executor, cloud.points, cloud.memory, all, in_place))) << step;
  }
}

class ManyCollidersOnDevice : public testing::TestWithParam<const char*> {};

TEST_P(ManyCollidersOnDevice, PushAsOnTheHost) {
  const auto device = on_device::device_named(GetParam());
  KNEAD_NEEDS(device);
  const Cloud cloud;
  const auto serial = make_serial_executor();
  for (const int side : {3, 6, 10}) {
    const std::vector<Sdf> all = balls(side, 0.33);
    const Pushed here = push(*serial, cloud.points, cloud.memory, all), there = push(*device, cloud.points, cloud.memory, all);
    EXPECT_EQ(here.progress.inside, there.progress.inside) << all.size();
    for (size_t i = 0; i < cloud.points.size(); ++i) ASSERT_LT(length(here.displacement[i] - there.displacement[i]), 1e-6f) << all.size();
  }
}

INSTANTIATE_TEST_SUITE_P(On, ManyCollidersOnDevice, testing::Values("fake", "cuda"));

}  // namespace many_colliders_test
}  // namespace knead
