// H of meshes that are no good border of anything, made up and from files.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <random>

#include "graph/error.h"
#include "io/mesh/mesh_io.h"
#include "kernels/build_tets/build_tets.h"
#include "tests/kernels/build_tets/tet_properties.h"
#include "tests/kernels/triangle_soup.h"
#include "tests/paths.h"

namespace knead {
namespace bad_meshes_test {

using tet_build_properties::wrong;

TriangleSoup random_soup(std::mt19937& random, uint32_t count, bool shared) {
  std::uniform_real_distribution<float> place(-1, 1), small(-0.2f, 0.2f);
  TriangleSoup soup;
  for (uint32_t t = 0; t < count; ++t) {
    const Vec3f at{place(random), place(random), place(random)};
    const float size = random() % 4 == 0 ? 5.0f : 1.0f;
    for (int k = 0; k < 3; ++k) {
      soup.triangles.push_back(static_cast<uint32_t>(soup.points.size()));
      soup.points.push_back(at + size * Vec3f{small(random), small(random), small(random)});
    }
  }
  if (shared)
    for (uint32_t& v : soup.triangles) v = random() % std::min<uint32_t>(12, static_cast<uint32_t>(soup.points.size()));
  return soup;
}

// Ways to spoil a good mesh, and to make a bad one.
struct BadMesh {
  static constexpr int kKinds = 15;

  uint32_t seed;
  std::mt19937 random{seed};
  TriangleSoup mesh{seed % 2 == 0 ? make_sphere(1, 2) : make_torus(1, 0.3, 14)};
  std::uniform_real_distribution<float> unit{-1, 1};

  explicit BadMesh(uint32_t s) : seed(s) {}
  Vec3f anywhere() { return {unit(random), unit(random), unit(random)}; }

  TriangleSoup make(int kind) {
    switch (kind) {
      case 0: return random_soup(random, 1 + random() % 60, false);
      case 1: return random_soup(random, 1 + random() % 60, true);  // any three of twelve points
      case 2: drop(2 + random() % 9); break;                        // holes
      case 3: through_itself(); break;
      case 4: turn_some(); break;
      case 5: double_faces(); break;
      case 6: flatten(); break;
      case 7: mesh.add(make_box({1.5, 0.2, 0.7}, 3), anywhere()).add(make_sphere(0.4, 1)); break;
      case 8: return needle();
      case 9: return sheets();
      case 10: return book();
      case 11: splinters(); break;
      case 12: grid_planes(); break;
      case 13: fingers(); break;
      default: collapse_some();
    }
    return mesh;
  }

  void drop(uint32_t one_in) {
    std::vector<uint32_t> kept;
    for (size_t t = 0; t < mesh.triangles.size(); t += 3)
      if (random() % one_in != 0)
        kept.insert(kept.end(), mesh.triangles.begin() + static_cast<ptrdiff_t>(t), mesh.triangles.begin() + static_cast<ptrdiff_t>(t) + 3);
    mesh.triangles = kept;
  }
  void through_itself() {
    for (Vec3f& p : mesh.points) p += 0.4f * anywhere();
  }
  void turn_some() {
    for (size_t t = 0; t < mesh.triangles.size(); t += 3)
      if (random() % 3 == 0) mesh.turn(t / 3);
  }
  void double_faces() {  // every face twice, once the other way or flat
    const std::vector<uint32_t> once = mesh.triangles;
    for (size_t t = 0; t < once.size(); t += 3)
      mesh.triangles.insert(mesh.triangles.end(), {once[t + random() % 2], once[t + random() % 3], once[t + 2]});
  }
  void flatten() {  // on a plane of the grid or askew
    for (Vec3f& p : mesh.points) p.z = seed % 3 == 0 ? 0.0f : 0.25f * p.x;
  }
  TriangleSoup needle() {  // one triangle, more or less of a needle
    TriangleSoup one;
    one.points = {{0, 0, 0}, {1, unit(random), unit(random)}, {unit(random), std::pow(10.0f, -static_cast<float>(seed % 8)), 0}};
    one.triangles = {0, 1, 2};
    return one;
  }
  TriangleSoup sheets() {  // nearly upon each other
    TriangleSoup all;
    for (int s = 0; s < 6; ++s) {
      TriangleSoup sheet = mesh;
      for (Vec3f& p : sheet.points) p.y = 0;
      all.add(sheet.surface(), {0, static_cast<float>(s) * 1e-3f * std::abs(unit(random)), 0});
    }
    return all;
  }
  TriangleSoup book() {  // many leaves on one spine
    TriangleSoup leaves;
    leaves.points = {{0, -1, 0}, {0, 1, 0}};
    for (uint32_t leaf = 0; leaf < 2 + seed % 20; ++leaf) {
      leaves.points.push_back(anywhere());
      leaves.triangles.insert(leaves.triangles.end(), {0, 1, leaf + 2});
    }
    return leaves;
  }
  void splinters() {  // long ones, through everything
    for (size_t v = 0; v < mesh.points.size(); v += 7) mesh.points[v] = 6.0f * anywhere();
  }
  void grid_planes() {  // faces on the planes of a grid, some missing
    mesh = TriangleSoup(make_box({1, 1, 1}, 4)).add(make_box({0.5, 0.5, 0.5}, 2), {0.75f, 0, 0});
    drop(8);
  }
  void fingers() {  // fingers and slits of all widths
    mesh = TriangleSoup();
    for (int f = 0; f < 7; ++f)
      mesh.add(make_box({0.1, 1 + 0.1 * unit(random), 0.2}, 4), {0.1f * static_cast<float>(f) + 0.004f * unit(random), 0, 0.05f * unit(random)});
    if (seed % 2 == 0) mesh.add(make_box({0.9, 0.3, 0.3}, 5), {0.3f, -0.5f, 0});
  }
  void collapse_some() {  // collapsed faces and pairs of equal vertices
    for (int i = 0; i < 30; ++i) mesh.triangles[random() % mesh.triangles.size()] = mesh.triangles[random() % mesh.triangles.size()];
    for (int i = 0; i < 10; ++i) mesh.points[random() % mesh.points.size()] = mesh.points[random() % mesh.points.size()];
  }
};

TEST(BuiltTets, BadMeshesGiveAGoodH) {
  const auto executor = make_cpu_executor(2);
  int count = 0;
  size_t split = 0;
  for (int kind = 0; kind < BadMesh::kKinds; ++kind)
    for (uint32_t seed = 0; seed < 14; ++seed) {
      const Surface surface = BadMesh(100 * static_cast<uint32_t>(kind) + seed).make(kind).surface();
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

}  // namespace bad_meshes_test
}  // namespace knead
