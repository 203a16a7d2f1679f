// Strips hold every tet around every vertex once, the right way round, and few entries that only start a strip.
#include "kernels/build_tets/strips.h"

#include <gtest/gtest.h>

#include <cmath>

#include "kernels/build_tets/build_tets.h"
#include "kernels/neighbour_table.h"
#include "tests/kernels/loop/loop_fixture.h"

namespace {

using knead::Buffer;
using knead::Executor;
using knead::NeighbourTable;
using knead::TetMesh;

const auto strips_executor = knead::make_cpu_executor(2);

// A tet's other corners turned so that the smallest comes first.
std::array<uint32_t, 3> strips_turned(std::array<uint32_t, 3> t) {
  while (t[0] > t[1] || t[0] > t[2]) t = {t[1], t[2], t[0]};
  return t;
}

using StripTets = std::vector<std::pair<std::array<uint32_t, 3>, float>>;

// What a kernel sees that goes through the strip of one vertex; three corners stand as vertex_tets has them.
StripTets strips_walked(const std::vector<knead::Neighbour>& entries) {
  StripTets tets;
  uint32_t p = 0, q = 0, r = 0;
  float before = 0;
  for (const knead::Neighbour& entry : entries) {
    p = std::signbit(entry.value) == std::signbit(before) ? p : q;
    q = r;
    r = entry.indices[0];
    before = entry.value;
    if (entry.value > 0) tets.push_back({strips_turned({p, q, r}), entry.value});
    if (entry.value < 0) tets.push_back({strips_turned({q, p, r}), -entry.value});
  }
  std::sort(tets.begin(), tets.end());
  return tets;
}

void strips_check(const TetMesh& mesh, double most_overhead) {
  const uint32_t vertices = static_cast<uint32_t>(mesh.vertices());
  EXPECT_EQ(check_neighbour_table(mesh.vertex_strips, vertices, knead::PadIndex::kOwnVertex), "");
  const auto around = neighbours_by_vertex(mesh.vertex_tets, vertices), strips = neighbours_by_vertex(mesh.vertex_strips, vertices);
  size_t tets = 0, entries = 0;
  for (uint32_t v = 0; v < vertices; ++v) {
    StripTets wanted;
    for (const knead::Neighbour& tet : around[v]) wanted.push_back({strips_turned(tet.indices), static_cast<float>(1 / (6 * double{tet.value}))});
    std::sort(wanted.begin(), wanted.end());
    ASSERT_EQ(strips_walked(strips[v]), wanted) << v;
    tets += wanted.size();
    entries += strips[v].size();
  }
  EXPECT_LT(static_cast<double>(entries), most_overhead * static_cast<double>(tets));
}

TEST(Strips, HoldEveryTetAroundEveryVertex) {
  strips_check(knead::loop_fixture::ball(0.2, 1, *strips_executor).tets, 1.3);
}

TEST(Strips, HoldEveryTetOfAGradedMesh) {
  std::vector<std::string> warnings;
  strips_check(build_tets(knead::make_head(2, 2400), {}, *strips_executor, warnings).tets, 1.25);
}

TEST(Strips, TakeASingleTetAndNone) {
  const std::vector<knead::Vec3f> x{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  strips_check(knead::loop_fixture::make_tet_mesh(x, {{0, 1, 2, 3}}, *strips_executor), 3.1);
  EXPECT_EQ(knead::loop_fixture::make_tet_mesh({}, {}, *strips_executor).vertex_strips.entries(), 0u);
}

}  // namespace
