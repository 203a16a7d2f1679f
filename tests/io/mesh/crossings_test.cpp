#include "io/mesh/crossings.h"

#include <gtest/gtest.h>

#include <random>

#include "tests/io/mesh/mesh_test_tools.h"

namespace mesh_crossings_test {

namespace tools = mesh_test_tools;
using knead::Surface;
using knead::Vec3d;

Surface from_triangles(const std::vector<Vec3d>& corners) {
  knead::MeshTopology polygons;
  polygons.face_offsets.push_back(0);
  for (uint32_t i = 0; i < corners.size(); ++i) {
    polygons.face_vertices.push_back(i);
    if (i % 3 == 2) polygons.face_offsets.push_back(i + 1);
  }
  std::vector<std::string> warnings;
  return knead::make_surface(corners, polygons, {}, {}, "triangles", warnings);
}

// By another way: where the edge meets the plane, in barycentric coordinates.
bool edge_hits(const Vec3d& p, const Vec3d& q, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  const Vec3d normal = cross(b - a, c - a);
  const double from = dot(normal, p - a), to = dot(normal, q - a);
  if (from * to >= 0) return false;
  const Vec3d hit = p + (q - p) * (from / (from - to));
  const double size = dot(normal, normal);
  const double u = dot(cross(b - a, hit - a), normal) / size, v = dot(cross(hit - a, c - a), normal) / size;
  return u > 0 && v > 0 && u + v < 1;
}

TEST(MeshCrossings, AgreeWithTestingEveryPair) {
  std::mt19937 random(11);
  std::uniform_real_distribution<double> place(-1, 1), reach(-0.2, 0.2);
  std::vector<Vec3d> corners;
  for (int t = 0; t < 400; ++t) {
    const Vec3d centre{place(random), place(random), place(random)};
    for (int k = 0; k < 3; ++k) corners.push_back(centre + Vec3d{reach(random), reach(random), reach(random)});
  }
  const Surface s = from_triangles(corners);
  std::vector<Vec3d> stored;
  for (const knead::Vec3f& p : s.points.host()) stored.push_back(to_double(p));
  size_t expected = 0;
  for (size_t i = 0; i < stored.size(); i += 3)
    for (size_t j = i + 3; j < stored.size(); j += 3) {
      bool crosses = false;
      for (size_t k = 0; k < 3; ++k) {
        crosses = crosses || edge_hits(stored[i + k], stored[i + (k + 1) % 3], stored[j], stored[j + 1], stored[j + 2]);
        crosses = crosses || edge_hits(stored[j + k], stored[j + (k + 1) % 3], stored[i], stored[i + 1], stored[i + 2]);
      }
      expected += crosses;
    }
  EXPECT_GT(expected, 20u);
  EXPECT_EQ(knead::mesh::count_crossings(s).pairs, expected);
}

TEST(MeshCrossings, TouchingIsNoCrossing) {
  EXPECT_EQ(knead::mesh::count_crossings(tools::wavy_tube(30, 40)).pairs, 0u);
  EXPECT_EQ(knead::mesh::count_crossings(tools::wavy_tube(30, 40, {1e6, 0, 0}, 1e-3)).pairs, 0u);
  // A corner that rests on another triangle, two triangles flat on each other, and the same triangle twice.
  EXPECT_EQ(knead::mesh::count_crossings(from_triangles({{0, 0, 0}, {4, 0, 0}, {0, 4, 0}, {1, 1, 0}, {1, 1, 1}, {2, 1, 1}})).pairs, 0u);
  EXPECT_EQ(knead::mesh::count_crossings(from_triangles({{0, 0, 0}, {4, 0, 0}, {0, 4, 0}, {1, 1, 0}, {3, 1, 0}, {2, 3, 0}})).pairs, 0u);
  EXPECT_EQ(knead::mesh::count_crossings(from_triangles({{0, 0, 0}, {4, 0, 0}, {0, 4, 0}, {0, 0, 0}, {4, 0, 0}, {0, 4, 0}})).pairs, 0u);
}

TEST(MeshCrossings, EdgesThatMeetEdgesCross) {
  // Mirror images meet edge on edge, in the mirror's plane.
  EXPECT_EQ(knead::mesh::count_crossings(from_triangles({{-1, 0, 1}, {1, 0, -1}, {-1, 1, 1}, {-1, 0, -1}, {1, 0, 1}, {-1, 1, -1}})).pairs, 1u);
}

TEST(MeshCrossings, ATangleIsGivenUpWithALowerBound) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> place(-1, 1);
  std::vector<Vec3d> corners;
  for (int i = 0; i < 3 * 3000; ++i) corners.push_back({place(random), place(random), place(random)});
  const Surface s = from_triangles(corners);
  const knead::mesh::Crossings found = knead::mesh::count_crossings(s);
  EXPECT_FALSE(found.complete);
  EXPECT_GT(found.pairs, 1000u);
  EXPECT_TRUE(tools::mentions(knead::describe_problems(s), "self-intersecting: at least"));
}

}  // namespace mesh_crossings_test
