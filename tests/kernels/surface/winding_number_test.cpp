#include "kernels/surface/winding_number.h"

#include <gtest/gtest.h>

#include <random>

#include "kernels/shapes/primitives.h"

namespace knead {
namespace winding_number_test {

struct Soup {
  std::vector<Vec3d> points;
  std::vector<uint32_t> triangles;
  void add(const Surface& surface, const Vec3d& shift = {0, 0, 0}, bool turned = false) {
    const uint32_t first = static_cast<uint32_t>(points.size());
    for (const Vec3f& p : surface.points.host()) points.push_back(to_double(p) + shift);
    const auto& t = surface.topology->triangles;
    for (size_t i = 0; i < t.size(); i += 3)
      for (const size_t k : {size_t{0}, size_t{turned ? 2u : 1u}, size_t{turned ? 1u : 2u}}) triangles.push_back(first + t[i + k]);
  }
  double exact(const Vec3d& at) const { return winding_number_exact(points, triangles, at); }
};

TEST(WindingNumber, CountsClosedSurfacesRoundAPoint) {
  Soup soup;
  soup.add(make_box({2, 2, 2}, 3));
  EXPECT_NEAR(soup.exact({0.3, 0.2, -0.9}), 1, 1e-12);
  EXPECT_NEAR(soup.exact({0.3, 0.2, -1.1}), 0, 1e-12);
  soup.add(make_sphere(0.5, 2), {0, 0, 0}, true);  // a cavity
  EXPECT_NEAR(soup.exact({0.1, 0, 0}), 0, 1e-12);
  soup.add(make_sphere(0.2, 1));
  EXPECT_NEAR(soup.exact({0.1, 0, 0}), 1, 1e-12);
}

TEST(WindingNumber, IsHalfInTheMouthOfAHalfSphere) {
  const Surface sphere = make_sphere(1, 3);
  Soup soup;
  soup.add(sphere);
  std::vector<uint32_t> lower;
  for (size_t t = 0; t < soup.triangles.size(); t += 3) {
    const Vec3d middle = soup.points[soup.triangles[t]] + soup.points[soup.triangles[t + 1]] + soup.points[soup.triangles[t + 2]];
    if (middle.y < 0) lower.insert(lower.end(), {soup.triangles[t], soup.triangles[t + 1], soup.triangles[t + 2]});
  }
  EXPECT_NEAR(winding_number_exact(soup.points, lower, {0, 0, 0}), 0.5, 0.02);
  const auto executor = make_serial_executor();
  EXPECT_NEAR(WindingNumber(soup.points, lower, *executor).at({0, 0, 0}), 0.5, 0.02);
}

TEST(WindingNumber, TreeAgreesWithTheSum) {
  const auto executor = make_cpu_executor(2);
  std::mt19937 random(3);
  std::uniform_real_distribution<double> place(-1.5, 1.5);
  Soup mesh, soup;
  mesh.add(make_torus(1, 0.35, 40));
  mesh.add(make_blob(0.8, 800), {0.4, 0.1, 0.2}, true);
  for (int i = 0; i < 600; ++i) soup.points.push_back({place(random), place(random), place(random)});
  for (uint32_t i = 0; i < 600; ++i) soup.triangles.push_back(i);
  for (const Soup* tested : {&mesh, &soup}) {
    const WindingNumber tree(tested->points, tested->triangles, *executor);
    for (int i = 0; i < 2000; ++i) {
      const Vec3d at{place(random), place(random), place(random)};
      ASSERT_NEAR(tree.at(at), tested->exact(at), 0.01);
    }
  }
}

TEST(WindingNumber, TakesNothingAndPointsFarAway) {
  const auto executor = make_serial_executor();
  EXPECT_EQ(WindingNumber({}, {}, *executor).at({0, 0, 0}), 0);
  Soup soup;
  soup.add(make_sphere(1, 2));
  soup.triangles.insert(soup.triangles.end(), {0, 0, 0, 1, 1, 2});  // without area
  const WindingNumber tree(soup.points, soup.triangles, *executor);
  EXPECT_NEAR(tree.at({1e6, 0, 0}), 0, 1e-9);
  EXPECT_NEAR(tree.at({0, 0, 0}), 1, 0.01);
}

}  // namespace winding_number_test
}  // namespace knead
