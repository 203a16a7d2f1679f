#include "kernels/build_tets/build_tets.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <random>

#include "graph/error.h"
#include "io/mesh/mesh_io.h"
#include "kernels/shapes/primitives.h"
#include "tests/kernels/build_tets/tet_properties.h"
#include "tests/paths.h"

namespace knead {
namespace tet_build_test {

using tet_build_properties::components;
using tet_build_properties::wrong;

struct Triangles {
  std::vector<Vec3f> points;
  std::vector<uint32_t> corners;

  Triangles() = default;
  explicit Triangles(const Surface& surface)
      : points(surface.points.host().begin(), surface.points.host().end()), corners(surface.topology->triangles) {}
  Triangles& add(const Surface& surface, const Vec3f& shift) {
    const uint32_t first = static_cast<uint32_t>(points.size());
    for (const Vec3f& p : surface.points.host()) points.push_back(p + shift);
    for (const uint32_t v : surface.topology->triangles) corners.push_back(first + v);
    return *this;
  }
  Surface surface() const { return make_triangle_surface(points, corners); }
};

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
      Triangles two(finger);
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
  Triangles fork;  // a U in the xy plane, extruded along z: two columns and a bar, made of one closed outline
  const std::vector<std::array<float, 2>> outline{{0, 0},       {1 + gap, 0}, {1 + gap, high}, {0.5f + gap, high}, {0.5f + gap, base},
                                                  {0.5f, base}, {0.5f, high}, {0, high}};
  for (const float z : {0.0f, 0.5f})
    for (const auto& p : outline) fork.points.push_back({p[0], p[1], z});
  for (uint32_t i = 0; i < 8; ++i) {
    const uint32_t j = (i + 1) % 8;
    fork.corners.insert(fork.corners.end(), {i, j, 8 + j, i, 8 + j, 8 + i});
  }
  for (const auto& t : std::vector<std::array<uint32_t, 3>>{{0, 1, 4}, {0, 4, 5}, {1, 2, 3}, {1, 3, 4}, {0, 5, 6}, {0, 6, 7}}) {
    fork.corners.insert(fork.corners.end(), {t[0], t[2], t[1]});
    fork.corners.insert(fork.corners.end(), {8 + t[0], 8 + t[1], 8 + t[2]});
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
    Triangles scaled(head);
    for (Vec3f& p : scaled.points) p = scale * p;
    same(built(scaled.surface()), "scaled");
  }
  Triangles moved(head);
  for (Vec3f& p : moved.points) p += {64, -32, 16};
  Triangles back = moved;  // rounding as in `moved`, at the old place
  for (Vec3f& p : back.points) p += {-64, 32, -16};
  const BuiltTets there = built(moved.surface()), here = built(back.surface());
  EXPECT_TRUE(std::ranges::equal(there.tets.tets.host(), here.tets.tets.host()));
  Triangles turned(head);
  const uint32_t n = static_cast<uint32_t>(turned.points.size());
  std::reverse(turned.points.begin(), turned.points.end());
  for (uint32_t& v : turned.corners) v = n - 1 - v;
  std::reverse(turned.corners.begin(), turned.corners.end());
  for (size_t t = 0; t < turned.corners.size(); t += 3) std::swap(turned.corners[t], turned.corners[t + 1]);
  const Surface reversed = turned.surface();
  same(built(reversed), "reversed");
}

TEST(BuiltTets, SymmetryPlanesDoNotFallOnCellFaces) {
  Triangles shaken(make_box({1, 1, 1}, 8));
  const BuiltTets plain = built(shaken.surface(), {.max_depth = 6, .max_vertices = 1});
  std::mt19937 random(1);
  for (Vec3f& p : shaken.points)
    for (int k = 0; k < 3; ++k) p[k] += 1e-7f * static_cast<float>(random() % 3) - 1e-7f;
  const BuiltTets other = built(shaken.surface(), {.max_depth = 6, .max_vertices = 1});
  EXPECT_TRUE(std::ranges::equal(plain.tets.tets.host(), other.tets.tets.host()));
}

TEST(BuiltTets, LooseVerticesFollowTheNearestCellAndDoNotMoveTheBody) {
  Triangles sphere(make_sphere(1, 2));
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
  Triangles open(make_sphere(1, 3));
  open.corners.resize(open.corners.size() - 30);
  const double whole = built(make_sphere(1, 3)).tet_volume;
  EXPECT_NEAR(built(open.surface(), {}, &warnings).tet_volume, whole, 0.05 * whole);  // inside is kept although a hole leads there
  EXPECT_TRUE(says(warnings, "open"));

  Triangles inward(make_sphere(1, 3));
  for (size_t t = 0; t < inward.corners.size(); t += 3) std::swap(inward.corners[t], inward.corners[t + 1]);
  EXPECT_EQ(built(inward.surface(), {}, &warnings).tet_volume, whole);
  EXPECT_TRUE(says(warnings, "inwards"));

  Triangles mixed(make_sphere(1, 3));
  for (size_t t = 0; t < mixed.corners.size(); t += 9) std::swap(mixed.corners[t], mixed.corners[t + 1]);
  EXPECT_EQ(built(mixed.surface(), {}, &warnings).tet_volume, whole);
  EXPECT_TRUE(says(warnings, "orientation"));

  Triangles book(make_sphere(1, 3));
  book.points.push_back({2, 0, 0});
  book.corners.insert(book.corners.end(), {book.corners[0], book.corners[1], static_cast<uint32_t>(book.points.size() - 1)});
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
  Triangles soup;
  for (const uint32_t v : sphere.topology->triangles) {
    soup.corners.push_back(static_cast<uint32_t>(soup.points.size()));
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

Triangles random_soup(std::mt19937& random, uint32_t count, bool shared) {
  std::uniform_real_distribution<float> place(-1, 1), small(-0.2f, 0.2f);
  Triangles soup;
  for (uint32_t t = 0; t < count; ++t) {
    const Vec3f at{place(random), place(random), place(random)};
    const float size = random() % 4 == 0 ? 5.0f : 1.0f;
    for (int k = 0; k < 3; ++k) {
      soup.corners.push_back(static_cast<uint32_t>(soup.points.size()));
      soup.points.push_back(at + size * Vec3f{small(random), small(random), small(random)});
    }
  }
  if (shared)
    for (uint32_t& v : soup.corners) v = random() % std::min<uint32_t>(12, static_cast<uint32_t>(soup.points.size()));
  return soup;
}

Triangles bad_mesh(int kind, uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> unit(-1, 1);
  Triangles mesh(seed % 2 == 0 ? make_sphere(1, 2) : make_torus(1, 0.3, 14));
  const auto shake = [&](float size) {
    for (Vec3f& p : mesh.points) p += size * Vec3f{unit(random), unit(random), unit(random)};
  };
  const auto drop = [&](uint32_t one_in) {
    std::vector<uint32_t> kept;
    for (size_t t = 0; t < mesh.corners.size(); t += 3)
      if (random() % one_in != 0)
        kept.insert(kept.end(), mesh.corners.begin() + static_cast<ptrdiff_t>(t), mesh.corners.begin() + static_cast<ptrdiff_t>(t) + 3);
    mesh.corners = kept;
  };
  switch (kind) {
    case 0: return random_soup(random, 1 + random() % 60, false);
    case 1: return random_soup(random, 1 + random() % 60, true);  // any three of twelve points
    case 2: drop(2 + random() % 9); return mesh;                  // holes
    case 3: shake(0.4f); return mesh;                             // through itself
    case 4:                                                       // turned here and there
      for (size_t t = 0; t < mesh.corners.size(); t += 3)
        if (random() % 3 == 0) std::swap(mesh.corners[t], mesh.corners[t + 1]);
      return mesh;
    case 5: {  // every face twice, once the other way
      const std::vector<uint32_t> once = mesh.corners;
      for (size_t t = 0; t < once.size(); t += 3)
        mesh.corners.insert(mesh.corners.end(), {once[t + random() % 2], once[t + random() % 3], once[t + 2]});
      return mesh;
    }
    case 6:  // flat, on a plane of the grid or askew
      for (Vec3f& p : mesh.points) p.z = seed % 3 == 0 ? 0.0f : 0.25f * p.x;
      return mesh;
    case 7: mesh.add(make_box({1.5, 0.2, 0.7}, 3), {unit(random), unit(random), unit(random)}).add(make_sphere(0.4, 1), {0, 0, 0}); return mesh;
    case 8: {  // one triangle, down to a needle
      Triangles one;
      one.points = {{0, 0, 0}, {1, unit(random), unit(random)}, {unit(random), std::pow(10.0f, -static_cast<float>(seed % 8)), 0}};
      one.corners = {0, 1, 2};
      return one;
    }
    case 9: {  // sheets nearly upon each other
      Triangles sheets;
      for (int s = 0; s < 6; ++s) {
        Triangles sheet = mesh;
        for (Vec3f& p : sheet.points) p.y = 0;
        sheets.add(sheet.surface(), {0, static_cast<float>(s) * 1e-3f * std::abs(unit(random)), 0});
      }
      return sheets;
    }
    case 10: {  // many leaves on one spine
      Triangles book;
      book.points = {{0, -1, 0}, {0, 1, 0}};
      for (uint32_t leaf = 0; leaf < 2 + seed % 20; ++leaf) {
        book.points.push_back({unit(random), unit(random), unit(random)});
        book.corners.insert(book.corners.end(), {0, 1, leaf + 2});
      }
      return book;
    }
    case 11:  // long splinters through everything
      for (size_t v = 0; v < mesh.points.size(); v += 7) mesh.points[v] = 6.0f * Vec3f{unit(random), unit(random), unit(random)};
      return mesh;
    case 12: {  // faces on the planes of a grid, some missing
      mesh = Triangles(make_box({1, 1, 1}, 4));
      mesh.add(make_box({0.5, 0.5, 0.5}, 2), {0.75f, 0, 0});
      drop(8);
      return mesh;
    }
    case 13: {  // fingers and slits of all widths
      mesh = Triangles();
      for (int f = 0; f < 7; ++f)
        mesh.add(make_box({0.1, 1 + 0.1 * unit(random), 0.2}, 4), {0.1f * static_cast<float>(f) + 0.004f * unit(random), 0, 0.05f * unit(random)});
      if (seed % 2 == 0) mesh.add(make_box({0.9, 0.3, 0.3}, 5), {0.3f, -0.5f, 0});
      return mesh;
    }
    default: {  // collapsed faces and pairs of equal vertices
      for (int i = 0; i < 30; ++i) mesh.corners[random() % mesh.corners.size()] = mesh.corners[random() % mesh.corners.size()];
      for (int i = 0; i < 10; ++i) mesh.points[random() % mesh.points.size()] = mesh.points[random() % mesh.points.size()];
      return mesh;
    }
  }
}

TEST(BuiltTets, BadMeshesGiveAGoodH) {
  const auto executor = make_cpu_executor(2);
  int count = 0;
  size_t split = 0;
  for (int kind = 0; kind < 15; ++kind)
    for (uint32_t seed = 0; seed < 14; ++seed) {
      const Surface surface = bad_mesh(kind, 100 * static_cast<uint32_t>(kind) + seed).surface();
      if (surface.topology->triangles.empty()) continue;
      const LatticeKind lattice = static_cast<LatticeKind>(seed % 3);
      const BuildTetsOptions options{.max_depth = 3 + static_cast<int>(seed % 2),
                                     .min_depth = static_cast<int>(seed % 4),
                                     .max_vertices = 1 + static_cast<int>(seed),
                                     .split_pieces = seed % 5 != 0,
                                     .lattice = lattice};
      std::vector<std::string> warnings;
      const BuiltTets build = build_tets(surface, options, *executor, warnings);
      ASSERT_EQ(wrong(build, surface, lattice), "") << "kind " << kind << ", seed " << seed;
      split += build.pieces_split;
      ++count;
    }
  EXPECT_GE(count, 200);
  EXPECT_GT(split, 500u);
}

TEST(BuiltTets, SharedMeshesGiveAGoodH) {
  if (!std::filesystem::exists(shared_data())) GTEST_SKIP() << "no meshes at " << shared_data();
  const auto executor = make_cpu_executor(2);
  int count = 0;
  for (const char* folder : {"heads", "organic", "problem", "colliders", "press", "formats"})
    for (const auto& entry : std::filesystem::directory_iterator(std::filesystem::path(shared_data()) / folder)) {
      const std::string name = entry.path().extension().string();
      if ((name != ".obj" && name != ".ply" && name != ".stl") || entry.file_size() > 700'000) continue;
      Surface surface;
      std::vector<std::string> warnings;
      try {
        surface = read_surface(entry.path(), warnings);
      } catch (const Error&) {
        continue;  // a file that the reader refuses
      }
      const BuiltTets build = build_tets(surface, {.max_depth = 5, .max_vertices = 8}, *executor, warnings);
      EXPECT_EQ(wrong(build, surface), "") << entry.path();
      ++count;
    }
  EXPECT_GE(count, 40);
}

}  // namespace tet_build_test
}  // namespace knead
