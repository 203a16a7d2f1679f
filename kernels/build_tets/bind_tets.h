// H from elsewhere: any tet mesh made fit for the loop and the equilibrium, and M bound to it.
#pragma once
#include <array>
#include <string>
#include <vector>

#include "kernels/build_tets/build_tets.h"

namespace knead {

struct GivenTets {
  std::vector<Vec3d> points;                  // M's local space
  std::vector<std::array<uint32_t, 4>> tets;  // either way round
};

struct BoundTets {
  BuiltTets build;      // without cells
  size_t outside = 0;   // vertices of M that lie outside H, by more than rounding,
  double furthest = 0;  // and how far the furthest one does, local units
};

// Tets that are inside out are turned, flat ones and vertices that no tet uses are left out, each with a line in `warnings`. Vertices of M are tied to the tet
// that holds them (barycentric); one outside H, by no more than `tolerance` (local units), to the nearest point of H. Throws Error(kInput) for positions that
// are not finite, when no tet is left, and for vertices of M further away, unless no face uses them.
BoundTets bind_tets(const Surface& surface, GivenTets given, double tolerance, Executor& executor, std::vector<std::string>& warnings);

}  // namespace knead
