#include "kernels/surface/closed_mesh.h"

#include <gtest/gtest.h>

#include <map>

#include "kernels/surface/mesh_distance.h"
#include "kernels/surface/winding_number.h"
#include "tests/kernels/triangle_soup.h"

namespace {

using knead::ClosedMesh;
using knead::Vec3d;
using knead::Vec3f;

struct ClosedMeshInput : knead::TriangleSoup {
  using TriangleSoup::TriangleSoup;
  ClosedMesh close() const { return knead::close_mesh(points, triangles); }
};

// Every edge is used as often one way as the other.
bool closed_as_a_chain(const ClosedMesh& mesh) {
  std::map<std::pair<uint32_t, uint32_t>, int> net;
  for (size_t t = 0; t < mesh.triangles.size(); t += 3)
    for (int k = 0; k < 3; ++k) {
      const uint32_t a = mesh.triangles[t + k], b = mesh.triangles[t + (k + 1) % 3];
      net[{std::min(a, b), std::max(a, b)}] += a < b ? 1 : -1;
    }
  for (const auto& [edge, times] : net)
    if (times != 0) return false;
  return true;
}

double closed_mesh_winding(const ClosedMesh& mesh, const Vec3d& p) {
  std::vector<Vec3d> points;
  for (const Vec3f& q : mesh.points) points.push_back(to_double(q));
  return knead::winding_number_exact(points, mesh.triangles, p);
}

TEST(ClosedMesh, LeavesACleanMeshAsItIs) {
  const ClosedMeshInput input(knead::make_sphere(1, 3));
  const ClosedMesh mesh = input.close();
  EXPECT_EQ(mesh.triangles, input.triangles);
  EXPECT_EQ(mesh.assumptions(), "");
  EXPECT_NEAR(mesh.volume, 4.153, 0.01);
  EXPECT_NEAR(mesh.area, 12.4, 0.2);
}

TEST(ClosedMesh, TurnsAMeshThatFacesInwards) {
  ClosedMeshInput input(knead::make_sphere(1, 3));
  const std::vector<uint32_t> good = input.triangles;
  for (size_t t = 0; t < input.triangles.size() / 3; ++t) input.turn(t);
  const ClosedMesh mesh = input.close();
  EXPECT_EQ(mesh.triangles, good);
  EXPECT_EQ(mesh.pieces_turned, 1u);
  EXPECT_NE(mesh.assumptions(), "");
}

TEST(ClosedMesh, MakesMixedNeighboursAgree) {
  ClosedMeshInput input(knead::make_torus(1, 0.3, 32));
  const std::vector<uint32_t> good = input.triangles;
  size_t turned = 0;
  for (size_t t = 0; t < input.triangles.size() / 3; t += 3) input.turn(t), ++turned;
  const ClosedMesh mesh = input.close();
  EXPECT_EQ(mesh.triangles, good);
  EXPECT_EQ(mesh.turned, turned);
}

TEST(ClosedMesh, KeepsACavityAndTurnsItWithItsShell) {
  for (const bool all_inside_out : {false, true}) {
    ClosedMeshInput input(knead::make_sphere(2, 3));
    input.add(knead::make_sphere(1, 3), {0, 0, 0}, true);
    if (all_inside_out)
      for (size_t t = 0; t < input.triangles.size() / 3; ++t) input.turn(t);
    const ClosedMesh mesh = input.close();
    EXPECT_NEAR(closed_mesh_winding(mesh, {0, 0, 0}), 0, 1e-9);
    EXPECT_NEAR(closed_mesh_winding(mesh, {1.5, 0, 0}), 1, 1e-9);
    EXPECT_EQ(mesh.pieces_turned, all_inside_out ? 2u : 0u);
  }
}

TEST(ClosedMesh, ClosesOpenings) {
  ClosedMeshInput input(knead::make_sphere(1, 4));
  std::vector<uint32_t> open;  // without the cap above y = 0.6
  for (size_t t = 0; t < input.triangles.size(); t += 3) {
    bool above = true;
    for (int k = 0; k < 3; ++k) above = above && input.points[input.triangles[t + k]].y > 0.6f;
    if (!above) open.insert(open.end(), input.triangles.begin() + t, input.triangles.begin() + t + 3);
  }
  input.triangles = open;
  const ClosedMesh mesh = input.close();
  EXPECT_TRUE(closed_as_a_chain(mesh));
  EXPECT_EQ(mesh.rims, 1u);
  EXPECT_NEAR(closed_mesh_winding(mesh, {0, 0, 0}), 1, 1e-9);
  EXPECT_NEAR(closed_mesh_winding(mesh, {0, 0.8, 0}), 0, 1e-9);
}

TEST(ClosedMesh, ClosesTheSeamOfADroppedFlatTriangleWithoutAWord) {
  // A box whose top has a T-junction: the flat triangle that joined its sides is missing, as in a mesh whose degenerate faces were left out.
  const std::vector<Vec3f> points{{0, 0, 0}, {1, 0, 0}, {1, 0, 1}, {0, 0, 1}, {0, 1, 0}, {1, 1, 0}, {1, 1, 1}, {0, 1, 1}, {0.5f, 1, 0}};
  const std::vector<uint32_t> triangles{0, 1, 2, 0, 2, 3,           // bottom
                                        4, 7, 6, 4, 6, 8, 8, 6, 5,  // top, which knows vertex 8
                                        0, 4, 5, 0, 5, 1,           // back, which does not
                                        1, 5, 6, 1, 6, 2, 2, 6, 7, 2, 7, 3, 3, 7, 4, 3, 4, 0};
  const ClosedMesh mesh = knead::close_mesh(points, triangles);
  EXPECT_TRUE(closed_as_a_chain(mesh));
  EXPECT_EQ(mesh.assumptions(), "");
  const knead::MeshDistance distance(std::span<const Vec3f>(mesh.points), mesh.triangles);
  EXPECT_TRUE(distance.closed());
  EXPECT_FALSE(distance.overlapping());
  EXPECT_NEAR(distance.signed_distance({0.5, 0.9, 0.2}).distance, -0.1, 1e-9);
  EXPECT_NEAR(distance.signed_distance({0.5, 0.9, 0.05}).distance, -0.05, 1e-9);
  EXPECT_NEAR(distance.signed_distance({0.5, 1.1, -0.1}).distance, std::sqrt(0.02), 1e-9);
}

TEST(ClosedMesh, WeldsASoupOfTriangles) {
  const knead::Surface box = knead::make_box({1, 1, 1}, 4);
  ClosedMeshInput input(box);
  input.points.clear();
  for (uint32_t& v : input.triangles) {
    input.points.push_back(box.points.host()[v]);
    v = static_cast<uint32_t>(input.points.size() - 1);
  }
  const ClosedMesh mesh = input.close();
  EXPECT_EQ(mesh.points.size(), box.vertices());
  EXPECT_EQ(mesh.rims, 0u);
  EXPECT_NEAR(mesh.volume, 1, 1e-6);
}

TEST(ClosedMesh, ClosesWhateverItIsGiven) {
  uint32_t state = 1;
  auto next = [&state] { return (state = state * 1664525u + 1013904223u) >> 8; };
  for (int trial = 0; trial < 200; ++trial) {
    ClosedMeshInput input(knead::make_sphere(1, 1));
    const size_t count = input.triangles.size() / 3;
    for (int k = 0; k < 6; ++k) {
      const size_t t = next() % count;
      switch (next() % 5) {
        case 0: input.turn(t); break;
        case 1: input.triangles[3 * t] = next() % static_cast<uint32_t>(input.points.size()); break;
        case 2: input.points[next() % input.points.size()].x = NAN; break;
        case 3:
          for (int c = 0; c < 3; ++c) input.triangles.push_back(input.triangles[3 * t + c]);
          break;
        default: input.triangles[3 * t + 1] = input.triangles[3 * t]; break;
      }
    }
    const ClosedMesh mesh = input.close();
    ASSERT_TRUE(closed_as_a_chain(mesh)) << trial;
    const knead::MeshDistance distance(std::span<const Vec3f>(mesh.points), mesh.triangles);
    ASSERT_TRUE(std::isfinite(distance.signed_distance({0.1, 0.2, 0.3}).distance)) << trial;
  }
}

TEST(ClosedMesh, HasNothingToSayAboutNothing) {
  EXPECT_TRUE(knead::close_mesh({}, {}).triangles.empty());
}

}  // namespace
