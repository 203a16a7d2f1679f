// A fill-reducing elimination order for sparse Cholesky on meshes: nested dissection by coordinate planes (George 1973; Lipton and Tarjan 1979). The
// separators of a volume mesh are planes, and its vertices know where they are, so that no graph partitioner is needed.
#pragma once
#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "kernels/vec.h"

namespace knead {

struct DissectionNode {
  uint32_t first = 0, count = 0;  // its places in the order
  uint32_t parent = kNone;        // a later node
  static constexpr uint32_t kNone = 0xffffffffu;
};

// Vertices of two nodes are joined by an edge only when one node is an ancestor of the other.
struct Dissection {
  std::vector<uint32_t> order;        // the vertex at each place
  std::vector<DissectionNode> nodes;  // children before parents, their places too
};

// Parts of at most `leaf` vertices are not cut further. `check` is called now and then, and may throw.
Dissection nested_dissection(std::span<const Vec3f> points, std::span<const std::array<uint32_t, 2>> edges, uint32_t leaf,
                             const std::function<void()>& check = {});

}  // namespace knead
