// Other structures for the neighbours than the library's own, for the same bodies (restore_volume_body.h, enforce_stiffness_body.h). Plain
// pointers and KNEAD_HD, so that a device can run them too.
#pragma once
#include <cstddef>
#include <cstdint>
#include <string>

#include "graph/buffer.h"
#include "kernels/lane_table.h"
#include "kernels/port_types.h"

namespace knead::bench {

// The paper's: row k holds the k-th neighbour of all lanes that have one (valence-sorted), each row padded to whole blocks of lanes.
struct JaggedTable {
  const uint32_t *order, *offsets, *indices;  // offsets: [rows + 1]
  const float* values;
  uint32_t lanes, rows;
  KNEAD_HD bool has(uint32_t t, uint32_t k) const { return k < rows && t < offsets[k + 1] - offsets[k]; }
  KNEAD_HD size_t entry(uint32_t t, uint32_t k) const { return static_cast<size_t>(offsets[k]) + t; }
};

// Padded ELL: every row as long as there are lanes.
struct EllTable {
  const uint32_t *order, *offsets, *indices;  // offsets: none
  const float* values;
  uint32_t lanes, rows;
  KNEAD_HD bool has(uint32_t, uint32_t k) const { return k < rows; }
  KNEAD_HD size_t entry(uint32_t t, uint32_t k) const { return static_cast<size_t>(k) * ((lanes + kBlock - 1) / kBlock * kBlock) + t; }
  static constexpr uint32_t kBlock = NeighbourTable::kLaneBlock;
};

// Sliced ELL: ELL for each block of kBlock lanes by itself. By valence it is the library's own.
struct SlicedTable {
  const uint32_t *order, *offsets, *indices;  // offsets: [blocks + 1] first entry of a block
  const float* values;
  uint32_t lanes, rows;
  KNEAD_HD bool has(uint32_t t, uint32_t k) const { return k * kBlock < offsets[t / kBlock + 1] - offsets[t / kBlock]; }
  KNEAD_HD size_t entry(uint32_t t, uint32_t k) const { return static_cast<size_t>(offsets[t / kBlock]) + k * kBlock + t % kBlock; }
  static constexpr uint32_t kBlock = NeighbourTable::kLaneBlock;
};

// CSR: a lane's neighbours one after another. Those of neighbouring lanes are not, so that it runs a lane at a time.
struct CsrTable {
  const uint32_t *order, *offsets, *indices;  // offsets: [lanes + 1]
  const float* values;
  uint32_t lanes, rows;
  KNEAD_HD bool has(uint32_t t, uint32_t k) const { return k < offsets[t + 1] - offsets[t]; }
  KNEAD_HD size_t entry(uint32_t t, uint32_t k) const { return static_cast<size_t>(offsets[t]) + k; }
};

enum class Structure { kJagged, kEll, kSliced, kCsr };
enum class Order { kByValence, kAsNumbered };

// The entries of a table in another structure.
struct TableData {
  Structure structure = Structure::kJagged;
  Buffer<uint32_t> order, offsets, indices;
  Buffer<float> values;
  uint32_t lanes = 0, rows = 0;

  size_t bytes() const { return order.bytes() + offsets.bytes() + indices.bytes() + values.bytes(); }
  template <class Table>
  Table on(Device device) const {
    return {order.view(device).data(), offsets.view(device).data(), indices.view(device).data(), values.view(device).data(), lanes, rows};
  }
};
TableData restructured(const NeighbourTable& table, uint32_t vertices, Structure structure, Order order);

}  // namespace knead::bench
