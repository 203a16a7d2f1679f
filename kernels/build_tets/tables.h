// The vertices of H put in their final order, and the tables that the loop runs on.
#pragma once
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "kernels/build_tets/tet_rules.h"

namespace knead {

// The vertices along the Morton curve of their places (none below 0), and within windows of kSortWindow by falling number of tets.
std::vector<uint32_t> vertex_order(const std::vector<std::array<int32_t, 3>>& places, const std::vector<std::array<uint32_t, 4>>& tets);

// Renumbers vertices in that order.
void sort_vertices(RawTets& raw);

// Tet space has its origin at `origin` (a place): positions are exact in float32.
TetMesh make_tet_mesh(const RawTets& raw, const std::array<int32_t, 3>& origin, Executor& executor);

// From positions in tet space and tets that are positive there.
TetMesh make_tet_mesh(const std::vector<Vec3d>& positions, const std::vector<std::array<uint32_t, 4>>& tets, std::span<const float> volumes,
                      Executor& executor);

}  // namespace knead
