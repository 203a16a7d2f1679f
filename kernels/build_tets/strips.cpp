#include "kernels/build_tets/strips.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "kernels/lane_table.h"
#include "kernels/neighbour_table.h"

namespace knead {
namespace {

constexpr uint32_t kNone = UINT32_MAX;

float over_six(float volume) {
  return static_cast<float>(1 / (6 * static_cast<double>(volume)));
}

struct Entry {
  uint32_t vertex;
  float value;
};

// Walks the triangles around one vertex. Kept between vertices for its storage.
class Walker {
 public:
  void begin() { triangles_.clear(), values_.clear(); }
  void add(const std::array<uint32_t, 3>& corners, float value) { triangles_.push_back(corners), values_.push_back(value); }

  void walk(std::vector<Entry>& entries) {
    const size_t n = triangles_.size();
    find_neighbours();
    visited_.assign(n, 0);
    bool negative = false;  // the sign of the value before
    for (size_t left = n; left > 0;) {
      uint32_t t = start();
      // Two vertices to start with and the third: each takes the place of the oldest, so that signs alternate; the order of the corners makes the
      // last fit.
      std::array<uint32_t, 3> last = triangles_[t];
      const bool last_negative = !negative;
      if (last_negative) std::swap(last[0], last[1]);
      entries.push_back({last[0], negative ? 0.0f : -0.0f});
      entries.push_back({last[1], negative ? -0.0f : 0.0f});
      entries.push_back({last[2], last_negative ? -values_[t] : values_[t]});
      negative = last_negative;
      visited_[t] = 1;
      --left;
      for (;;) {
        const uint32_t across_new = unvisited(across(t, last[1], last[2])), across_kept = unvisited(across(t, last[0], last[2]));
        if (across_new == kNone && across_kept == kNone) break;
        const bool keep = across_new == kNone || (across_kept != kNone && ways_on(across_kept) < ways_on(across_new));
        t = keep ? across_kept : across_new;
        if (!keep) last[0] = last[1], negative = !negative;
        last[1] = last[2];
        last[2] = other(t, last[0], last[1]);
        entries.push_back({last[2], negative ? -values_[t] : values_[t]});
        visited_[t] = 1;
        --left;
      }
    }
  }

 private:
  struct Side {
    uint32_t low, high, triangle, edge;
    bool rising;  // from low to high
  };

  // neighbours_[t][e]: the triangle on the other side of the edge from corner e to the next, when it runs the edge the other way.
  void find_neighbours() {
    sides_.clear();
    for (uint32_t t = 0; t < triangles_.size(); ++t)
      for (uint32_t e = 0; e < 3; ++e) {
        const uint32_t a = triangles_[t][e], b = triangles_[t][(e + 1) % 3];
        sides_.push_back({std::min(a, b), std::max(a, b), t, e, a < b});
      }
    std::sort(sides_.begin(), sides_.end(), [](const Side& a, const Side& b) {
      return a.low != b.low             ? a.low < b.low
             : a.high != b.high         ? a.high < b.high
             : a.triangle != b.triangle ? a.triangle < b.triangle
                                        : a.edge < b.edge;
    });
    neighbours_.assign(triangles_.size(), {kNone, kNone, kNone});
    for (size_t s = 0; s + 1 < sides_.size(); ++s) {
      const Side &one = sides_[s], &two = sides_[s + 1];
      if (one.low != two.low || one.high != two.high || one.rising == two.rising) continue;
      neighbours_[one.triangle][one.edge] = two.triangle;
      neighbours_[two.triangle][two.edge] = one.triangle;
    }
  }

  uint32_t across(uint32_t t, uint32_t a, uint32_t b) const {
    for (uint32_t e = 0; e < 3; ++e) {
      const uint32_t from = triangles_[t][e], to = triangles_[t][(e + 1) % 3];
      if ((from == a && to == b) || (from == b && to == a)) return neighbours_[t][e];
    }
    return kNone;
  }
  uint32_t unvisited(uint32_t t) const { return t != kNone && !visited_[t] ? t : kNone; }
  int ways_on(uint32_t t) const {
    int ways = 0;
    for (const uint32_t next : neighbours_[t]) ways += unvisited(next) != kNone;
    return ways;
  }
  uint32_t other(uint32_t t, uint32_t a, uint32_t b) const {
    for (const uint32_t v : triangles_[t])
      if (v != a && v != b) return v;
    return kNone;
  }
  uint32_t start() const {
    uint32_t best = kNone;
    int fewest = 4;
    for (uint32_t t = 0; t < triangles_.size(); ++t)
      if (!visited_[t] && ways_on(t) < fewest) best = t, fewest = ways_on(t);
    return best;
  }

  std::vector<std::array<uint32_t, 3>> triangles_, neighbours_;
  std::vector<float> values_;
  std::vector<Side> sides_;
  std::vector<uint8_t> visited_;
};

}  // namespace

NeighbourTable make_strips(const NeighbourTable& vertex_tets, Executor& executor) {
  const auto order = vertex_tets.order.host(), valence = vertex_tets.valence.host();
  const auto corners = vertex_tets.indices.host();
  const auto volumes = vertex_tets.values.host();
  const size_t entries = vertex_tets.entries();
  const LaneTable around = lane_table(vertex_tets, Device{});
  std::vector<uint32_t> lane_of(vertex_tets.lanes);
  for (uint32_t t = 0; t < vertex_tets.lanes; ++t) lane_of[order[t]] = t;
  constexpr size_t kPiece = 1024;
  std::vector<std::vector<Entry>> strips((lane_of.size() + kPiece - 1) / kPiece);
  std::vector<uint32_t> offsets(lane_of.size() + 1, 0);
  executor.parallel_ranges(lane_of.size(), kPiece, [&](size_t begin, size_t end) {
    Walker walker;
    std::vector<Entry>& found = strips[begin / kPiece];
    for (size_t v = begin; v < end; ++v) {
      const uint32_t t = lane_of[v];
      walker.begin();
      for (uint32_t k = 0; k < valence[t]; ++k) {
        const size_t e = around.entry(t, k);
        walker.add({corners[e], corners[entries + e], corners[2 * entries + e]}, over_six(volumes[e]));
      }
      const size_t before = found.size();
      walker.walk(found);
      offsets[v + 1] = static_cast<uint32_t>(found.size() - before);
    }
  });
  for (size_t v = 0; v < lane_of.size(); ++v) offsets[v + 1] += offsets[v];
  std::vector<uint32_t> indices;
  std::vector<float> values;
  indices.reserve(offsets.back());
  values.reserve(offsets.back());
  for (const std::vector<Entry>& piece : strips)
    for (const Entry& entry : piece) indices.push_back(entry.vertex), values.push_back(entry.value);
  return make_neighbour_table({offsets, indices, values, 1}, PadIndex::kOwnVertex, Lanes::kAll, executor);
}

}  // namespace knead
