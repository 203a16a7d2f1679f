// The generalised winding number of a triangle soup (Jacobson et al. 2013): 1 inside a closed outward-facing surface, 0 outside, in between where the
// surface has holes; evaluated through a tree of dipoles and their first moments (Barill et al. 2018).
#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "graph/executor.h"
#include "kernels/vec.h"

namespace knead {

// The sum over all triangles of the exact solid angle, over 4 pi: the oracle, and the tree's leaves.
double winding_number_exact(std::span<const Vec3d> points, std::span<const uint32_t> triangles, const Vec3d& at);

class WindingNumber {
 public:
  // Points must be finite where triangles use them. Copies what it needs.
  WindingNumber(std::span<const Vec3d> points, std::span<const uint32_t> triangles, Executor& executor);

  // Within about 0.01 of the exact sum. Thread-safe.
  double at(const Vec3d& query) const;

 private:
  struct Node {
    Vec3d centre{0, 0, 0};                                // of area
    Vec3d normal{0, 0, 0};                                // sum of area times unit normal
    Vec3d moment[3] = {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}};  // sum of (area normal) outer (place - centre), by row
    Vec3d lower{0, 0, 0}, upper{0, 0, 0};
    double area = 0, radius = 0;  // of a ball about the centre that holds the triangles
  };
  struct Corners {
    Vec3d a, b, c;
  };
  void add_triangles(Node& node, size_t begin, size_t end) const;
  static void finish(Node& node);

  std::vector<Corners> triangles_;         // in Morton order
  std::vector<std::vector<Node>> levels_;  // [0]: kGroup triangles a node; then kFan nodes a node, up to one
};

}  // namespace knead
