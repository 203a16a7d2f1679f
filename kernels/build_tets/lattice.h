// Which cell of H each vertex of M is in, and its coordinates there.
#pragma once
#include <cstdint>
#include <vector>

#include "kernels/build_tets/build_tets.h"
#include "kernels/build_tets/lattice_coordinates.h"
#include "kernels/build_tets/tet_rules.h"

namespace knead {

// The copy that holds each vertex of M; a vertex that lies in no kept cell is moved to the nearest point of the nearest one (`points` change).
std::vector<uint32_t> bind_vertices(const Octree& octree, const Cells& cells, const Copies& copies, const SoftBody& body, std::vector<Vec3d>& points,
                                    Executor& executor);

// `points` in root space.
LatticeRows make_lattice_rows(const Octree& octree, const Cells& cells, const Copies& copies, const RawTets& raw, const std::vector<Vec3d>& points,
                              const std::vector<uint32_t>& copy_of_vertex, LatticeKind kind, Executor& executor);

}  // namespace knead
