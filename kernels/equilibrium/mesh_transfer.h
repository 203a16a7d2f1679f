// From the vertices of one H to those of another around the same M: what a cascade over octree depths is made of. Displacements are piecewise linear in the
// tets of the first. Where H is split (lips, fingers) copies of a cell lie in the same place, so a vertex is not looked up by its position, but found by a
// walk from tet to tet that begins at a vertex of M which both bind and goes on along the edges of the second H.
#pragma once
#include <array>
#include <vector>

#include "kernels/equilibrium/rest_tables.h"

namespace knead {

struct MeshTransfer {
  std::vector<std::array<uint32_t, 4>> vertices;  // permuted vertices of the first H, by permuted vertex of the second
  std::vector<std::array<float, 4>> weights;      // sum to 1; negative, within bounds, outside the first H; all 0 where no walk leads
  size_t outside = 0;                             // vertices of the second H that are in no tet of the first
  size_t size() const { return vertices.size(); }
};

// Both are prepared for `executor`. Depends on the rest shapes alone.
MeshTransfer make_mesh_transfer(Executor& executor, const EquilibriumRest& from, const EquilibriumRest& to);

}  // namespace knead
