#include "kernels/build_tets/cells.h"

#include <algorithm>
#include <array>
#include <numeric>

#include "graph/error.h"
#include "kernels/surface/triangle_box.h"

namespace knead {
namespace {

struct Touch {
  uint32_t node, triangle;
};

// Finds the leaves that one triangle touches: straight down while its box lies in one child, then by separating axes.
class Descent {
 public:
  Descent(const Octree& octree, const SoftBody& body, std::vector<Touch>& found) : octree_(octree), body_(body), found_(found) {}

  void add(uint32_t triangle) {
    triangle_ = triangle;
    const uint32_t* v = &body_.triangles[3 * size_t{triangle}];
    for (int k = 0; k < 3; ++k) corner_[k] = body_.points[v[k]];
    std::array<uint32_t, 3> low, high;
    for (int k = 0; k < 3; ++k) {
      low[static_cast<size_t>(k)] = cell_of(std::min({corner_[0][k], corner_[1][k], corner_[2][k]}) - kTouchSlack);
      high[static_cast<size_t>(k)] = cell_of(std::max({corner_[0][k], corner_[1][k], corner_[2][k]}) + kTouchSlack);
    }
    uint32_t index = 0;
    while (!octree_.node(index).is_leaf()) {
      const int shift = kMortonBits - 1 - octree_.node(index).level;
      uint32_t child = 0;
      bool one = true;
      for (size_t k = 0; k < 3; ++k) {
        one = one && low[k] >> shift == high[k] >> shift;
        child |= (low[k] >> shift & 1) << k;
      }
      if (!one) break;
      index = octree_.node(index).first_child + child;
    }
    if (octree_.node(index).is_leaf()) {
      found_.push_back({index, triangle_});
    } else {
      visit(index);
    }
  }

 private:
  static uint32_t cell_of(double u) {
    constexpr double kSide = 1 << kMortonBits;
    return static_cast<uint32_t>(std::clamp(u * kSide, 0.0, kSide - 1));
  }
  void visit(uint32_t index) {
    const OctreeNode& node = octree_.node(index);
    const double half = 0.5 * node.size() + kTouchSlack;
    if (!triangle_touches_box(corner_[0], corner_[1], corner_[2], node.centre(), {half, half, half})) return;
    if (node.is_leaf()) {
      found_.push_back({index, triangle_});
    } else {
      for (uint32_t child = 0; child < 8; ++child) visit(node.first_child + child);
    }
  }

  const Octree& octree_;
  const SoftBody& body_;
  std::vector<Touch>& found_;
  uint32_t triangle_ = 0;
  Vec3d corner_[3];
};

std::vector<std::vector<Touch>> touches(const Octree& octree, const SoftBody& body, Executor& executor) {
  constexpr size_t kPiece = 2048;
  std::vector<std::vector<Touch>> found((body.triangle_count() + kPiece - 1) / kPiece);
  executor.parallel_ranges(body.triangle_count(), kPiece, [&](size_t begin, size_t end) {
    Descent descent(octree, body, found[begin / kPiece]);
    for (size_t t = begin; t < end; ++t) descent.add(static_cast<uint32_t>(t));
  });
  return found;
}

// Regions of untouched leaves joined over faces. M does not pass between them, so that with a closed M the winding number is one per region.
std::vector<uint32_t> untouched_regions(const Octree& octree, std::span<const uint32_t> leaves, const std::vector<uint8_t>& touched,
                                        std::vector<uint32_t>& seeds) {
  std::vector<uint32_t> region(octree.nodes().size(), Octree::kNone);
  std::vector<uint32_t> todo;
  for (const uint32_t leaf : leaves) {
    if (touched[leaf] || region[leaf] != Octree::kNone) continue;
    const uint32_t id = static_cast<uint32_t>(seeds.size());
    seeds.push_back(leaf);
    region[leaf] = id;
    todo.push_back(leaf);
    const auto reach = [&](uint32_t node) {
      if (touched[node] || region[node] != Octree::kNone) return;
      region[node] = id;
      if (octree.node(node).size() > octree.node(seeds[id]).size()) seeds[id] = node;
      todo.push_back(node);
    };
    while (!todo.empty()) {
      const OctreeNode at = octree.node(todo.back());
      todo.pop_back();
      for (int face = 0; face < 6; ++face) {
        const int axis = face >> 1, step = (face & 1) != 0 ? 1 : -1;
        const uint32_t next = octree.find(at.level, int64_t{at.x} + (axis == 0 ? step : 0), int64_t{at.y} + (axis == 1 ? step : 0),
                                          int64_t{at.z} + (axis == 2 ? step : 0));
        if (next == Octree::kNone) continue;
        if (octree.node(next).is_leaf()) {
          reach(next);
        } else {  // balanced: the children on this side are leaves
          for (uint32_t child = 0; child < 8; ++child)
            if ((child >> axis & 1) == (step > 0 ? 0u : 1u)) reach(octree.node(next).first_child + child);
        }
      }
    }
  }
  return region;
}

}  // namespace

void refine_along_surface(Octree& octree, const SoftBody& body, int depth) {
  constexpr size_t kMostNodes = size_t{1} << 26;  // Each touched cell has a dozen tets or more, and H has at most 2^30.
  std::vector<uint32_t> todo;
  for (size_t t = 0; t < body.triangle_count(); ++t) {
    const uint32_t* v = &body.triangles[3 * t];
    todo.push_back(0);
    while (!todo.empty()) {
      const uint32_t index = todo.back();
      todo.pop_back();
      const OctreeNode node = octree.node(index);
      const double half = 0.5 * node.size() + kTouchSlack;
      if (node.level >= depth || !triangle_touches_box(body.points[v[0]], body.points[v[1]], body.points[v[2]], node.centre(), {half, half, half}))
        continue;
      if (node.is_leaf()) octree.split(index);
      if (octree.nodes().size() > kMostNodes)
        throw Error(ErrorCode::kMemory, "H would have more than " + std::to_string(kMostNodes) + " cells along the surface", "lower surface_depth");
      for (uint32_t child = 8; child-- > 0;) todo.push_back(octree.node(index).first_child + child);
    }
  }
}

Cells keep_cells(const Octree& octree, const SoftBody& body, const WindingNumber& winding, Executor& executor) {
  const std::vector<std::vector<Touch>> found = touches(octree, body, executor);
  std::vector<uint8_t> touched(octree.nodes().size(), 0);
  for (const auto& piece : found)
    for (const Touch& touch : piece) touched[touch.node] = 1;

  const std::vector<uint32_t> leaves = octree.leaves();
  std::vector<uint8_t> kept(touched);
  if (body.closed) {
    std::vector<uint32_t> seeds;
    const std::vector<uint32_t> region = untouched_regions(octree, leaves, touched, seeds);
    std::vector<uint8_t> inside(seeds.size(), 0);
    executor.parallel_ranges(seeds.size(), 1, [&](size_t begin, size_t end) {
      for (size_t r = begin; r < end; ++r) inside[r] = is_inside(winding, octree.node(seeds[r]).centre());
    });
    for (const uint32_t leaf : leaves)
      if (!touched[leaf]) kept[leaf] = inside[region[leaf]];
  } else {
    executor.parallel_ranges(leaves.size(), 64, [&](size_t begin, size_t end) {
      for (size_t i = begin; i < end; ++i)
        if (!touched[leaves[i]]) kept[leaves[i]] = is_inside(winding, octree.node(leaves[i]).centre());
    });
  }

  Cells cells;
  cells.of_node.assign(octree.nodes().size(), Octree::kNone);
  for (const uint32_t leaf : leaves) {
    if (!kept[leaf]) continue;
    cells.of_node[leaf] = static_cast<uint32_t>(cells.nodes.size());
    cells.nodes.push_back(leaf);
  }
  cells.offsets.assign(cells.count() + 1, 0);
  for (const auto& piece : found)
    for (const Touch& touch : piece) ++cells.offsets[cells.of_node[touch.node] + 1];
  std::partial_sum(cells.offsets.begin(), cells.offsets.end(), cells.offsets.begin());
  cells.triangles.resize(cells.offsets.back());
  std::vector<uint32_t> next(cells.offsets.begin(), cells.offsets.end() - 1);
  for (const auto& piece : found)
    for (const Touch& touch : piece) cells.triangles[next[cells.of_node[touch.node]]++] = touch.triangle;
  return cells;
}

}  // namespace knead
