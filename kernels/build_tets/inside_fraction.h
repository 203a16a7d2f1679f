// The part of every tet of H that lies inside M: what of it is flesh.
//
// Exact for a closed M that does not run through itself: the mean of the winding number over the tet, by the divergence theorem from the triangles that are in
// its cells, and from the winding number at one of its corners. Where M winds about a place several times the place counts as often, up to the whole tet. Of
// an open M the winding numbers at corners are rounded, so that inside is where it exceeds one half, as for cells; round the rim of a hole a tet's part is then
// off by what of it lies within about a cell of the hole.
#pragma once
#include <array>
#include <span>
#include <vector>

#include "kernels/build_tets/tet_rules.h"

namespace knead {

// The mean, over the tet with these corners, of the number that falls by one across every triangle that is passed along its normal, given that number at the
// last corner.
double mean_winding(const std::array<Vec3d, 4>& tet, std::span<const std::array<Vec3d, 3>> triangles, double at_last);

// By tet of `raw`, 0 to 1. Of copies of a cell each has its own piece of the material.
std::vector<float> inside_fractions(const Octree& octree, const Cells& cells, const Copies& copies, const RawTets& raw, const SoftBody& body,
                                    const WindingNumber& winding, Executor& executor);

}  // namespace knead
