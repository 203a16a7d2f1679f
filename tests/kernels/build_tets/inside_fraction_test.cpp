#include "kernels/build_tets/inside_fraction.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "kernels/build_tets/build_tets.h"
#include "kernels/shapes/primitives.h"

namespace knead {
namespace inside_fraction_test {

BuiltTets built(const Surface& surface, const BuildTetsOptions& options = {}) {
  std::vector<std::string> said;
  return build_tets(surface, options, *make_serial_executor(), said);
}

// Of all tets, local units^3.
double flesh(const BuiltTets& build) {
  double sum = 0;
  for (size_t t = 0; t < build.tets.tets.size(); ++t) sum += double{build.inside.host()[t]} * double{build.tets.rest_volumes.host()[t]};
  return sum * std::pow(build.tets.to_local.scale, 3);
}

Surface turned_over(const Surface& surface) {
  std::vector<uint32_t> triangles = surface.topology->triangles;
  for (size_t t = 0; t < triangles.size(); t += 3) std::swap(triangles[t], triangles[t + 1]);
  return make_triangle_surface({surface.points.host().begin(), surface.points.host().end()}, triangles);
}

constexpr std::array<Vec3d, 4> kTet{Vec3d{0, 0, 0}, Vec3d{1, 0, 0}, Vec3d{0, 1, 0}, Vec3d{0, 0, 1}};

// The half space x < level as one large triangle that faces +x; turned so that all permutations of the corners are met.
TEST(MeanWinding, IsThePartOfATetOnOneSideOfAPlane) {
  std::array<size_t, 4> order{0, 1, 2, 3};
  do {
    std::array<Vec3d, 4> tet;
    for (size_t k = 0; k < 4; ++k) tet[k] = kTet[order[k]];
    if (dot(cross(tet[1] - tet[0], tet[2] - tet[0]), tet[3] - tet[0]) < 0) continue;
    for (const double level : {0.1, 0.5, 0.9})
      for (int axis = 0; axis < 3; ++axis) {
        std::array<Vec3d, 3> plane{Vec3d{level, -20, -20}, Vec3d{level, 40, -20}, Vec3d{level, -20, 40}};
        for (Vec3d& p : plane) p = axis == 0 ? p : axis == 1 ? Vec3d{p.z, p.x, p.y} : Vec3d{p.y, p.z, p.x};
        const double inside = 1 - std::pow(1 - level, 3);
        EXPECT_NEAR(mean_winding(tet, std::array<std::array<Vec3d, 3>, 1>{plane}, tet[3][axis] < level ? 1 : 0), inside, 1e-12);
        std::swap(plane[0], plane[1]);
        EXPECT_NEAR(mean_winding(tet, std::array<std::array<Vec3d, 3>, 1>{plane}, tet[3][axis] < level ? 0 : 1), 1 - inside, 1e-12);
      }
  } while (std::next_permutation(order.begin(), order.end()));
}

TEST(MeanWinding, IsTheVolumeOfABoxThatCutsFacesEdgesAndCorners) {
  std::minstd_rand random(7);
  const auto one = [&] { return static_cast<double>(random() % 10000) / 10000.0; };
  for (int trial = 0; trial < 50; ++trial) {
    const Surface box = make_box({0.4f + 0.4f * static_cast<float>(one()), 0.5f, 0.3f}, 3);
    const Vec3d shift{one() - 0.2, one() - 0.2, one() - 0.2};
    std::vector<std::array<Vec3d, 3>> triangles;
    Vec3d lower{9, 9, 9}, upper{-9, -9, -9};
    for (const Vec3f& p : box.points.host())
      for (int k = 0; k < 3; ++k) {
        lower[k] = std::min(lower[k], double{p[k]} + shift[k]);
        upper[k] = std::max(upper[k], double{p[k]} + shift[k]);
      }
    const auto& corners = box.topology->triangles;
    for (size_t t = 0; t < corners.size(); t += 3) {
      triangles.emplace_back();
      for (size_t k = 0; k < 3; ++k) triangles.back()[k] = to_double(box.points.host()[corners[t + k]]) + shift;
    }
    // Volume of {x, y, z >= lower, x + y + z <= 1} as a corner tet, by inclusion and exclusion over the box's corners.
    double expected = 0;
    for (int corner = 0; corner < 8; ++corner) {
      double left = 1;
      for (int k = 0; k < 3; ++k) left -= (corner >> k & 1) != 0 ? std::max(0.0, upper[k]) : std::max(0.0, lower[k]);
      expected += (__builtin_popcount(static_cast<unsigned>(corner)) % 2 == 0 ? 1 : -1) * std::pow(std::max(0.0, left), 3);
    }
    const Vec3d last = kTet[3];
    bool inside = true;
    for (int k = 0; k < 3; ++k) inside = inside && last[k] > lower[k] && last[k] < upper[k];
    EXPECT_NEAR(mean_winding(kTet, triangles, inside ? 1 : 0), expected, 1e-9) << trial;
  }
}

TEST(InsideFractions, AddUpToTheVolumeOfM) {
  const Surface shapes[] = {make_sphere(1, 3), make_box({1, 1, 1}, 4), make_torus(0.6, 0.25, 32), make_box({1, 0.004, 1}, 12), make_head(2, 1200)};
  for (const Surface& shape : shapes)
    for (const int depth : {3, 6})
      for (const bool split : {false, true}) {
        const BuiltTets build = built(shape, {.max_depth = depth, .split_pieces = split});
        EXPECT_NEAR(flesh(build), build.surface_volume, 2e-6 * build.surface_volume);
        for (const float part : build.inside.host()) EXPECT_TRUE(part >= 0 && part <= 1);
      }
}

TEST(InsideFractions, AreTheSameForASurfaceThatIsInsideOut) {
  const Surface torus = make_torus(0.6, 0.25, 32);
  for (const bool split : {false, true}) {
    const BuiltTets out = built(torus, {.split_pieces = split}), in = built(turned_over(torus), {.split_pieces = split});
    ASSERT_EQ(out.tets.tets.size(), in.tets.tets.size());
    for (size_t t = 0; t < out.tets.tets.size(); ++t) EXPECT_NEAR(out.inside.host()[t], in.inside.host()[t], 1e-6);
  }
}

TEST(InsideFractions, DoNotDependOnTheOrderOfTrianglesAndVertices) {
  const Surface torus = make_torus(0.6, 0.25, 32);
  std::vector<Vec3f> points(torus.points.host().begin(), torus.points.host().end());
  std::reverse(points.begin(), points.end());
  std::vector<uint32_t> triangles = torus.topology->triangles;
  for (uint32_t& v : triangles) v = static_cast<uint32_t>(points.size()) - 1 - v;
  std::rotate(triangles.begin(), triangles.begin() + 300, triangles.end());
  const BuiltTets one = built(torus), other = built(make_triangle_surface(points, triangles));
  ASSERT_EQ(one.tets.tets.size(), other.tets.tets.size());
  for (size_t t = 0; t < one.tets.tets.size(); ++t) EXPECT_NEAR(one.inside.host()[t], other.inside.host()[t], 1e-6);
}

// The hole's rim is of a sphere's cap: cells within reach of it may be off, no others.
TEST(InsideFractions, OfAnOpenBallAreOffOnlyAtItsHole) {
  const Surface ball = make_sphere(1, 3);
  std::vector<uint32_t> triangles;
  const auto points = ball.points.host();
  for (size_t t = 0; t < ball.topology->triangles.size(); t += 3) {
    const uint32_t* v = &ball.topology->triangles[t];
    if (points[v[0]].z + points[v[1]].z + points[v[2]].z < 3 * 0.95f) triangles.insert(triangles.end(), v, v + 3);
  }
  ASSERT_LT(triangles.size(), ball.topology->triangles.size());
  const BuiltTets build = built(make_triangle_surface({points.begin(), points.end()}, triangles));
  const double whole = built(ball).surface_volume;
  EXPECT_NEAR(flesh(build), whole, 0.03 * whole);
}

// Two balls closer than a cell: each copy of the cells between has one ball's material, and no more.
TEST(InsideFractions, OfCopiesAreOfTheirOwnPieces) {
  const Surface ball = make_sphere(1, 3);
  std::vector<Vec3f> points;
  std::vector<uint32_t> triangles;
  for (const float shift : {0.0f, 2.02f}) {
    const uint32_t first = static_cast<uint32_t>(points.size());
    for (const Vec3f& p : ball.points.host()) points.push_back(p + Vec3f{shift, 0, 0});
    for (const uint32_t v : ball.topology->triangles) triangles.push_back(first + v);
  }
  size_t split = 0;
  for (const int depth : {2, 3, 4, 5}) {
    const BuiltTets build = built(make_triangle_surface(points, triangles), {.max_depth = depth, .min_depth = 2, .split_pieces = true});
    split += build.pieces_split;
    EXPECT_NEAR(flesh(build), build.surface_volume, 2e-6 * build.surface_volume);
  }
  EXPECT_GT(split, 0u);
}

}  // namespace inside_fraction_test
}  // namespace knead
