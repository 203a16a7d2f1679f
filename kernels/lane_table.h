// A NeighbourTable as kernel bodies see it: plain pointers, valid while the table's buffers live.
#pragma once
#include <cstddef>
#include <cstdint>

#include "kernels/port_types.h"
#include "kernels/vec.h"

namespace knead {

struct LaneTable {
  static constexpr uint32_t kBlock = NeighbourTable::kLaneBlock;
  const uint32_t* order = nullptr;
  const uint32_t* valence = nullptr;
  const uint32_t* block_offsets = nullptr;
  const uint32_t* indices = nullptr;
  const float* values = nullptr;
  size_t entries = 0;
  uint32_t lanes = 0;

  // The k-th neighbour of lane t, or of the lanes from t on in its block. Entries of lanes that have no more neighbours contribute zero by the
  // table's contract.
  KNEAD_HD bool has(uint32_t t, uint32_t k) const { return k * kBlock < block_offsets[t / kBlock + 1] - block_offsets[t / kBlock]; }
  KNEAD_HD size_t entry(uint32_t t, uint32_t k) const { return static_cast<size_t>(block_offsets[t / kBlock]) + k * kBlock + t % kBlock; }
};

// Throws when the table lives elsewhere than `device`.
inline LaneTable lane_table(const NeighbourTable& table, Device device) {
  return {table.order.view(device).data(),
          table.valence.view(device).data(),
          table.block_offsets.view(device).data(),
          table.indices.view(device).data(),
          table.values.view(device).data(),
          table.entries(),
          table.lanes};
}

}  // namespace knead
