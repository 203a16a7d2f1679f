#include "tests/bench/tables.h"

#include <algorithm>
#include <numeric>
#include <vector>

namespace knead::bench {

TableData restructured(const NeighbourTable& table, uint32_t vertices, Structure structure, Order order) {
  std::vector<uint32_t> lane_of(vertices);
  for (uint32_t t = 0; t < table.lanes; ++t) lane_of[table.order.host()[t]] = t;
  constexpr uint32_t kBlock = NeighbourTable::kLaneBlock;
  const uint32_t padded = (vertices + kBlock - 1) / kBlock * kBlock;
  std::vector<uint32_t> sequence(vertices);
  std::iota(sequence.begin(), sequence.end(), 0u);
  const auto valence_of = [&](uint32_t v) { return table.valence.host()[lane_of[v]]; };
  if (order == Order::kByValence)
    std::stable_sort(sequence.begin(), sequence.end(), [&](uint32_t a, uint32_t b) { return valence_of(a) > valence_of(b); });
  sequence.resize(padded, sequence.back());

  // Where entry k of lane t goes, and how many lanes have a k-th place.
  TableData made;
  made.structure = structure;
  made.lanes = vertices;
  for (const uint32_t v : sequence) made.rows = std::max(made.rows, valence_of(v));
  std::vector<uint32_t> offsets{0};
  const auto longest = [&](uint32_t begin, uint32_t end) {
    uint32_t most = 0;
    for (uint32_t t = begin; t < std::min(end, vertices); ++t) most = std::max(most, valence_of(sequence[t]));
    return most;
  };
  if (structure == Structure::kJagged)
    for (uint32_t k = 0; k < made.rows; ++k) {
      uint32_t longer = 0;
      while (longer < vertices && valence_of(sequence[longer]) > k) ++longer;
      offsets.push_back(offsets.back() + (longer + kBlock - 1) / kBlock * kBlock);
    }
  if (structure == Structure::kEll) offsets.push_back(padded * made.rows);
  if (structure == Structure::kSliced)
    for (uint32_t t = 0; t < padded; t += kBlock) offsets.push_back(offsets.back() + kBlock * longest(t, t + kBlock));
  if (structure == Structure::kCsr)
    for (uint32_t t = 0; t < vertices; ++t) offsets.push_back(offsets.back() + valence_of(sequence[t]));

  made.order = Buffer<uint32_t>(sequence);
  made.offsets = Buffer<uint32_t>(offsets);
  made.indices = Buffer<uint32_t>(offsets.back());
  made.values = Buffer<float>(offsets.back());
  uint32_t* indices = made.indices.data_for_write();
  float* values = made.values.data_for_write();
  const LaneTable from = lane_table(table, Device{});
  const auto fill = [&](auto view) {
    for (uint32_t t = 0; t < (structure == Structure::kCsr ? vertices : padded); ++t)
      for (uint32_t k = 0; view.has(t, k); ++k) {
        const uint32_t v = sequence[t];
        const bool has = t < vertices && k < valence_of(v);
        const size_t source = has ? from.entry(lane_of[v], k) : 0;
        indices[view.entry(t, k)] = has ? from.indices[source] : v;
        values[view.entry(t, k)] = has ? from.values[source] : 0.0f;
      }
  };
  const auto view = [&]<class Table>() { return Table{sequence.data(), offsets.data(), nullptr, nullptr, vertices, made.rows}; };
  switch (structure) {
    case Structure::kJagged: fill(view.template operator()<JaggedTable>()); break;
    case Structure::kEll: fill(view.template operator()<EllTable>()); break;
    case Structure::kSliced: fill(view.template operator()<SlicedTable>()); break;
    case Structure::kCsr: fill(view.template operator()<CsrTable>()); break;
  }
  return made;
}

}  // namespace knead::bench
