#include "kernels/surface/edges.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "kernels/shapes/primitives.h"
#include "kernels/surface/disjoint_sets.h"
#include "kernels/surface/volume.h"
#include "kernels/surface/weld.h"

namespace knead {
namespace edges_test {

TEST(EdgeUses, TellWhoUsesAnEdgeAndWhichWayRound) {
  const std::vector<uint32_t> triangles{0, 1, 2, 2, 1, 3};
  const EdgeUses edges(4, triangles);
  std::map<std::pair<uint32_t, uint32_t>, std::vector<uint32_t>> corners;
  edges.each_edge([&](uint32_t low, std::span<const EdgeUse> uses) {
    for (const EdgeUse& use : uses) {
      EXPECT_EQ(triangles[use.corner], use.forward ? low : use.high);
      EXPECT_EQ(triangles[use.next], use.forward ? use.high : low);
      corners[{low, use.high}].push_back(use.corner);
    }
  });
  const std::map<std::pair<uint32_t, uint32_t>, std::vector<uint32_t>> expected{
      {{0, 1}, {0}}, {{0, 2}, {2}}, {{1, 2}, {1, 3}}, {{1, 3}, {4}}, {{2, 3}, {5}}};
  EXPECT_EQ(corners, expected);
  EXPECT_FALSE(edges.closed());
}

TEST(EdgeUses, LeaveOutTrianglesWithARepeatedCorner) {
  int found = 0;
  EdgeUses(3, std::vector<uint32_t>{0, 0, 1, 1, 2, 1, 2, 2, 2}).each_edge([&](uint32_t, std::span<const EdgeUse>) { ++found; });
  EXPECT_EQ(found, 0);
}

TEST(EdgeUses, AreClosedWhereEveryEdgeIsUsedBothWaysAlike) {
  const std::vector<uint32_t> tet{0, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, 3};
  const std::unique_ptr<Executor> executor = make_cpu_executor();
  EXPECT_TRUE(EdgeUses(4, tet, executor.get()).closed());
  std::vector<uint32_t> turned = tet;
  std::swap(turned[0], turned[1]);
  EXPECT_FALSE(EdgeUses(4, turned, executor.get()).closed());
}

TEST(DisjointSets, SayWhetherAJoinBroughtTwoTogether) {
  DisjointSets sets(4);
  EXPECT_TRUE(sets.join(3, 2));
  EXPECT_TRUE(sets.join(1, 3));
  EXPECT_FALSE(sets.join(1, 2));
  EXPECT_EQ(sets.find(3), 1u);
  EXPECT_EQ(sets.find(0), 0u);
  sets.reset(3);
  EXPECT_EQ(sets.find(2), 2u);
}

TEST(FirstAtSamePlace, KnowsPlacesBitForBitAndOneZero) {
  const std::vector<Vec3f> points{{1, 0, 0}, {1, -0.0f, 0}, {std::nextafter(1.0f, 2.0f), 0, 0}, {1, 0, 0}, {NAN, 0, 0}, {NAN, 0, 0}};
  EXPECT_EQ(first_at_same_place(std::span<const Vec3f>(points)), (std::vector<uint32_t>{0, 0, 2, 0, 4, 4}));
}

TEST(FirstAtSamePlace, TakesNoVertexThatIsNotUsed) {
  const std::vector<Vec3d> points(4, Vec3d{1, 2, 3});
  EXPECT_EQ(first_at_same_place(std::span<const Vec3d>(points), std::vector<uint8_t>{0, 1, 0, 1}), (std::vector<uint32_t>{0, 1, 2, 1}));
}

TEST(SignedVolume, IsTheSameFromEveryTipAndNegativeInsideOut) {
  const Surface box = make_box({1, 2, 3}, 4);
  std::vector<uint32_t> triangles = box.topology->triangles;
  for (const Vec3d& tip : {Vec3d{0, 0, 0}, Vec3d{5, -7, 2}}) EXPECT_NEAR(signed_volume(box.points.host(), triangles, tip), 6, 1e-12);
  for (size_t c = 0; c < triangles.size(); c += 3) std::swap(triangles[c], triangles[c + 1]);
  EXPECT_NEAR(signed_volume(box.points.host(), triangles, {0, 0, 0}), -6, 1e-12);
}

}  // namespace edges_test
}  // namespace knead
