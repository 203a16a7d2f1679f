#include "io/mesh/triangulate.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>
#include <vector>

namespace triangulate_test {

using knead::MeshTopology;
using knead::TriangulationNotes;
using knead::Vec3d;
using knead::Vec3f;

struct Cut {
  MeshTopology topology;
  TriangulationNotes notes;
  double area = 0, signed_area = 0;  // of the triangles; signed: along +z
};

Cut cut_polygon(const std::vector<Vec3f>& points) {
  Cut cut;
  cut.topology.face_offsets = {0, static_cast<uint32_t>(points.size())};
  for (uint32_t i = 0; i < points.size(); ++i) cut.topology.face_vertices.push_back(i);
  cut.notes = knead::triangulate(points, cut.topology);
  for (size_t t = 0; t < cut.topology.triangle_count(); ++t) {
    const std::array corners{cut.topology.triangles[3 * t], cut.topology.triangles[3 * t + 1], cut.topology.triangles[3 * t + 2]};
    const Vec3d area = knead::area_vector(points, corners) * 0.5;
    cut.area += length(area);
    cut.signed_area += area.z;
  }
  return cut;
}

double polygon_area(const std::vector<Vec3f>& points) {
  std::vector<uint32_t> corners;
  for (uint32_t i = 0; i < points.size(); ++i) corners.push_back(i);
  return 0.5 * length(knead::area_vector(points, corners));
}

// A simple polygon: angles in order, wild radii.
std::vector<Vec3f> spiky(int corners, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> radius(0.05f, 1);
  std::vector<Vec3f> points;
  for (int i = 0; i < corners; ++i) {
    const float angle = 6.2831853f * static_cast<float>(i) / static_cast<float>(corners), r = radius(random);
    points.push_back({r * std::cos(angle), r * std::sin(angle), 0});
  }
  return points;
}

TEST(Triangulate, ConvexPolygonsAreFansFromTheFirstCorner) {
  const Cut cut = cut_polygon({{0, 0, 0}, {2, 0, 0}, {3, 1, 0}, {1, 2, 0}, {0, 1, 0}});
  EXPECT_EQ(cut.topology.triangles, (std::vector<uint32_t>{0, 1, 2, 0, 2, 3, 0, 3, 4}));
}

TEST(Triangulate, ConcaveQuadsAreCutAtTheInwardCorner) {
  // The arrow head: whichever corner comes first, the diagonal goes through the inward one.
  const std::vector<Vec3f> arrow{{0, 0, 0}, {2, -1, 0}, {0.5f, 0, 0}, {2, 1, 0}};
  for (size_t turn = 0; turn < 4; ++turn) {
    std::vector<Vec3f> turned;
    for (size_t i = 0; i < 4; ++i) turned.push_back(arrow[(i + turn) % 4]);
    const Cut cut = cut_polygon(turned);
    EXPECT_EQ(cut.topology.triangle_count(), 2u);
    EXPECT_NEAR(cut.area, polygon_area(arrow), 1e-6) << turn;
    EXPECT_EQ(cut.notes.tangled_faces, 0u);
  }
}

TEST(Triangulate, SimplePolygonsAreCoveredOnce) {
  for (unsigned seed = 0; seed < 60; ++seed) {
    const std::vector<Vec3f> points = spiky(5 + static_cast<int>(seed % 37), seed);
    const Cut cut = cut_polygon(points);
    EXPECT_EQ(cut.notes.tangled_faces, 0u) << seed;
    EXPECT_EQ(cut.topology.triangle_count(), points.size() - 2) << seed;
    EXPECT_NEAR(cut.area, polygon_area(points), 1e-5) << seed;
    EXPECT_NEAR(cut.signed_area, cut.area, 1e-5) << seed;
  }
}

TEST(Triangulate, AnySizeAndAnyPlaneGivesTheSameCut) {
  const std::vector<Vec3f> points = spiky(23, 5);
  const Cut flat = cut_polygon(points);
  for (const float scale : {1e-12f, 1e12f}) {
    std::vector<Vec3f> other;
    for (const Vec3f& p : points) other.push_back({0.3f * p.x * scale, p.y * scale, -p.x * scale});
    EXPECT_EQ(cut_polygon(other).topology.triangles.size(), flat.topology.triangles.size());
    EXPECT_EQ(cut_polygon(other).notes.tangled_faces, 0u);
  }
}

TEST(Triangulate, CollinearCornersAreKeptAndCoverTheSameArea) {
  const Cut cut = cut_polygon({{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {2, 1, 0}, {2, 2, 0}, {1, 2, 0}, {0, 2, 0}, {0, 1, 0}});
  EXPECT_EQ(cut.topology.triangle_count(), 6u);
  EXPECT_NEAR(cut.area, 4, 1e-12);
}

TEST(Triangulate, KeyholePolygonsLeaveTheirHoleOpen) {
  // A square with a square hole, joined by a bridge that is walked twice, on the same two places.
  const Cut cut = cut_polygon({{0, 0, 0}, {4, 0, 0}, {4, 4, 0}, {0, 4, 0}, {0, 0, 0}, {1, 1, 0}, {1, 3, 0}, {3, 3, 0}, {3, 1, 0}, {1, 1, 0}});
  EXPECT_NEAR(cut.area, 12, 1e-9);
}

TEST(Triangulate, RepeatedCornersAndFlatFacesAreLeftOut) {
  const std::vector<Vec3f> points{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {0, 1, 0}, {1, 0, 0}};
  MeshTopology topology;
  topology.face_offsets = {0, 3, 6, 9, 13};
  topology.face_vertices = {0, 1, 1, /**/ 0, 1, 2, /**/ 1, 4, 3, /**/ 0, 1, 1, 3};
  const TriangulationNotes notes = knead::triangulate(points, topology);
  EXPECT_EQ(topology.triangles, (std::vector<uint32_t>{0, 1, 3}));  // a quad with a repeated corner is a triangle
  EXPECT_EQ(topology.triangle_faces, (std::vector<uint32_t>{3}));
  EXPECT_EQ(notes.degenerate_faces, 3u);
  EXPECT_EQ(notes.repeated_corners, 1u);
}

TEST(Triangulate, TangledPolygonsAreCutAllTheSame) {
  std::mt19937 random(7);
  std::uniform_real_distribution<float> any(-1, 1);
  for (int corners = 4; corners < 60; ++corners) {
    std::vector<Vec3f> points;
    for (int i = 0; i < corners; ++i) points.push_back({any(random), any(random), any(random)});
    EXPECT_EQ(cut_polygon(points).topology.triangle_count(), points.size() - 2);
  }
  EXPECT_EQ(cut_polygon({{0, 0, 0}, {1, 1, 0}, {1, 0, 0}, {0, 1, 0}}).topology.triangle_count(), 2u);  // the bow tie
}

TEST(Triangulate, ThousandsOfCornersAreNoTrouble) {
  const std::vector<Vec3f> points = spiky(4000, 3);
  const Cut cut = cut_polygon(points);
  EXPECT_NEAR(cut.area / polygon_area(points), 1, 1e-3);
  std::vector<Vec3f> circle;
  for (int i = 0; i < 200000; ++i)
    circle.push_back({std::cos(6.2831853f * static_cast<float>(i) / 200000), std::sin(6.2831853f * static_cast<float>(i) / 200000), 0});
  EXPECT_NEAR(cut_polygon(circle).area, 3.14159, 1e-2);
}

}  // namespace triangulate_test
