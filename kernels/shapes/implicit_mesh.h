// Contours a smooth implicit function to a closed triangle mesh of near-uniform triangles.
#pragma once
#include <cstdint>
#include <vector>

#include "graph/executor.h"
#include "kernels/vec.h"

namespace knead {

using ImplicitFunction = FunctionRef<double(const Vec3d&)>;  // negative inside, roughly a distance near the surface

struct TriangleMesh {
  std::vector<Vec3d> points;
  std::vector<uint32_t> triangles;  // 3 each, outward
};

// The zero set by marching tetrahedra on a grid of cubes of side `cell`, six tets a cube: always closed and manifold when the function is positive on
// the border of the box.
TriangleMesh contour(ImplicitFunction value, const Vec3d& lower, const Vec3d& upper, double cell);

// A mesh of exactly `vertices` vertices (for a feasible count; otherwise as near as the topology allows) whose edges are about `edge(p)` times one
// length, with `edge` a smooth function near 1: contour, then splits, collapses, flips and tangential smoothing, each vertex drawn back to the zero
// set (after Botsch and Kobbelt 2004, "A remeshing approach to multiresolution modeling"). Serial and deterministic.
TriangleMesh contour_even(ImplicitFunction value, const Vec3d& lower, const Vec3d& upper, int vertices, ImplicitFunction edge);

// The steps of contour_even.
class Remesher {
 public:
  Remesher(TriangleMesh mesh, ImplicitFunction value, ImplicitFunction edge);
  void round(double edge);      // one pass of everything
  void reach(size_t vertices);  // collapses the shortest or splits the longest edges until the count is met
  void settle(int rounds);      // flips and smoothing only
  size_t vertices() const { return live_; }
  TriangleMesh result() const;  // without the holes that collapses leave

 private:
  struct Edge {
    uint32_t a, b;
    double length;
  };
  std::vector<Edge> edges() const;                 // a < b, sorted by vertex
  double length_of(uint32_t a, uint32_t b) const;  // over what `edge` asks for there
  int faces_of(uint32_t a, uint32_t b, uint32_t faces[2]) const;
  uint32_t opposite(uint32_t face, uint32_t a, uint32_t b) const;
  Vec3d normal_of(uint32_t a, uint32_t b, uint32_t c) const;
  void split(uint32_t a, uint32_t b);
  bool collapse(uint32_t a, uint32_t b, double longest);  // b into a, at the middle; false when it would fold, pinch or stretch the mesh
  void flip_all();
  void smooth();
  Vec3d project(const Vec3d& p, const Vec3d& normal) const;  // along the mesh's own normal
  void unlink(uint32_t face, uint32_t vertex);

  std::vector<Vec3d> points_;
  std::vector<uint32_t> faces_;  // 3 each; kGone when collapsed
  std::vector<std::vector<uint32_t>> vertex_faces_;
  size_t live_ = 0;
  ImplicitFunction value_, edge_;
  double reach_ = 0;  // the furthest that project looks
};

}  // namespace knead
