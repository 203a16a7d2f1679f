#include "kernels/equilibrium/mesh_transfer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>

#include "kernels/build_tets/build_tets.h"
#include "kernels/shapes/primitives.h"
#include "tests/kernels/build_tets/tet_properties.h"

namespace knead {
namespace carry_test {

struct Body {
  std::unique_ptr<Executor> executor = make_serial_executor();
  BuiltTets built;
  std::shared_ptr<const EquilibriumRest> rest;

  Body(const Surface& surface, int depth, bool split = false) {
    std::vector<std::string> warnings;
    built = build_tets(surface, {.max_depth = depth, .min_depth = depth, .max_vertices = 1, .split_pieces = split}, *executor, warnings);
    rest = prepare_equilibrium(*executor, built.tets, built.lattice, {});
  }
  Vec3d at(uint32_t place) const { return built.tets.to_local.apply(to_double(built.tets.rest.host()[rest->vertex_at[place]])); }  // local space of M

  // The piece of H that a place belongs to.
  std::vector<uint32_t> pieces() const {
    const std::vector<uint32_t> by_vertex = tet_build_properties::components(built.tets);
    std::vector<uint32_t> by_place;
    for (const uint32_t v : rest->vertex_at) by_place.push_back(by_vertex[v]);
    return by_place;
  }
  uint32_t piece_of(uint32_t vertex_of_m) const { return pieces()[rest->samples.indices[rest->samples.offsets[vertex_of_m]]]; }
};

Vec3d transferred(const MeshTransfer& table, uint32_t place, const std::function<Vec3d(uint32_t)>& field) {
  Vec3d sum{0, 0, 0};
  for (size_t c = 0; c < 4; ++c) sum += static_cast<double>(table.weights[place][c]) * field(table.vertices[place][c]);
  return sum;
}

TEST(MeshTransfer, IsTheIdentityBetweenEqualMeshes) {
  const Body body(make_torus(1, 0.4, 24), 4), same(make_torus(1, 0.4, 24), 4);
  const MeshTransfer table = make_mesh_transfer(*body.executor, *body.rest, *same.rest);
  EXPECT_EQ(table.outside, 0u);
  for (uint32_t p = 0; p < table.size(); ++p)
    for (size_t c = 0; c < 4; ++c) ASSERT_NEAR(table.weights[p][c], table.vertices[p][c] == p ? 1.0f : 0.0f, 1e-5f) << p;
}

TEST(MeshTransfer, KeepsLinearFields) {
  const auto linear = [](const Vec3d& x) { return Vec3d{0.3 * x.x - x.y + 0.1, 0.2 * x.z, x.x + 0.7 * x.y - 0.5 * x.z}; };
  for (const Surface& surface : {make_torus(1, 0.4, 24), make_box({2, 1, 3}, 6)}) {
    const Body coarse(surface, 3), fine(surface, 5);
    const MeshTransfer table = make_mesh_transfer(*coarse.executor, *coarse.rest, *fine.rest);
    EXPECT_LT(table.outside, table.size() / 100);
    for (uint32_t p = 0; p < table.size(); ++p)
      ASSERT_LT(length(transferred(table, p, [&](uint32_t q) { return linear(coarse.at(q)); }) - linear(fine.at(p))), 1e-5) << p;
  }
}

TEST(MeshTransfer, ExtrapolatesWithinBounds) {
  const Surface surface = make_torus(1, 0.4, 24);
  const Body fine(surface, 5), coarse(surface, 3);  // the coarse H reaches out of the fine one
  const MeshTransfer table = make_mesh_transfer(*fine.executor, *fine.rest, *coarse.rest);
  EXPECT_GT(table.outside, 0u);
  for (const auto& weights : table.weights) {
    ASSERT_NEAR(weights[0] + weights[1] + weights[2] + weights[3], 1.0f, 1e-5f);
    ASSERT_GE(*std::min_element(weights.begin(), weights.end()), -1.0001f);
  }
}

// Two bars closer to each other than a cell, as lips are: their pieces lie in the same places.
TEST(MeshTransfer, DoesNotMixPiecesThatLieInTheSamePlace) {
  const Surface bar = make_box({0.4, 3, 0.4}, 12);
  std::vector<Vec3f> points(bar.points.host().begin(), bar.points.host().end());
  std::vector<uint32_t> triangles = bar.topology->triangles;
  const uint32_t each = static_cast<uint32_t>(points.size());
  for (uint32_t v = 0; v < each; ++v) points.push_back(points[v] + Vec3f{0.402f, 0.03f, 0.01f});
  for (const uint32_t v : bar.topology->triangles) triangles.push_back(each + v);
  const Surface lips = make_triangle_surface(points, triangles);

  const Body coarse(lips, 4, true), fine(lips, 5, true);
  ASSERT_GT(coarse.built.pieces_split, 10u);
  ASSERT_NE(coarse.piece_of(0), coarse.piece_of(each));
  ASSERT_NE(fine.piece_of(0), fine.piece_of(each));
  const std::vector<uint32_t> from = coarse.pieces(), to = fine.pieces();
  const uint32_t upper_from = coarse.piece_of(0), upper_to = fine.piece_of(0);
  const MeshTransfer table = make_mesh_transfer(*coarse.executor, *coarse.rest, *fine.rest);
  for (uint32_t p = 0; p < table.size(); ++p) {
    const Vec3d moved = transferred(table, p, [&](uint32_t q) { return Vec3d{from[q] == upper_from ? 1.0 : -1.0, 0, 0}; });
    ASSERT_NEAR(moved.x, to[p] == upper_to ? 1.0 : -1.0, 1e-5) << p;
  }
}

}  // namespace carry_test
}  // namespace knead
