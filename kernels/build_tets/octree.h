// An octree over the unit cube, split by counting points, balanced so that leaves that touch at a face, an edge or a corner differ by at most one
// level.
#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "kernels/surface/morton.h"
#include "kernels/vec.h"

namespace knead {

struct OctreeNode {
  uint32_t x, y, z;  // of 2^level a side
  int level;
  uint32_t first_child = 0;  // eight in a row, bit 0 of the offset is x; 0: a leaf
  bool is_leaf() const { return first_child == 0; }
  double size() const { return std::ldexp(1.0, -level); }
  Vec3d lower() const { return size() * Vec3d{static_cast<double>(x), static_cast<double>(y), static_cast<double>(z)}; }
  Vec3d centre() const { return size() * Vec3d{x + 0.5, y + 0.5, z + 0.5}; }
};

class Octree {
 public:
  static constexpr uint32_t kNone = UINT32_MAX;

  // Splits every node above min_depth, and every node above max_depth that holds more than max_points of the sorted Morton keys.
  Octree(std::span<const uint64_t> sorted_keys, int min_depth, int max_depth, uint32_t max_points);
  void split(uint32_t index);
  void balance();

  const std::vector<OctreeNode>& nodes() const { return nodes_; }
  const OctreeNode& node(uint32_t index) const { return nodes_[index]; }
  int depth() const { return depth_; }   // of the finest leaf
  std::vector<uint32_t> leaves() const;  // in Morton order

  // The node at (x, y, z) of 2^level a side, or the coarser leaf that covers it, or kNone outside the cube.
  uint32_t find(int level, int64_t x, int64_t y, int64_t z) const;
  uint32_t leaf_at(const Vec3d& unit) const;

 private:
  std::vector<OctreeNode> nodes_;
  std::vector<std::vector<uint32_t>> inner_by_level_;
  int depth_ = 0;
};

}  // namespace knead
