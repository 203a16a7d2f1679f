// Coordinates of a point in a cell of H: barycentric in a tet, trilinear in a box, mean value in a closed triangle cage.
#pragma once
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "graph/executor.h"
#include "kernels/port_types.h"

namespace knead {

// Sum to 1 and reproduce p; all non-negative when p is inside. The tet must not be flat.
std::array<double, 4> barycentric_coordinates(const Vec3d& p, const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d);

// Of the corners of the unit cube, x lowest bit.
std::array<double, 8> trilinear_coordinates(const Vec3d& p);

// Ju, Schaefer and Warren 2005. The cage is closed, consistently oriented, convex here, and about 1 in size; p is inside it or on it: on a triangle
// the coordinates are barycentric in that triangle. Writes one weight per vertex, summing to 1.
void mean_value_coordinates(std::span<const Vec3d> vertices, std::span<const std::array<uint8_t, 3>> triangles, const Vec3d& p,
                            std::span<double> weights);

// Rows of W as they are made: vertex i of M is sum over entries [offsets[i], offsets[i + 1]) of weights * x_indices.
struct LatticeRows {
  std::vector<uint32_t> offsets, indices;
  std::vector<float> weights;
};

// A row more: entries too small to matter dropped, the rest rounded so that their sum is 1 to the last place.
void append_row(std::span<const uint32_t> row_indices, std::span<const double> row_weights, std::vector<uint32_t>& indices,
                std::vector<float>& weights);

// Both tables of a Lattice. `used[i]` = 0 keeps vertex i of M out of the way back to H: it follows the body and does not move it.
void fill_lattice_tables(const LatticeRows& rows, std::span<const uint8_t> used, uint32_t tet_vertices, Lattice& lattice, Executor& executor);

}  // namespace knead
