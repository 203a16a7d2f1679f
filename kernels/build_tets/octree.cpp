#include "kernels/build_tets/octree.h"

#include <algorithm>

namespace knead {
Octree::Octree(std::span<const uint64_t> sorted_keys, int min_depth, int max_depth, uint32_t max_points) {
  inner_by_level_.resize(static_cast<size_t>(max_depth) + 1);
  nodes_.push_back({0, 0, 0, 0});
  struct Range {
    uint32_t node;
    const uint64_t *begin, *end;
  };
  std::vector<Range> todo{{0, sorted_keys.data(), sorted_keys.data() + sorted_keys.size()}};
  while (!todo.empty()) {
    const Range range = todo.back();
    todo.pop_back();
    const int level = nodes_[range.node].level;
    const bool crowded = static_cast<size_t>(range.end - range.begin) > max_points;
    if (level >= max_depth || (level >= min_depth && !crowded)) continue;
    split(range.node);
    const int shift = 3 * (kMortonBits - level - 1);
    const uint64_t* begin = range.begin;
    for (uint32_t child = 0; child < 8; ++child) {
      const uint64_t* end = std::partition_point(begin, range.end, [&](uint64_t key) { return (key >> shift & 7) <= child; });
      todo.push_back({nodes_[range.node].first_child + child, begin, end});
      begin = end;
    }
  }
}

void Octree::split(uint32_t index) {
  const OctreeNode parent = nodes_[index];
  nodes_[index].first_child = static_cast<uint32_t>(nodes_.size());
  for (uint32_t child = 0; child < 8; ++child)
    nodes_.push_back({2 * parent.x + (child & 1), 2 * parent.y + (child >> 1 & 1), 2 * parent.z + (child >> 2), parent.level + 1});
  depth_ = std::max(depth_, parent.level + 1);
  inner_by_level_[static_cast<size_t>(parent.level)].push_back(index);
}

// A split node has leaves of the next level all round its border, so each of its 26 neighbours must exist as a node of its own level. Going from fine
// to coarse, splits made for one level only add work to coarser ones.
void Octree::balance() {
  for (int level = depth_ - 1; level > 0; --level) {
    const std::vector<uint32_t>& inner = inner_by_level_[static_cast<size_t>(level)];
    for (size_t i = 0; i < inner.size(); ++i) {
      const OctreeNode at = nodes_[inner[i]];
      for (int neighbour = 0; neighbour < 27; ++neighbour) {
        const int64_t x = int64_t{at.x} + neighbour % 3 - 1, y = int64_t{at.y} + neighbour / 3 % 3 - 1, z = int64_t{at.z} + neighbour / 9 - 1;
        for (uint32_t found = find(level, x, y, z); found != kNone && nodes_[found].level < level; found = find(level, x, y, z)) split(found);
      }
    }
  }
}

std::vector<uint32_t> Octree::leaves() const {
  std::vector<uint32_t> result, todo{0};
  while (!todo.empty()) {
    const uint32_t index = todo.back();
    todo.pop_back();
    if (nodes_[index].is_leaf()) {
      result.push_back(index);
    } else {
      for (uint32_t child = 8; child-- > 0;) todo.push_back(nodes_[index].first_child + child);
    }
  }
  return result;
}

uint32_t Octree::find(int level, int64_t x, int64_t y, int64_t z) const {
  const int64_t side = int64_t{1} << level;
  if (x < 0 || y < 0 || z < 0 || x >= side || y >= side || z >= side) return kNone;
  uint32_t index = 0;
  for (int l = level - 1; l >= 0 && !nodes_[index].is_leaf(); --l)
    index = nodes_[index].first_child + static_cast<uint32_t>((x >> l & 1) | (y >> l & 1) << 1 | (z >> l & 1) << 2);
  return index;
}

uint32_t Octree::leaf_at(const Vec3d& unit) const {
  const double side = std::ldexp(1.0, depth_);
  const auto cell = [&](double u) { return static_cast<int64_t>(std::floor(u * side)); };
  return find(depth_, cell(unit.x), cell(unit.y), cell(unit.z));
}

}  // namespace knead
