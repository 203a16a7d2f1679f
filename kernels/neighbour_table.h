// Building, checking and reading back the valence-sorted neighbour table (kernels/port_types.h says how it is laid out; paper Fig. 2).
#pragma once
#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "graph/executor.h"
#include "kernels/port_types.h"

namespace knead {

// Neighbours by vertex, as they come out of preprocessing. Neighbour n of vertex v is entry e = offsets[v] + n: its index in column c is
// indices[e * columns + c], its value values[e].
struct Adjacency {
  std::span<const uint32_t> offsets;  // vertices + 1
  std::span<const uint32_t> indices;  // columns * entries, a neighbour's columns together
  std::span<const float> values;      // entries
  uint32_t columns = 1;
};

// What a padding entry points at, always with value 0: the lane's own vertex where indices and lanes are the same set (tets, edges), vertex 0 of the
// other set for maps between two sets.
enum class PadIndex { kOwnVertex, kZero };

// Which vertices get a lane: all of them, or only those that have a neighbour.
enum class Lanes { kAll, kWithNeighbours };

// Lanes are sorted by valence, descending, within windows of vertices; equal valences keep the order of the vertices. Over all of H's vertices at
// once, as in the paper, each valence would be a tour through the whole body, and every tour would fetch all positions from memory again; a window's
// stay in the nearest cache.
inline constexpr uint32_t kSortWindow = 4096;  // a multiple of NeighbourTable::kLaneBlock

// A vertex's neighbours keep their order.
// Throws Error(kMemory) when the table does not fit and Error(kInternal) when offsets and sizes disagree.
KNEAD_API NeighbourTable make_neighbour_table(const Adjacency& adjacency, PadIndex pad, Lanes lanes, Executor& executor);

// The sum of every lane's values, summed in double; 0 in padding lanes.
KNEAD_API Buffer<float> lane_sums(const NeighbourTable& table);

// "" or the first thing wrong with the table: order, valences, row lengths, padding, an index of `index_count` or more.
KNEAD_API std::string check_neighbour_table(const NeighbourTable& table, uint32_t index_count, PadIndex pad);

struct Neighbour {
  std::array<uint32_t, 3> indices;  // unused columns are 0
  float value;
};

// The neighbours of every vertex below `vertices`, as they were given; for tests and for preprocessing.
KNEAD_API std::vector<std::vector<Neighbour>> neighbours_by_vertex(const NeighbourTable& table, uint32_t vertices);

}  // namespace knead
