// Inside io/mesh_*.cpp: triangles of one surface that pass through each other.
#pragma once
#include <cstddef>

#include "kernels/port_types.h"

namespace knead::mesh {

struct Crossings {
  size_t pairs = 0;
  bool complete = true;  // false when the search was given up: `pairs` is then a lower bound
};

// Pairs of triangles where an edge of one passes through the inside of the other. Triangles that merely touch, lie flat on each other, or share the
// vertex (by place) that they meet in are not counted. Signs are decided in double with an error bound; what is too close to call is no crossing.
Crossings count_crossings(const Surface& surface);

}  // namespace knead::mesh
