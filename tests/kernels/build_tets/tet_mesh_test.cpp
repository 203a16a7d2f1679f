#include <gtest/gtest.h>

#include <random>

#include "graph/error.h"
#include "kernels/build_tets/build_tets.h"
#include "tests/kernels/build_tets/tet_properties.h"
#include "tests/kernels/triangle_soup.h"

namespace knead {
namespace tet_build_test {

using tet_build_properties::components;
using tet_build_properties::wrong;

BuiltTets built(const Surface& surface, const BuildTetsOptions& options = {}, std::vector<std::string>* warnings = nullptr, int threads = 2) {
  std::vector<std::string> said;
  const auto executor = threads == 1 ? make_serial_executor() : make_cpu_executor(threads);
  BuiltTets build = build_tets(surface, options, *executor, said);
  if (warnings) *warnings = said;
  return build;
}

bool says(const std::vector<std::string>& warnings, const std::string& part) {
  return std::any_of(warnings.begin(), warnings.end(), [&](const std::string& w) { return w.find(part) != std::string::npos; });
}

TEST(BuiltTets, KeepsEveryPropertyOnClosedShapes) {
  const Surface shapes[] = {make_sphere(1, 3),      make_box({1, 1, 1}, 4),      make_capsule(0.3, 2, 8),
                            make_torus(1, 0.3, 32), make_box({1, 0.004, 1}, 12), make_head(2, 1200)};
  for (const Surface& shape : shapes)
    for (const LatticeKind kind : {LatticeKind::kBarycentric, LatticeKind::kTrilinear, LatticeKind::kMeanValue})
      for (const bool split : {false, true}) {
        const BuildTetsOptions options{.max_depth = 5, .min_depth = 3, .max_vertices = 4, .split_pieces = split, .lattice = kind};
        std::vector<std::string> warnings;
        const BuiltTets build = built(shape, options, &warnings);
        EXPECT_EQ(wrong(build, shape, kind), "");
        EXPECT_TRUE(warnings.empty()) << warnings[0];
        EXPECT_GT(build.tet_volume, build.surface_volume);
      }
}

TEST(BuiltTets, KnowsTheVolumeOfM) {
  EXPECT_NEAR(built(make_box({2, 3, 4}, 4)).surface_volume, 24, 1e-4);
}

TEST(BuiltTets, HonoursItsDepths) {
  const Surface sphere = make_sphere(1, 4);
  for (const int depth : {1, 2, 4, 6}) EXPECT_LE(built(sphere, {.max_depth = depth, .min_depth = 0, .max_vertices = 1}).depth, depth);
  for (const TetCell& cell : built(sphere, {.max_depth = 5, .min_depth = 4, .max_vertices = 1000}).cells) EXPECT_EQ(cell.level, 4);
  EXPECT_EQ(wrong(built(sphere, {.max_depth = 1, .min_depth = 0, .max_vertices = 100000}), sphere), "");
}

// However few vertices M has, and never beyond max_depth: a box of twelve triangles, a torus of large faces, a surface with a hole.
TEST(BuiltTets, SplitsWhateverTheSurfaceTouches) {
  const Surface torus = make_torus(0.6, 0.25, 16);
  std::vector<uint32_t> open = torus.topology->triangles;
  open.resize(open.size() - 30);
  const Surface shapes[] = {make_box({1, 2, 3}, 1), torus, make_triangle_surface({torus.points.host().begin(), torus.points.host().end()}, open)};
  for (const Surface& shape : shapes)
    for (const int depth : {1, 3, 5}) {
      const BuildTetsOptions options{.max_depth = depth, .min_depth = std::min(2, depth), .surface_depth = 5};
      const BuiltTets build = built(shape, options);
      EXPECT_EQ(wrong(build, shape), "");
      EXPECT_EQ(build.depth, depth);
      for (const uint32_t cell : build.cell_of_vertex) EXPECT_EQ(build.cells[cell].level, depth);
      double cut = 0;  // Tets that M cuts are as small as they get, so that they hold little.
      for (size_t t = 0; t < build.tets.tets.size(); ++t)
        if (build.inside.host()[t] > 0.01f && build.inside.host()[t] < 0.99f)
          cut = std::max(cut, static_cast<double>(build.tets.rest_volumes.host()[t]));
      EXPECT_LE(cut, 1.0) << "cells of the finest level have an edge of 1";
    }
}

// A copy of a closed body's cell where one cell would have done would show in the counts.
TEST(BuiltTets, SplitsNothingWhereThereIsNoGap) {
  for (const Surface& shape : {make_sphere(1, 3), make_box({1, 1, 1}, 4), make_box({1, 0.004, 1}, 12)}) {
    const BuiltTets whole = built(shape, {.split_pieces = false}), split = built(shape, {.split_pieces = true});
    EXPECT_EQ(split.pieces_split, 0u);
    EXPECT_EQ(split.cells.size(), whole.cells.size());
    EXPECT_LT(split.tets.vertices(), 1.02 * static_cast<double>(whole.tets.vertices()));
  }
}

// Which components of H the vertices [begin, end) of M hang on.
std::set<uint32_t> components_of(const BuiltTets& build, uint32_t begin, uint32_t end) {
  const std::vector<uint32_t> component = components(build.tets);
  const auto rows = neighbours_by_vertex(build.lattice.map, build.lattice.map.lanes);
  std::set<uint32_t> found;
  for (uint32_t v = begin; v < end; ++v)
    for (const Neighbour& n : rows[v]) found.insert(component[n.indices[0]]);
  return found;
}

TEST(BuiltTets, FingersCloserThanACellComeApart) {
  // Cells of the finest level are 0.1 wide; the gap is a tenth of that.
  for (const double gap : {0.01, 0.002})
    for (const Surface& finger : {make_capsule(0.2, 3, 8), make_box({0.4, 3, 0.4}, 12)}) {
      TriangleSoup two(finger);
      const uint32_t each = static_cast<uint32_t>(two.points.size());
      two.add(finger, {static_cast<float>(0.4 + gap), 0.03f, 0.01f});
      const Surface hand = two.surface();
      const BuildTetsOptions options{.max_depth = 5, .min_depth = 5, .max_vertices = 1000000, .split_pieces = true};
      const BuiltTets split = built(hand, options);
      EXPECT_EQ(wrong(split, hand), "");
      EXPECT_GT(split.pieces_split, 10u);
      const auto left = components_of(split, 0, each), right = components_of(split, each, 2 * each);
      EXPECT_EQ(left.size(), 1u);
      EXPECT_EQ(right.size(), 1u);
      EXPECT_NE(left, right);
      BuildTetsOptions whole = options;
      whole.split_pieces = false;
      EXPECT_EQ(components_of(built(hand, whole), 0, 2 * each).size(), 1u);
    }
}

// Two prongs on one base: the gap opens and H still hangs together through the base.
TEST(BuiltTets, ProngsOfAForkComeApartUpToTheirBase) {
  const float gap = 0.02f, high = 2, base = 0.5f;
  TriangleSoup fork;  // a U in the xy plane, extruded along z: two columns and a bar, made of one closed outline
  const std::vector<std::array<float, 2>> outline{{0, 0},       {1 + gap, 0}, {1 + gap, high}, {0.5f + gap, high}, {0.5f + gap, base},
                                                  {0.5f, base}, {0.5f, high}, {0, high}};
  for (const float z : {0.0f, 0.5f})
    for (const auto& p : outline) fork.points.push_back({p[0], p[1], z});
  for (uint32_t i = 0; i < 8; ++i) {
    const uint32_t j = (i + 1) % 8;
    fork.triangles.insert(fork.triangles.end(), {i, j, 8 + j, i, 8 + j, 8 + i});
  }
  for (const auto& t : std::vector<std::array<uint32_t, 3>>{{0, 1, 4}, {0, 4, 5}, {1, 2, 3}, {1, 3, 4}, {0, 5, 6}, {0, 6, 7}}) {
    fork.triangles.insert(fork.triangles.end(), {t[0], t[2], t[1]});
    fork.triangles.insert(fork.triangles.end(), {8 + t[0], 8 + t[1], 8 + t[2]});
  }
  const Surface surface = fork.surface();
  std::vector<std::string> warnings;
  const BuiltTets build = built(surface, {.max_depth = 5, .min_depth = 5, .split_pieces = true}, &warnings);
  EXPECT_TRUE(warnings.empty()) << warnings[0];
  EXPECT_EQ(wrong(build, surface), "");
  EXPECT_GT(build.pieces_split, 10u);
  EXPECT_EQ(components_of(build, 0, 16).size(), 1u);
  // The two inner corners at the top face each other over the gap and share no vertex of H.
  const auto rows = neighbours_by_vertex(build.lattice.map, 16);
  for (const Neighbour& a : rows[3])
    for (const Neighbour& b : rows[6]) EXPECT_NE(a.indices[0], b.indices[0]);
}

TEST(BuiltTets, IsTheSameForAnyNumberOfThreads) {
  const Surface head = make_head(2, 3000);
  const BuiltTets a = built(head, {}, nullptr, 1), b = built(head, {}, nullptr, 2);
  EXPECT_TRUE(std::ranges::equal(a.tets.tets.host(), b.tets.tets.host()));
  EXPECT_TRUE(std::ranges::equal(a.lattice.map.indices.host(), b.lattice.map.indices.host()));
  EXPECT_TRUE(std::ranges::equal(a.lattice.map.values.host(), b.lattice.map.values.host()));
  EXPECT_TRUE(std::ranges::equal(a.tets.vertex_tets.indices.host(), b.tets.vertex_tets.indices.host()));
}

// H in its own units must not see where M is, how large, or in which order its vertices come.
TEST(BuiltTets, ScaleOffsetAndOrderOfVerticesDoNotChangeH) {
  const Surface head = make_head(2, 1500);
  const BuiltTets plain = built(head);
  const auto same = [&](const BuiltTets& other, const char* how) {
    SCOPED_TRACE(how);
    ASSERT_EQ(plain.tets.vertices(), other.tets.vertices());
    EXPECT_TRUE(std::ranges::equal(plain.tets.tets.host(), other.tets.tets.host()));
    for (size_t v = 0; v < plain.tets.vertices(); ++v) {
      const Vec3f d = plain.tets.rest.host()[v] - other.tets.rest.host()[v];
      ASSERT_EQ(std::abs(d.x) + std::abs(d.y) + std::abs(d.z), 0);
    }
  };
  for (const float scale : {1e-4f, 1e4f}) {
    TriangleSoup scaled(head);
    for (Vec3f& p : scaled.points) p = scale * p;
    same(built(scaled.surface()), "scaled");
  }
  TriangleSoup moved(head);
  for (Vec3f& p : moved.points) p += {64, -32, 16};
  TriangleSoup back = moved;  // rounding as in `moved`, at the old place
  for (Vec3f& p : back.points) p += {-64, 32, -16};
  const BuiltTets there = built(moved.surface()), here = built(back.surface());
  EXPECT_TRUE(std::ranges::equal(there.tets.tets.host(), here.tets.tets.host()));
  TriangleSoup turned(head);
  const uint32_t n = static_cast<uint32_t>(turned.points.size());
  std::reverse(turned.points.begin(), turned.points.end());
  for (uint32_t& v : turned.triangles) v = n - 1 - v;
  std::reverse(turned.triangles.begin(), turned.triangles.end());
  for (size_t t = 0; t < turned.triangles.size(); t += 3) std::swap(turned.triangles[t], turned.triangles[t + 1]);
  const Surface reversed = turned.surface();
  same(built(reversed), "reversed");
}

TEST(BuiltTets, SymmetryPlanesDoNotFallOnCellFaces) {
  TriangleSoup shaken(make_box({1, 1, 1}, 8));
  const BuiltTets plain = built(shaken.surface(), {.max_depth = 6, .max_vertices = 1});
  std::mt19937 random(1);
  for (Vec3f& p : shaken.points)
    for (int k = 0; k < 3; ++k) p[k] += 1e-7f * static_cast<float>(random() % 3) - 1e-7f;
  const BuiltTets other = built(shaken.surface(), {.max_depth = 6, .max_vertices = 1});
  EXPECT_TRUE(std::ranges::equal(plain.tets.tets.host(), other.tets.tets.host()));
}

TEST(BuiltTets, LooseVerticesFollowTheNearestCellAndDoNotMoveTheBody) {
  TriangleSoup sphere(make_sphere(1, 2));
  const uint32_t loose = static_cast<uint32_t>(sphere.points.size());
  sphere.points.insert(sphere.points.end(), {{0.1f, 0, 0}, {50, 0, 0}, {1e30f, -1e30f, 0}, {NAN, 0, 0}, {0, INFINITY, 0}});
  const Surface surface = sphere.surface();
  const BuiltTets build = built(surface), plain = built(make_sphere(1, 2));
  EXPECT_EQ(wrong(build, surface), "");
  EXPECT_TRUE(std::ranges::equal(build.tets.tets.host(), plain.tets.tets.host()));
  const auto rows = neighbours_by_vertex(build.lattice.map, loose + 5);
  Vec3d at[5];
  for (uint32_t v = 0; v < 5; ++v) {
    at[v] = {0, 0, 0};
    double sum = 0;
    for (const Neighbour& n : rows[loose + v]) {
      at[v] += double{n.value} * build.tets.to_local.apply(to_double(build.tets.rest.host()[n.indices[0]]));
      sum += double{n.value};
    }
    EXPECT_NEAR(sum, 1, 1e-6);
  }
  EXPECT_NEAR(at[0].x, 0.1, 1e-5);
  EXPECT_GT(at[1].x, 0.9);
  for (const auto& list : neighbours_by_vertex(build.lattice.gather, static_cast<uint32_t>(build.tets.vertices())))
    for (const Neighbour& n : list) EXPECT_LT(n.indices[0], loose);
}

TEST(BuiltTets, SaysWhatItAssumed) {
  std::vector<std::string> warnings;
  TriangleSoup open(make_sphere(1, 3));
  open.triangles.resize(open.triangles.size() - 30);
  const double whole = built(make_sphere(1, 3)).tet_volume;
  EXPECT_NEAR(built(open.surface(), {}, &warnings).tet_volume, whole, 0.05 * whole);  // inside is kept although a hole leads there
  EXPECT_TRUE(says(warnings, "open"));

  TriangleSoup inward(make_sphere(1, 3));
  for (size_t t = 0; t < inward.triangles.size(); t += 3) std::swap(inward.triangles[t], inward.triangles[t + 1]);
  EXPECT_EQ(built(inward.surface(), {}, &warnings).tet_volume, whole);
  EXPECT_TRUE(says(warnings, "inwards"));

  TriangleSoup mixed(make_sphere(1, 3));
  for (size_t t = 0; t < mixed.triangles.size(); t += 9) std::swap(mixed.triangles[t], mixed.triangles[t + 1]);
  EXPECT_EQ(built(mixed.surface(), {}, &warnings).tet_volume, whole);
  EXPECT_TRUE(says(warnings, "orientation"));

  TriangleSoup book(make_sphere(1, 3));
  book.points.push_back({2, 0, 0});
  book.triangles.insert(book.triangles.end(), {book.triangles[0], book.triangles[1], static_cast<uint32_t>(book.points.size() - 1)});
  built(book.surface(), {}, &warnings);
  EXPECT_TRUE(says(warnings, "manifold"));

  Surface surface = make_sphere(1, 3);
  std::vector<Vec3f> broken(surface.points.host().begin(), surface.points.host().end());
  broken[5].y = NAN;
  surface.points = Buffer<Vec3f>(broken);
  EXPECT_EQ(wrong(built(surface, {}, &warnings), surface), "");
  EXPECT_TRUE(says(warnings, "not finite"));
}

TEST(BuiltTets, SoupOfAClosedSurfaceIsTheSurface) {
  const Surface sphere = make_sphere(1, 3);
  TriangleSoup soup;
  for (const uint32_t v : sphere.topology->triangles) {
    soup.triangles.push_back(static_cast<uint32_t>(soup.points.size()));
    soup.points.push_back(sphere.points.host()[v]);
  }
  std::vector<std::string> warnings;
  const BuiltTets a = built(sphere), b = built(soup.surface(), {}, &warnings);
  EXPECT_TRUE(warnings.empty());
  EXPECT_TRUE(std::ranges::equal(a.tets.tets.host(), b.tets.tets.host()));
}

TEST(BuiltTets, RefusesOnlyWhatHasNoTriangles) {
  EXPECT_THROW(built(Surface{}), Error);
  EXPECT_THROW(built(make_triangle_surface({{0, 0, 0}, {1, 0, 0}}, {})), Error);
  const float nan = NAN;
  EXPECT_THROW(built(make_triangle_surface({{nan, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {0, 1, 2})), Error);
  EXPECT_THROW(built(make_sphere(1, 1), {.max_depth = 13}), Error);
  EXPECT_THROW(built(make_sphere(1, 1), {.max_depth = 3, .min_depth = 4}), Error);
}

// --- bad meshes ---

}  // namespace tet_build_test
}  // namespace knead
