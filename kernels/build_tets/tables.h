// The vertices of H put in their final order, and the tables that the loop runs on.
#pragma once
#include <cstdint>
#include <vector>

#include "kernels/build_tets/tet_rules.h"

namespace knead {

// Renumbers vertices along the Morton curve, and within windows of kSortWindow by falling number of tets.
void sort_vertices(RawTets& raw);

// Tet space has its origin at `origin` (a place): positions are exact in float32.
TetMesh make_tet_mesh(const RawTets& raw, const std::array<int32_t, 3>& origin, Executor& executor);

}  // namespace knead
