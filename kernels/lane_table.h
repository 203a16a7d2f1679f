// A NeighbourTable as kernel bodies see it: plain pointers, valid while the table's buffers live.
#pragma once
#include <cstddef>
#include <cstdint>

#include "kernels/data.h"
#include "kernels/vec.h"

namespace knead {

struct LaneTable {
  const uint32_t* order = nullptr;
  const uint32_t* valence = nullptr;
  const uint32_t* row_offsets = nullptr;
  const uint32_t* indices = nullptr;
  const float* values = nullptr;
  size_t entries = 0;
  uint32_t lanes = 0;
  uint32_t rows = 0;

  // The k-th neighbour of lane t, or of the block of lanes that starts at t. Padding entries contribute zero by the table's contract.
  KNEAD_HD bool has(uint32_t t, uint32_t k) const { return k < rows && t < row_offsets[k + 1] - row_offsets[k]; }
  KNEAD_HD size_t entry(uint32_t t, uint32_t k) const { return static_cast<size_t>(row_offsets[k]) + t; }
};

// Throws when the table lives elsewhere than `device`.
inline LaneTable lane_table(const NeighbourTable& table, Device device) {
  return {table.order.view(device).data(),   table.valence.view(device).data(), table.row_offsets.view(device).data(), table.indices.view(device).data(),
          table.values.view(device).data(), table.entries(),                   table.lanes,                           table.rows};
}

}  // namespace knead
