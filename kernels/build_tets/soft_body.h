// M as build_tets sees it: finite, along its own axes in the unit cube of the octree, welded and consistently oriented as far as it can be.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "graph/executor.h"
#include "kernels/port_types.h"

namespace knead {

// Root space: the octree's cube is [0, 1]^3, along M's principal axes where they are clear (principal_frame.h), else along those of local space.
struct SoftBody {
  Similarity to_local;                // root space to M's local space; scale is the cube's edge
  Vec3d centre{0, 0, 0};              // of M's box, root space
  std::vector<Vec3d> points;          // per vertex of M; vertices that no face uses may lie outside the cube, non-finite ones are at the centre
  std::vector<uint8_t> used;          // 1: finite, and some face uses it
  std::vector<uint32_t> welded;       // the first vertex in the same place, bit for bit
  std::vector<uint32_t> triangles;    // finite ones, reoriented; then those of faces without area, and (v, v, v) for a used vertex that has none
  std::vector<uint64_t> sorted_keys;  // Morton keys of the used places, each once
  bool closed = false;                // every edge is used as often one way as the other: the winding number is a whole number
  double volume = 0;                  // signed, root^3
  size_t triangle_count() const { return triangles.size() / 3; }
};

// Throws Error(kInput) when no triangle is left. Adds a line to `warnings` for everything that had to be assumed.
SoftBody make_soft_body(const Surface& surface, Executor& executor, std::vector<std::string>& warnings);

}  // namespace knead
