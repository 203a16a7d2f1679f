#include "kernels/multigrid/grids.h"

#include <algorithm>
#include <numeric>

namespace knead {
namespace {

constexpr int64_t kMiddle = 1 << 20;  // of the 2^21 positions that a key tells apart along an axis

uint64_t spread_bits(uint64_t v) {  // 21 bits, two zeros between each and the next
  v = (v | v << 32) & 0x001f00000000ffffu;
  v = (v | v << 16) & 0x001f0000ff0000ffu;
  v = (v | v << 8) & 0x100f00f00f00f00fu;
  v = (v | v << 4) & 0x10c30c30c30c30c3u;
  return (v | v << 2) & 0x1249249249249249u;
}

uint64_t key_of(const std::array<int64_t, 3>& at) {
  uint64_t key = 0;
  for (size_t k = 0; k < 3; ++k) key |= spread_bits(static_cast<uint64_t>(std::clamp(at[k] + kMiddle, int64_t{0}, 2 * kMiddle - 1))) << k;
  return key;
}

int64_t floor_over(int64_t a, int64_t b) {
  return a >= 0 ? a / b : -((b - 1 - a) / b);
}

struct Touch {  // a finer node in reach of a grid position
  uint64_t key;
  uint32_t node;
  float weight;
  std::array<int32_t, 3> at;
};

std::vector<Touch> touches_of(const std::vector<GridPosition>& positions, std::span<const float> free, const GridPosition& origin, int32_t spacing) {
  std::vector<Touch> touches;
  touches.reserve(6 * positions.size());
  for (uint32_t i = 0; i < positions.size(); ++i) {
    if (!free.empty() && free[i] == 0) continue;
    std::array<int64_t, 3> low;
    std::array<float, 3> part;  // of the way to the next position
    for (size_t k = 0; k < 3; ++k) {
      const int64_t from = int64_t{positions[i][k]} - origin[k];
      low[k] = floor_over(from, spacing);
      part[k] = static_cast<float>(from - low[k] * spacing) / static_cast<float>(spacing);
    }
    for (int corner = 0; corner < 8; ++corner) {
      float weight = 1;
      std::array<int64_t, 3> at = low;
      Touch touch;
      for (size_t k = 0; k < 3; ++k) {
        const bool next = (corner >> k) & 1;
        at[k] += next;
        weight *= next ? part[k] : 1 - part[k];
        touch.at[k] = static_cast<int32_t>(at[k] * spacing + origin[k]);
      }
      if (weight == 0) continue;
      touch.key = key_of(at);
      touch.node = i;
      touch.weight = weight;
      touches.push_back(touch);
    }
  }
  std::sort(touches.begin(), touches.end(), [](const Touch& a, const Touch& b) { return a.key != b.key ? a.key < b.key : a.node < b.node; });
  return touches;
}

// Numbers the parts in which a position's nodes hang together.
class Parts {
 public:
  Parts(const SparseRows& joined, size_t nodes) : joined_(joined), part_(nodes, kOut) {}

  uint32_t split(std::span<const Touch> touches, std::vector<uint32_t>& part) {
    for (const Touch& t : touches) part_[t.node] = kOpen;
    uint32_t count = 0;
    for (const Touch& t : touches) {
      if (part_[t.node] != kOpen) continue;
      part_[t.node] = count;
      open_.assign(1, t.node);
      while (!open_.empty()) {
        const uint32_t node = open_.back();
        open_.pop_back();
        for (uint32_t e = joined_.offsets[node]; e < joined_.offsets[node + 1]; ++e) {
          uint32_t& next = part_[joined_.index[e]];
          if (next != kOpen) continue;
          next = count;
          open_.push_back(joined_.index[e]);
        }
      }
      ++count;
    }
    part.clear();
    for (const Touch& t : touches) {
      part.push_back(part_[t.node]);
      part_[t.node] = kOut;
    }
    return count;
  }

 private:
  static constexpr uint32_t kOut = 0xffffffffu, kOpen = 0xfffffffeu;
  const SparseRows& joined_;
  std::vector<uint32_t> part_, open_;
};

}  // namespace

SparseRows transposed(const SparseRows& a, uint32_t columns) {
  SparseRows to;
  to.offsets.assign(size_t{columns} + 1, 0);
  for (const uint32_t c : a.index) ++to.offsets[c + 1];
  std::partial_sum(to.offsets.begin(), to.offsets.end(), to.offsets.begin());
  to.index.resize(a.index.size());
  to.value.resize(a.index.size());
  std::vector<uint32_t> cursor(to.offsets.begin(), to.offsets.end() - 1);
  for (uint32_t r = 0; r < a.rows(); ++r)
    for (uint32_t e = a.offsets[r]; e < a.offsets[r + 1]; ++e) {
      const uint32_t at = cursor[a.index[e]]++;
      to.index[at] = r;
      to.value[at] = a.value[e];
    }
  return to;
}

CoarseGrid coarsen(const std::vector<GridPosition>& positions, const SparseRows& joined, std::span<const float> free, const GridPosition& origin,
                   int32_t spacing) {
  const std::vector<Touch> touches = touches_of(positions, free, origin, spacing);
  CoarseGrid grid;
  SparseRows& down = grid.down;
  Parts parts(joined, positions.size());
  std::vector<uint32_t> part, size;
  for (size_t begin = 0, end; begin < touches.size(); begin = end) {
    for (end = begin + 1; end < touches.size() && touches[end].key == touches[begin].key; ++end) {
    }
    const uint32_t count = parts.split({touches.data() + begin, end - begin}, part);
    for (uint32_t copy = 0; copy < count; ++copy) {
      for (size_t t = begin; t < end; ++t) {
        if (part[t - begin] != copy) continue;
        down.index.push_back(touches[t].node);
        down.value.push_back(touches[t].weight);
      }
      down.offsets.push_back(static_cast<uint32_t>(down.index.size()));
      grid.positions.push_back(touches[begin].at);
    }
  }
  grid.up = transposed(down, static_cast<uint32_t>(positions.size()));
  return grid;
}

GridPosition origin_of_next(const std::vector<GridPosition>& positions, const GridPosition& origin, int32_t spacing) {
  GridPosition next = origin;
  for (size_t k = 0; k < 3; ++k) {
    size_t even = 0, odd = 0;
    for (const GridPosition& at : positions) {
      const int64_t from = int64_t{at[k]} - origin[k], steps = floor_over(from, spacing);
      if (from == steps * spacing) ++(steps % 2 == 0 ? even : odd);
    }
    if (odd > even) next[k] += spacing;
  }
  return next;
}

std::vector<uint32_t> order_in_space(const std::vector<GridPosition>& positions) {
  std::vector<std::pair<uint64_t, uint32_t>> keyed(positions.size());
  const auto half = [](int32_t at) { return floor_over(at, kGridUnit / 2); };
  for (uint32_t i = 0; i < positions.size(); ++i) keyed[i] = {key_of({half(positions[i][0]), half(positions[i][1]), half(positions[i][2])}), i};
  std::sort(keyed.begin(), keyed.end());
  std::vector<uint32_t> order(positions.size());
  for (uint32_t i = 0; i < positions.size(); ++i) order[i] = keyed[i].second;
  return order;
}

}  // namespace knead
