#include "kernels/build_tets/lattice_coordinates.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <random>

#include "kernels/neighbour_table.h"

namespace knead {
namespace lattice_coordinates_test {

// The cube [-1, 1]^3 as a cage; with `hanging`, one face is a fan about its middle and the middles of its edges are vertices.
struct Cage {
  std::vector<Vec3d> vertices;
  std::vector<std::array<uint8_t, 3>> triangles;

  explicit Cage(bool hanging) {
    for (int c = 0; c < 8; ++c) vertices.push_back({c & 1 ? 1.0 : -1.0, c & 2 ? 1.0 : -1.0, c & 4 ? 1.0 : -1.0});
    quad(0, 2, 3, 1);
    if (!hanging) {
      quad(4, 5, 7, 6);
      quad(0, 1, 5, 4);
      quad(2, 6, 7, 3);
      quad(0, 4, 6, 2);
      quad(1, 3, 7, 5);
      return;
    }
    for (const Vec3d& p : {Vec3d{0, -1, 1}, Vec3d{1, 0, 1}, Vec3d{0, 1, 1}, Vec3d{-1, 0, 1}, Vec3d{0, 0, 1}}) vertices.push_back(p);
    const uint8_t ring[8] = {4, 8, 5, 9, 7, 10, 6, 11};
    for (size_t i = 0; i < 8; ++i) triangles.push_back({12, ring[i], ring[(i + 1) % 8]});
    fan(8, {5, 4, 0, 1});
    fan(10, {6, 7, 3, 2});
    fan(11, {4, 6, 2, 0});
    fan(9, {7, 5, 1, 3});
  }
  void quad(uint8_t a, uint8_t b, uint8_t c, uint8_t d) {
    triangles.push_back({a, b, c});
    triangles.push_back({a, c, d});
  }
  // The apex lies on the edge from the ring's first vertex to its second.
  void fan(uint8_t apex, std::array<uint8_t, 4> ring) {
    for (size_t i = 1; i < 4; ++i) {
      std::array<uint8_t, 3> t{apex, ring[i], ring[(i + 1) % 4]};
      const Vec3d &a = vertices[t[0]], &b = vertices[t[1]], &c = vertices[t[2]];
      if (dot(cross(b - a, c - a), a) < 0) std::swap(t[1], t[2]);
      triangles.push_back(t);
    }
  }
  std::vector<double> at(const Vec3d& p) const {
    std::vector<double> weights(vertices.size());
    mean_value_coordinates(vertices, triangles, p, weights);
    return weights;
  }
  Vec3d place(const std::vector<double>& weights) const {
    Vec3d sum{0, 0, 0};
    for (size_t i = 0; i < weights.size(); ++i) sum += weights[i] * vertices[i];
    return sum;
  }
};

TEST(LatticeCoordinates, BarycentricReproducesAndIsOneAtACorner) {
  const Vec3d a{0, 0, 0}, b{2, 0.1, 0}, c{0.3, 1.5, 0}, d{0.2, 0.4, 1.1}, p{0.5, 0.4, 0.2};
  const auto w = barycentric_coordinates(p, a, b, c, d);
  EXPECT_NEAR(length(w[0] * a + w[1] * b + w[2] * c + w[3] * d - p), 0, 1e-14);
  EXPECT_NEAR(barycentric_coordinates(c, a, b, c, d)[2], 1, 1e-14);
  EXPECT_LT(barycentric_coordinates({-1, 0, 0}, a, b, c, d)[1], 0);
}

TEST(LatticeCoordinates, TrilinearReproducesAndIsOneAtACorner) {
  const Vec3d p{0.3, 0.9, 0.45};
  const auto w = trilinear_coordinates(p);
  Vec3d at{0, 0, 0};
  for (size_t c = 0; c < 8; ++c) at += w[c] * Vec3d{double(c & 1), double(c >> 1 & 1), double(c >> 2)};
  EXPECT_NEAR(length(at - p), 0, 1e-15);
  EXPECT_EQ(trilinear_coordinates({1, 0, 1})[5], 1);
}

TEST(LatticeCoordinates, MeanValueReproducesIsPositiveAndSumsToOne) {
  std::mt19937 random(9);
  std::uniform_real_distribution<double> unit(-1, 1);
  for (const bool hanging : {false, true}) {
    const Cage cage(hanging);
    for (int i = 0; i < 5000; ++i) {
      Vec3d p{unit(random), unit(random), unit(random)};
      if (i % 4 == 1) p.z = 1 - std::pow(10, -1 - 10 * std::abs(unit(random)));  // near a face, down to where it counts as on it
      if (i % 4 == 2) p.y = p.x;                                                 // under a diagonal
      if (i % 4 == 3) p.x = -1 + std::pow(10, -1 - 10 * std::abs(unit(random))), p.y = 1 - std::pow(10, -1 - 10 * std::abs(unit(random)));
      const auto w = cage.at(p);
      ASSERT_NEAR(std::accumulate(w.begin(), w.end(), 0.0), 1, 1e-12);
      ASSERT_GE(*std::min_element(w.begin(), w.end()), -1e-9);
      ASSERT_NEAR(length(cage.place(w) - p), 0, 1e-6) << p.x << " " << p.y << " " << p.z;
    }
  }
}

TEST(LatticeCoordinates, MeanValueIsBarycentricOnTheCage) {
  const Cage cage(true);
  for (const Vec3d& p : {Vec3d{1, 1, 1}, Vec3d{0, 0, 1}, Vec3d{1, -1, -1}}) {
    const auto w = cage.at(p);
    EXPECT_EQ(*std::max_element(w.begin(), w.end()), 1);
  }
  const auto on_edge = cage.at({-0.5, -1, 1});
  EXPECT_NEAR(on_edge[4], 0.5, 1e-12);
  EXPECT_NEAR(on_edge[8], 0.5, 1e-12);
  const auto on_face = cage.at({0.6, 0.2, 1});
  EXPECT_NEAR(on_face[12] + on_face[9] + on_face[7], 1, 1e-12);
  const auto below = cage.at({0.6, 0.2, 1 - 1e-5});
  for (size_t i = 0; i < below.size(); ++i) EXPECT_NEAR(below[i], on_face[i], 1e-4);  // continuous
}

TEST(LatticeCoordinates, GatherListsEachInfluenceOverTheirSum) {
  LatticeRows rows;
  rows.offsets = {0, 2, 3, 4};
  rows.indices = {1, 4, 1, 2};
  rows.weights = {0.25f, 0.75f, 1.0f, 1.0f};
  const std::vector<uint8_t> used{1, 1, 0};
  const auto executor = make_serial_executor();
  Lattice lattice;
  fill_lattice_tables(rows, used, 6, lattice, *executor);
  EXPECT_EQ(lattice.map.lanes, 3u);
  EXPECT_EQ(lattice.gather.lanes, 2u);  // vertex 2 of H is held by a vertex of M that does not move the body
  const auto gather = neighbours_by_vertex(lattice.gather, 6);
  ASSERT_EQ(gather[1].size(), 2u);
  EXPECT_FLOAT_EQ(gather[1][0].value, 0.2f);
  EXPECT_FLOAT_EQ(gather[1][1].value, 0.8f);
  ASSERT_EQ(gather[4].size(), 1u);
  EXPECT_FLOAT_EQ(gather[4][0].value, 1);
  EXPECT_TRUE(gather[2].empty());
}

}  // namespace lattice_coordinates_test
}  // namespace knead
