// What ties the corners of H that have little of M's material to the rest: a penalty on the jump of the displacement's gradient over the faces between a tet
// that M cuts and its neighbours, as finite elements on cut cells have it (Burman 2010, "Ghost penalty"). Such a corner then follows the continuation of what
// its neighbours do. An affine displacement costs nothing, so that no stiffness is added where there is no flesh, and no tet is too weak to be solved.
//
//   1/2 g sum_faces h_F V_F mu (1 - w_F) |sum_c j_c u_c|^2      see ghost_penalty.cpp
#pragma once
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "kernels/multigrid/grids.h"
#include "kernels/vec.h"

namespace knead {

// The penalty's second derivative: a number per pair of places, the same along every axis; rows add up to zero, and the diagonal is left out.
// `corners`: by tet, places; `weights`: by tet, 0 to 1, what of it is material; `stiffness`: by tet, mu.
SparseRows ghost_penalty(std::span<const std::array<uint32_t, 4>> corners, std::span<const Vec3d> rest, std::span<const float> weights,
                         std::span<const float> stiffness, double factor);

}  // namespace knead
