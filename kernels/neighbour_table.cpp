#include "kernels/neighbour_table.h"

#include <algorithm>

#include "graph/error.h"
#include "kernels/lane_table.h"

namespace knead {
namespace {

constexpr uint32_t kBlock = NeighbourTable::kLaneBlock;

uint32_t padded(uint32_t n) {
  return (n + kBlock - 1) / kBlock * kBlock;
}

// Window by window, vertices by falling valence, equal ones in their own order.
std::vector<uint32_t> sorted_by_valence(std::span<const uint32_t> offsets, Lanes lanes) {
  const auto valence = [&](uint32_t v) { return offsets[v + 1] - offsets[v]; };
  std::vector<uint32_t> order;
  for (uint32_t v = 0; v + 1 < offsets.size(); ++v)
    if (lanes == Lanes::kAll || valence(v) > 0) order.push_back(v);
  for (size_t begin = 0; begin < order.size(); begin += kSortWindow)
    std::stable_sort(order.begin() + static_cast<ptrdiff_t>(begin),
                     order.begin() + static_cast<ptrdiff_t>(std::min(begin + kSortWindow, order.size())),
                     [&](uint32_t a, uint32_t b) { return valence(a) > valence(b); });
  return order;
}

void check_adjacency(const Adjacency& a) {
  const bool good = !a.offsets.empty() && a.columns >= 1 && a.columns <= 3 && a.offsets.front() == 0 && a.offsets.back() == a.values.size() &&
                    a.indices.size() == a.values.size() * a.columns && std::is_sorted(a.offsets.begin(), a.offsets.end());
  if (!good) throw Error(ErrorCode::kInternal, "neighbour table: offsets, indices and values disagree");
}

std::string at(const char* what, size_t place) {
  return std::string(what) + " at " + std::to_string(place);
}

}  // namespace

NeighbourTable make_neighbour_table(const Adjacency& adjacency, PadIndex pad, Lanes lanes, Executor& executor) {
  check_adjacency(adjacency);
  const auto& offsets = adjacency.offsets;
  const uint32_t vertices = static_cast<uint32_t>(offsets.size() - 1);
  uint32_t largest = 0;
  for (uint32_t v = 0; v < vertices; ++v) largest = std::max(largest, offsets[v + 1] - offsets[v]);
  const std::vector<uint32_t> order = sorted_by_valence(offsets, lanes);

  NeighbourTable table;
  table.lanes = static_cast<uint32_t>(order.size());
  table.largest = largest;
  table.columns = adjacency.columns;
  const uint32_t lane_count = padded(table.lanes);
  table.order = Buffer<uint32_t>(lane_count);
  table.valence = Buffer<uint32_t>(lane_count);
  table.block_offsets = Buffer<uint32_t>(lane_count / kBlock + 1);
  uint32_t* lane_vertex = table.order.data_for_write();
  uint32_t* valence = table.valence.data_for_write();
  for (uint32_t t = 0; t < lane_count; ++t) {
    lane_vertex[t] = order[std::min(t, table.lanes - 1)];
    valence[t] = t < table.lanes ? offsets[lane_vertex[t] + 1] - offsets[lane_vertex[t]] : 0;
  }
  uint32_t* block = table.block_offsets.data_for_write();
  block[0] = 0;
  for (uint32_t b = 0; b < lane_count / kBlock; ++b) {
    const uint64_t end = block[b] + uint64_t{kBlock} * valence[b * kBlock];  // the first lane of a block has the most
    if (end > UINT32_MAX) throw Error(ErrorCode::kMemory, "neighbour table: more than 2^32 entries", "use a coarser tet mesh");
    block[b + 1] = static_cast<uint32_t>(end);
  }

  const size_t entries = block[lane_count / kBlock];
  table.indices = Buffer<uint32_t>(entries * table.columns);
  table.values = Buffer<float>(entries);
  uint32_t* indices = table.indices.data_for_write();
  float* values = table.values.data_for_write();
  executor.parallel_ranges(lane_count, 4096, [&](size_t begin, size_t end) {
    for (size_t t = begin; t < end; ++t) {
      const uint32_t pad_index = pad == PadIndex::kOwnVertex ? lane_vertex[t] : 0;
      const uint32_t places = (block[t / kBlock + 1] - block[t / kBlock]) / kBlock;
      for (uint32_t k = 0; k < places; ++k) {
        const size_t entry = size_t{block[t / kBlock]} + k * kBlock + t % kBlock;
        const bool has = k < valence[t];
        const size_t from = has ? size_t{offsets[lane_vertex[t]]} + k : 0;
        values[entry] = has ? adjacency.values[from] : 0.0f;
        for (uint32_t c = 0; c < table.columns; ++c) indices[c * entries + entry] = has ? adjacency.indices[from * table.columns + c] : pad_index;
      }
    }
  });
  return table;
}

Buffer<float> lane_sums(const NeighbourTable& table) {
  Buffer<float> sums(table.order.size());
  float* sum = sums.data_for_write();
  const LaneTable lanes = lane_table(table, Device{});
  for (uint32_t t = 0; t < sums.size(); ++t) {
    double all = 0;
    for (uint32_t k = 0; k < lanes.valence[t]; ++k) all += lanes.values[lanes.entry(t, k)];
    sum[t] = static_cast<float>(all);
  }
  return sums;
}

std::string check_neighbour_table(const NeighbourTable& table, uint32_t index_count, PadIndex pad) {
  const auto order = table.order.host(), valence = table.valence.host(), block = table.block_offsets.host(), indices = table.indices.host();
  const auto values = table.values.host();
  const size_t entries = table.entries(), blocks = order.size() / kBlock;
  if (order.size() != padded(table.lanes) || valence.size() != order.size()) return "lanes are not padded to the block";
  if (block.size() != blocks + 1 || block[0] != 0 || block[blocks] != entries) return "block offsets do not span the entries";
  if (indices.size() != entries * table.columns) return "indices and values disagree in number";
  if (table.lanes > 0 && *std::max_element(valence.begin(), valence.end()) != table.largest) return "no lane has the largest valence";
  const LaneTable lanes = lane_table(table, Device{});
  for (uint32_t t = 0; t < order.size(); ++t) {
    if (t >= table.lanes && (valence[t] != 0 || order[t] != order[table.lanes - 1])) return at("padding lane is not empty", t);
    if (t % kSortWindow != 0 && valence[t] > valence[t - 1]) return at("valence rises", t);
    if (t % kBlock == 0 && block[t / kBlock + 1] != block[t / kBlock] + kBlock * valence[t]) return at("wrong length of block", t / kBlock);
    for (uint32_t k = 0; lanes.has(t, k); ++k) {
      const size_t entry = lanes.entry(t, k);
      const bool padding = k >= valence[t];
      if (padding && values[entry] != 0.0f) return at("padding contributes", entry);
      for (uint32_t c = 0; c < table.columns; ++c) {
        const uint32_t index = indices[c * entries + entry];
        if (padding && index != (pad == PadIndex::kOwnVertex ? order[t] : 0)) return at("padding points elsewhere", entry);
        if (index >= index_count) return at("index out of range", entry);
      }
    }
  }
  std::vector<uint32_t> sorted(order.begin(), order.begin() + table.lanes);
  std::sort(sorted.begin(), sorted.end());
  if (std::adjacent_find(sorted.begin(), sorted.end()) != sorted.end()) return "a vertex has two lanes";
  return {};
}

std::vector<std::vector<Neighbour>> neighbours_by_vertex(const NeighbourTable& table, uint32_t vertices) {
  const LaneTable lanes = lane_table(table, Device{});
  std::vector<std::vector<Neighbour>> result(vertices);
  for (uint32_t t = 0; t < table.lanes; ++t)
    for (uint32_t k = 0; k < lanes.valence[t]; ++k) {
      const size_t entry = lanes.entry(t, k);
      Neighbour neighbour{{0, 0, 0}, lanes.values[entry]};
      for (uint32_t c = 0; c < table.columns; ++c) neighbour.indices[c] = lanes.indices[c * lanes.entries + entry];
      result.at(lanes.order[t]).push_back(neighbour);
    }
  return result;
}

}  // namespace knead
