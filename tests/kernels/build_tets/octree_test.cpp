#include "kernels/build_tets/octree.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

namespace knead {
namespace octree_test {

std::vector<uint64_t> keys_of(const std::vector<Vec3d>& points) {
  std::vector<uint64_t> keys;
  for (const Vec3d& p : points) keys.push_back(morton_key(p));
  std::sort(keys.begin(), keys.end());
  return keys;
}

// A crowd in one corner, a few elsewhere: steep changes of level.
std::vector<Vec3d> crowded_points(uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit(0, 1);
  std::vector<Vec3d> points;
  for (int i = 0; i < 300; ++i) points.push_back({0.37 + 0.01 * unit(random), 0.62 + 0.02 * unit(random), 0.51 + 0.005 * unit(random)});
  for (int i = 0; i < 10; ++i) points.push_back({unit(random), unit(random), unit(random)});
  return points;
}

TEST(Octree, MortonKeysInterleaveTheirBits) {
  EXPECT_EQ(morton_key(1, 0, 0), 1u);
  EXPECT_EQ(morton_key(0, 1, 0), 2u);
  EXPECT_EQ(morton_key(0, 0, 1), 4u);
  EXPECT_EQ(morton_key(0x1fffff, 0x1fffff, 0x1fffff), (uint64_t{1} << 63) - 1);
  EXPECT_EQ(morton_key(Vec3d{0.5, 0, 0}), uint64_t{1} << 60);
}

TEST(Octree, SplitsUntilFewEnoughOrDeepEnough) {
  const auto points = crowded_points(1);
  const Octree octree(keys_of(points), 2, 6, 5);
  std::vector<int> held(octree.nodes().size(), 0);
  for (const Vec3d& p : points) ++held[octree.leaf_at(p)];
  for (const uint32_t leaf : octree.leaves()) {
    EXPECT_GE(octree.node(leaf).level, 2);
    EXPECT_TRUE(held[leaf] <= 5 || octree.node(leaf).level == 6);
  }
  EXPECT_EQ(octree.depth(), 6);
}

TEST(Octree, LeavesFillTheCubeInMortonOrder) {
  Octree octree(keys_of(crowded_points(2)), 1, 8, 3);
  octree.balance();
  double volume = 0;
  uint64_t last = 0;
  for (const uint32_t leaf : octree.leaves()) {
    const OctreeNode& node = octree.node(leaf);
    volume += std::pow(node.size(), 3);
    const uint64_t key = morton_key(node.lower());
    EXPECT_TRUE(volume == std::pow(node.size(), 3) || key > last);
    last = key;
  }
  EXPECT_DOUBLE_EQ(volume, 1);
}

TEST(Octree, BalanceLeavesNoTouchingLeavesTwoLevelsApart) {
  for (uint32_t seed = 0; seed < 5; ++seed) {
    Octree octree(keys_of(crowded_points(seed)), 0, 9, 2);
    octree.balance();
    const auto leaves = octree.leaves();
    for (const uint32_t i : leaves)
      for (const uint32_t j : leaves) {
        const OctreeNode &a = octree.node(i), &b = octree.node(j);
        if (a.level <= b.level + 1) continue;
        bool apart = false;
        for (int k = 0; k < 3; ++k) apart = apart || a.lower()[k] > b.lower()[k] + b.size() || b.lower()[k] > a.lower()[k] + a.size();
        ASSERT_TRUE(apart) << "levels " << a.level << " and " << b.level;
      }
  }
}

TEST(Octree, FindsNodesAndTheLeavesAboveThem) {
  const Octree octree(keys_of({{0.9, 0.9, 0.9}, {0.95, 0.9, 0.9}}), 1, 5, 1);
  EXPECT_EQ(octree.find(1, -1, 0, 0), Octree::kNone);
  EXPECT_EQ(octree.find(1, 0, 0, 2), Octree::kNone);
  EXPECT_EQ(octree.node(octree.find(5, 0, 0, 0)).level, 1);  // a leaf that covers it
  const uint32_t leaf = octree.leaf_at({0.95, 0.9, 0.9});
  const OctreeNode& node = octree.node(leaf);
  EXPECT_TRUE(node.is_leaf());
  EXPECT_EQ(octree.find(node.level, node.x, node.y, node.z), leaf);
}

}  // namespace octree_test
}  // namespace knead
