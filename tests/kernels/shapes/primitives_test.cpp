#include "kernels/shapes/primitives.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <utility>

#include "graph/error.h"
#include "kernels/shapes/implicit_mesh.h"
#include "kernels/surface/volume.h"

namespace knead::primitives_test {
namespace {

struct Shape {
  double volume = 0, area = 0, shortest = HUGE_VAL, longest = 0, mean_edge = 0;
  long unmatched = 0;  // directed edges whose opposite is missing or that occur twice
  long euler = 0;
};

Shape measured(const Surface& surface) {
  Shape shape;
  const auto points = surface.points.host();
  const std::vector<uint32_t>& triangles = surface.topology->triangles;
  std::map<std::pair<uint32_t, uint32_t>, int> edges;
  for (size_t t = 0; t < triangles.size(); t += 3) {
    Vec3d p[3];
    for (int c = 0; c < 3; ++c) p[c] = to_double(points[triangles[t + c]]);
    shape.volume += volume_part({0, 0, 0}, p[0], p[1], p[2]);
    shape.area += 0.5 * length(cross(p[1] - p[0], p[2] - p[0]));
    for (int c = 0; c < 3; ++c) {
      ++edges[{triangles[t + c], triangles[t + (c + 1) % 3]}];
      const double edge = length(p[(c + 1) % 3] - p[c]);
      shape.shortest = std::min(shape.shortest, edge);
      shape.longest = std::max(shape.longest, edge);
      shape.mean_edge += edge / static_cast<double>(triangles.size());
    }
  }
  for (const auto& [edge, uses] : edges) shape.unmatched += uses != 1 || !edges.count({edge.second, edge.first});
  shape.euler = static_cast<long>(points.size()) - static_cast<long>(edges.size() / 2) + static_cast<long>(triangles.size() / 3);
  return shape;
}

bool same_bits(const Surface& a, const Surface& b) {
  const auto p = a.points.host(), q = b.points.host();
  return a.topology->triangles == b.topology->triangles && p.size() == q.size() &&
         std::equal(p.begin(), p.end(), q.begin(), [](const Vec3f& x, const Vec3f& y) { return x.x == y.x && x.y == y.y && x.z == y.z; });
}

TEST(Primitives, AreClosedOrientedOutwardsAndOfTheRightTopology) {
  const std::vector<std::pair<Surface, long>> all = {{make_sphere(2, 0), 2},      {make_sphere(1, 3), 2},          {make_box({1, 2, 3}, 7), 2},
                                                     {make_box({1, 1, 1}, 1), 2}, {make_box({1, 0.01, 1}, 12), 2}, {make_capsule(0.3, 2, 5), 2},
                                                     {make_capsule(1, 1, 4), 2},  {make_torus(1, 0.3, 24), 0},     {make_blob(1, 700), 2},
                                                     {make_head(2, 900), 2},      {make_fist(1, 1000), 2}};
  for (size_t i = 0; i < all.size(); ++i) {
    const Shape shape = measured(all[i].first);
    EXPECT_EQ(shape.unmatched, 0) << i;
    EXPECT_EQ(shape.euler, all[i].second) << i;
    EXPECT_GT(shape.volume, 0) << i;
    EXPECT_GT(shape.shortest, 0) << i;
  }
}

TEST(Primitives, HaveTheVertexCountsOfTheirDocumentation) {
  EXPECT_EQ(make_sphere(1, 4).vertices(), 10u * 256 + 2);
  EXPECT_EQ(make_box({1, 1, 1}, 9).vertices(), 6u * 81 + 2);
  EXPECT_EQ(make_box({1, 2, 3}, 6).vertices(), 2u * (2 * 4 + 4 * 6 + 6 * 2) + 2);
  EXPECT_EQ(make_capsule(0.5, 1, 8).vertices(), 6u * 64 + 2);
  EXPECT_EQ(make_torus(1, 0.25, 40).vertices(), 400u);
  EXPECT_EQ(make_head(2, 2400).vertices(), 2400u);
  EXPECT_EQ(make_fist(1, 2904).vertices(), 2904u);
  EXPECT_EQ(make_blob(1, 1234).vertices(), 1234u);
}

TEST(Primitives, FillTheVolumesOfTheirFormulas) {
  const double pi = std::numbers::pi;
  EXPECT_NEAR(measured(make_sphere(2, 5)).volume, 4.0 / 3 * pi * 8, 0.03);
  EXPECT_NEAR(measured(make_box({1, 2, 3}, 5)).volume, 6, 1e-5);
  EXPECT_NEAR(measured(make_capsule(0.5, 3, 40)).volume, 4.0 / 3 * pi * 0.125 + pi * 0.25 * 2, 0.01);
  EXPECT_NEAR(measured(make_torus(1, 0.3, 200)).volume, 2 * pi * pi * 0.09, 0.01);
}

TEST(Primitives, PutEveryVertexOnTheirSurface) {
  const Surface ball = make_sphere(3, 3), capsule = make_capsule(0.5, 2, 6), torus = make_torus(1, 0.3, 20);
  for (const Vec3f& p : ball.points.host()) EXPECT_NEAR(length(to_double(p)), 3, 1e-6);
  for (const Vec3f& q : capsule.points.host()) {
    const Vec3d p = to_double(q);
    EXPECT_NEAR(length(p - Vec3d{0, std::clamp(p.y, -0.5, 0.5), 0}), 0.5, 1e-6);
  }
  for (const Vec3f& q : torus.points.host()) {
    const Vec3d p = to_double(q);
    EXPECT_NEAR(std::hypot(std::hypot(p.x, p.z) - 1, p.y), 0.3, 1e-6);
  }
}

TEST(Primitives, KeepTheirEdgesAlike) {
  for (const Surface& surface : {make_sphere(1, 4), make_capsule(0.25, 1.5, 8), make_blob(1, 1500), make_fist(1, 2000)}) {
    const Shape shape = measured(surface);
    EXPECT_GT(shape.shortest, 0.35 * shape.mean_edge);
    EXPECT_LT(shape.longest, 1.8 * shape.mean_edge);
  }
  const Shape head = measured(make_head(2, 2400));  // finer on the face
  EXPECT_GT(head.shortest, 0.2 * head.mean_edge);
  EXPECT_LT(head.longest, 2.0 * head.mean_edge);
}

TEST(Primitives, ScaleWithTheirSize) {
  const Surface one = make_fist(1, 600), large = make_fist(1000, 600);
  for (size_t i = 0; i < one.vertices(); ++i)
    EXPECT_NEAR(length(to_double(large.points.host()[i]) - 1000 * to_double(one.points.host()[i])), 0, 1e-3);
  const Surface head = make_head(30, 600);
  EXPECT_NEAR(head.upper.y - head.lower.y, 30, 0.1);
}

TEST(Primitives, AreTheSameBitsAgain) {
  EXPECT_TRUE(same_bits(make_head(2, 400), make_head(2, 400)));
  EXPECT_TRUE(same_bits(make_fist(1, 400), make_fist(1, 400)));
  EXPECT_FALSE(same_bits(make_head(2, 400), make_head(2, 401)));
}

TEST(Primitives, RefuseSizesThatMakeNoSolid) {
  EXPECT_THROW(make_sphere(0, 3), Error);
  EXPECT_THROW(make_sphere(1, 11), Error);
  EXPECT_THROW(make_box({1, 0, 1}, 3), Error);
  EXPECT_THROW(make_box({1, 1, 1}, 0), Error);
  EXPECT_THROW(make_capsule(1, -1, 8), Error);
  EXPECT_THROW(make_capsule(1e-9, 1, 8), Error);
  EXPECT_THROW(make_torus(1, 1, 8), Error);
  EXPECT_THROW(make_head(-1, 2400), Error);
  EXPECT_THROW(make_blob(1, 10), Error);
}

TEST(MakeSurface, CutsQuadsAlongTheShorterDiagonalAndKeepsTheOrientation) {
  const Surface kite = make_surface({{-2, 0, 0}, {0, -1, 0}, {2, 0, 0}, {0, 1, 0}}, {0, 4}, {0, 1, 2, 3});
  EXPECT_EQ(kite.topology->triangles, (std::vector<uint32_t>{1, 2, 3, 1, 3, 0}));
  EXPECT_EQ(kite.topology->triangle_faces, (std::vector<uint32_t>{0, 0}));
  EXPECT_EQ(kite.lower.x, -2);
  EXPECT_EQ(kite.upper.y, 1);
}

TEST(MakeSurface, LeavesTrianglesWithoutAreaOutAndUnusedPointsOutOfTheBox) {
  const Surface s = make_surface({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {9, 9, 9}}, {0, 3, 6, 9}, {0, 1, 2, 0, 0, 1, 0, 1, 1});
  EXPECT_EQ(s.topology->faces(), 3u);
  EXPECT_EQ(s.topology->triangle_count(), 1u);
  EXPECT_EQ(s.upper.x, 1);
}

TEST(MakeSurface, RefusesIndicesOutOfRangeAndOtherPolygons) {
  EXPECT_THROW(make_surface({{0, 0, 0}}, {0, 3}, {0, 0, 1}), Error);
  EXPECT_THROW(make_surface({{0, 0, 0}}, {0, 2}, {0, 0}), Error);
  EXPECT_THROW(make_surface({{0, 0, 0}}, {0, 3, 2, 3}, {0, 0, 0}), Error);
  EXPECT_THROW(make_surface({{0, 0, 0}}, {}, {}), Error);
}

TEST(ImplicitMesh, ContoursASphereClosedAndOnItsSurface) {
  const auto sphere = [](const Vec3d& p) { return length(p) - 1; };
  const auto even = [](const Vec3d&) { return 1.0; };
  const TriangleMesh mesh = contour_even(sphere, {-1.3, -1.3, -1.3}, {1.3, 1.3, 1.3}, 500, even);
  ASSERT_EQ(mesh.points.size(), 500u);
  std::vector<Vec3f> points;
  for (const Vec3d& p : mesh.points) {
    EXPECT_NEAR(length(p), 1, 1e-5);
    points.push_back(to_float(p));
  }
  const Shape shape = measured(make_triangle_surface(points, mesh.triangles));
  EXPECT_EQ(shape.unmatched, 0);
  EXPECT_EQ(shape.euler, 2);
  EXPECT_NEAR(shape.volume, 4.0 / 3 * std::numbers::pi, 0.08);
}

TEST(ImplicitMesh, ContourIsClosedWhereTheFunctionIsZeroOnGridPoints) {
  const auto octahedron = [](const Vec3d& p) { return std::abs(p.x) + std::abs(p.y) + std::abs(p.z) - 1; };
  const TriangleMesh mesh = contour(octahedron, {-2, -2, -2}, {2, 2, 2}, 0.5);
  std::map<std::pair<uint32_t, uint32_t>, int> edges;
  for (size_t t = 0; t < mesh.triangles.size(); t += 3)
    for (int c = 0; c < 3; ++c) ++edges[{mesh.triangles[t + c], mesh.triangles[t + (c + 1) % 3]}];
  for (const auto& [edge, uses] : edges) EXPECT_TRUE(uses == 1 && edges.count({edge.second, edge.first}));
  EXPECT_GT(mesh.triangles.size(), 0u);
}

}  // namespace
}  // namespace knead::primitives_test
