// The material inside one octree cell: the patches of M's surface in it, and which of them bound the same piece of M's inside.
#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "kernels/build_tets/cells.h"
#include "kernels/surface/disjoint_sets.h"

namespace knead {

// For one cell after another; keeps its working storage. Not thread-safe: one each.
class CellMaterial {
 public:
  CellMaterial(const SoftBody& body, const WindingNumber& winding) : body_(body), winding_(winding) {}

  // Writes the piece of every triangle, 0 to the number of pieces - 1, and returns that number. Two triangles are of one piece when they
  // hang together within the cell, or when a straight way between them stays inside M: a patch is a border between one inside and one outside region
  // of the convex cell, so the ways from one patch to all others find every pair that bounds the same region.
  uint32_t pieces(const OctreeNode& cell, std::span<const uint32_t> triangles, size_t most_patches, std::vector<uint32_t>& piece);

  // The place in `triangles` of the first one met on the straight way from `from`, in the closed cell, to the material; `triangles` is not empty.
  size_t nearest_along(const OctreeNode& cell, std::span<const uint32_t> triangles, const Vec3d& from);

 private:
  struct Crossing {
    double t;
    uint32_t place;  // in the list of triangles
  };
  void join_over_vertices(std::span<const uint32_t> triangles);
  void join_over_edges(std::span<const uint32_t> triangles);
  void join_through_inside(std::span<const uint32_t> triangles);
  uint32_t number_pieces(std::span<const uint32_t> triangles, std::vector<uint32_t>& piece);
  Vec3d place_on(uint32_t triangle, double& area) const;
  void cross(std::span<const uint32_t> triangles, const Vec3d& from, const Vec3d& to);
  bool in_cell(const Vec3d& p) const;
  void join(uint32_t a, uint32_t b);

  const SoftBody& body_;
  const WindingNumber& winding_;
  Vec3d centre_{0, 0, 0};
  double half_ = 0;
  DisjointSets sets_;  // of the places in the list of triangles
  size_t count_ = 0;
  std::vector<std::pair<uint64_t, uint32_t>> keyed_;
  std::vector<Crossing> crossings_;
};

}  // namespace knead
