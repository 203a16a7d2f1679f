#include "io/vdb/near_field.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "io/vdb/vdb.h"
#include "kernels/collider_view.h"
#include "kernels/loop/collide.h"
#include "kernels/sdf_sample.h"
#include "kernels/shapes/primitives.h"
#include "kernels/surface/exact_distance.h"
#include "kernels/surface/mesh_distance.h"

namespace knead {
namespace near_field_test {

// A ball of which the distance is known, in units of its own.
class BallDistance final : public ExactDistance {
 public:
  explicit BallDistance(double radius) : radius_(radius) {}
  SignedDistance signed_distance(const Vec3d& p, double) const override {
    const double r = length(p);
    const Vec3d out = r > 0 ? p * (1 / r) : Vec3d{0, 1, 0};
    return {r - radius_, out * radius_, out, 0};
  }
  SignedDistance signed_distance_near(const Vec3d& p, uint32_t&) const override { return signed_distance(p, 0); }

 private:
  double radius_;
};

// With a field of 40 voxels across, as a collider has it that knows nothing of the body.
Sdf ball(double radius) {
  const auto executor = make_serial_executor();
  SdfPlan plan;
  plan.voxel_size = radius / 20;
  plan.lower = {-radius, -radius, -radius};
  plan.upper = {radius, radius, radius};
  Sdf sdf = build_sdf(*executor, plan, [&](const Vec3d& p, uint32_t&) { return length(p) - radius; });
  sdf.distance = std::make_shared<BallDistance>(radius);
  return sdf;
}

Sdf near(const Sdf& collider, const NearBody& body) {
  Sdf made = field_near(*make_cpu_executor(2), collider, body);
  made.placement = collider.placement * made.placement;
  return made;
}

// As a body's kernels see the field, in float32.
double seen(const Sdf& field, const NearBody& body, const Vec3d& local) {
  const ColliderView view = view_collider(field, Device{}, body.placement);
  return static_cast<double>(SdfSampler(view.sdf).value(view.to_index(to_float(local))) * view.scale);
}

TEST(NearField, HoldsSmallPlacesBesideALargeCollider) {
  const Surface body = make_sphere(1, 3);
  for (const double radius : {5.0, 500.0, 50000.0})
    for (const double unit : {1e-4, 1.0, 1e5}) {
      Surface placed = body;
      placed.placement.scale = unit;
      placed.placement.translation = {7 * unit, -3e3 * unit, unit};
      Sdf collider = ball(radius);
      collider.placement.scale = unit;
      collider.placement.rotation = {0.6, -0.8, 0, 0.8, 0.6, 0, 0, 0, 1};
      collider.placement.translation = placed.placement.translation + Vec3d{0, (radius + 0.8) * unit, 0};
      const NearBody there = near_body(placed, 0);
      ASSERT_FALSE(knows(collider, there));
      const Sdf field = near(collider, there);
      EXPECT_TRUE(knows(field, there));
      EXPECT_LT(field.voxel_size, 0.1);
      std::mt19937 random(4);
      std::uniform_real_distribution<double> coordinate(-1, 1);
      for (int n = 0; n < 300; ++n) {
        const Vec3d p{coordinate(random), coordinate(random), coordinate(random)};
        const double exact = length(p - Vec3d{0, radius + 0.8, 0}) - radius, value = seen(field, there, p);
        const double band = static_cast<double>(field.outside_band);
        if (exact < band) {
          ASSERT_NEAR(value, exact, 2e-3 / std::min(radius, 50.0) * 5) << radius << ' ' << unit;
        } else {
          ASSERT_GT(value, 0.99 * band);
        }
      }
    }
}

TEST(NearField, IsAskedForOnlyWhereTheColliderIsTooCoarseAndNear) {
  const Surface body = make_sphere(1, 3);
  const NearBody here = near_body(body, 0);
  Sdf large = ball(100), small = ball(0.5);
  large.placement.translation = {0, 100.8, 0};
  small.placement.translation = {0, 1.3, 0};
  EXPECT_FALSE(knows(large, here));
  EXPECT_TRUE(knows(small, here));
  EXPECT_TRUE(knows(large, near_body(Surface{}, 0))) << "of no body";
  large.placement.translation = {0, 150, 0};
  EXPECT_TRUE(knows(large, here)) << "they cannot meet";
}

TEST(NearField, CostsWhatTheBodyIsLargeNotTheCollider) {
  const Surface body = make_sphere(1, 3);
  const NearBody here = near_body(body, 0);
  size_t bytes[2];
  for (const int k : {0, 1}) {
    Sdf collider = ball(k ? 5000 : 50);
    collider.placement.translation = {0, (k ? 5000 : 50) + 0.8, 0};
    bytes[k] = near(collider, here).grid.size();
  }
  EXPECT_LT(static_cast<double>(bytes[1]), 1.3 * static_cast<double>(bytes[0]));
  EXPECT_LT(bytes[0], size_t{8} << 20);
}

// The plates are 4e-2 to 1e-4 of the body's radius thick, far below a voxel. Seen from the body, all that is behind them is inside.
TEST(NearField, OfThinPlatesIsInsideBehindThem) {
  const Surface body = make_sphere(1, 3);
  const NearBody here = near_body(body, 0);
  for (const double thickness : {0.04, 0.001, 1e-4})
    for (const int pieces : {1, 30}) {
      const Surface plate = make_box({20, thickness, 20}, pieces);
      Sdf collider = ball(10);
      collider.lower = plate.lower;
      collider.upper = plate.upper;
      collider.mesh = std::make_shared<Surface>(plate);
      collider.distance = std::make_shared<MeshDistance>(plate.points.host(), std::span<const uint32_t>(plate.topology->triangles));
      collider.placement.translation = {0, -0.8 - 0.5 * thickness, 0};
      const Sdf field = near(collider, here);
      std::mt19937 random(4);
      std::uniform_real_distribution<double> coordinate(-1, 1);
      for (int n = 0; n < 300; ++n) {
        const Vec3d p{coordinate(random), coordinate(random), coordinate(random)};
        const double height = p.y + 0.8;
        if (height > static_cast<double>(field.outside_band)) continue;
        ASSERT_NEAR(seen(field, here, p), height, 0.02 * 1.73 + (height < 0 ? thickness : 0)) << thickness << ' ' << pieces;
        if (std::abs(height) > 0.02) ASSERT_EQ(seen(field, here, p) < 0, height < 0) << thickness << ' ' << pieces << ' ' << height;
      }
    }
}

}  // namespace near_field_test
}  // namespace knead
