// H and the lattice that ties M to it, from any surface (method.md 2).
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "graph/executor.h"
#include "kernels/port_types.h"

namespace knead {

enum class LatticeKind { kBarycentric, kTrilinear, kMeanValue };

constexpr int kDeepestOctree = 12;

struct BuildTetsOptions {
  int max_depth = 6;      // 1 to kDeepestOctree
  int min_depth = 3;      // 0 to max_depth; at most 8
  int surface_depth = 4;  // of cells that M touches, however few of its vertices they have; not beyond max_depth
  int max_vertices = 4;   // of M in a cell above max_depth
  bool split_pieces = false;
  LatticeKind lattice = LatticeKind::kBarycentric;
};

// A copy of a kept octree cell, for tests and pictures.
struct TetCell {
  uint32_t x, y, z;  // of 2^level a side
  int level;
};

struct BuiltTets {
  TetMesh tets;
  Lattice lattice;
  std::vector<TetCell> cells;            // copies of one cell one after another
  std::vector<uint32_t> cell_of_vertex;  // of M: into `cells`
  int depth = 0;                         // of the finest leaf
  Buffer<float> inside;                  // the part of each tet that lies inside M, 0 to 1 (inside_fraction.h)
  size_t pieces_split = 0;               // copies beyond one a cell
  double tet_volume = 0;                 // of H, local units^3
  double surface_volume = 0;             // enclosed by M, local units^3; of an open surface, an estimate
};

// M is reproduced by the lattice wherever a face uses the vertex. A vertex that no face uses follows the nearest cell and does not move the body;
// with coordinates that are not finite it is bound as if at the centre of M. Throws Error(kInput) when M has no usable triangle, Error(kMemory) when
// H does not fit.
BuiltTets build_tets(const Surface& surface, const BuildTetsOptions& options, Executor& executor, std::vector<std::string>& warnings);

}  // namespace knead
