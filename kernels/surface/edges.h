// Which faces use which edge of a mesh, and which way round.
#pragma once
#include <algorithm>
#include <concepts>
#include <cstdint>
#include <numeric>
#include <span>
#include <vector>

#include "graph/executor.h"

namespace knead {

// A face's use of an edge, kept with the edge's lower vertex.
struct EdgeUse {
  uint32_t high;          // the edge's higher vertex
  uint32_t corner, next;  // of the face: where its walk along the edge begins and ends. A triangle's corners are 3 t, 3 t + 1, 3 t + 2
  bool forward;           // the walk is from the lower vertex to the higher one
  uint32_t triangle() const { return corner / 3; }
};

// How often an edge is used forward rather than backward.
inline int net_use(std::span<const EdgeUse> uses) {
  int net = 0;
  for (const EdgeUse& use : uses) net += use.forward ? 1 : -1;
  return net;
}

class EdgeUses {
 public:
  // Of triangles. One with fewer than three different corners has no edges that mean anything and is left out. `executor` sorts, when it is given.
  EdgeUses(size_t vertices, std::span<const uint32_t> triangles, Executor* executor = nullptr)
      : EdgeUses(
            vertices,
            [&](auto&& walk) {
              for (uint32_t c = 0; c + 2 < triangles.size(); c += 3) {
                const uint32_t a = triangles[c], b = triangles[c + 1], d = triangles[c + 2];
                if (a == b || b == d || d == a) continue;
                walk(a, b, c, c + 1);
                walk(b, d, c + 1, c + 2);
                walk(d, a, c + 2, c);
              }
            },
            executor) {}

  // Of any faces: `each_walk(walk)` calls walk(from, to, corner, next) for every edge of every face, twice alike. An edge from a vertex to itself is
  // left out.
  template <class Walks>
  requires(!std::convertible_to<const Walks&, std::span<const uint32_t>>) EdgeUses(size_t vertices, const Walks& each_walk, Executor* executor)
      : offsets_(vertices + 1, 0) {
    each_walk([&](uint32_t from, uint32_t to, uint32_t, uint32_t) { offsets_[std::min(from, to) + 1] += from != to; });
    std::partial_sum(offsets_.begin(), offsets_.end(), offsets_.begin());
    uses_.resize(offsets_.back());
    std::vector<uint32_t> end(offsets_.begin(), offsets_.end() - 1);
    each_walk([&](uint32_t from, uint32_t to, uint32_t corner, uint32_t next) {
      if (from != to) uses_[end[std::min(from, to)]++] = {std::max(from, to), corner, next, from < to};
    });
    const auto sort = [&](size_t begin, size_t last) {
      for (size_t v = begin; v < last; ++v)
        std::sort(uses_.begin() + offsets_[v], uses_.begin() + offsets_[v + 1],
                  [](const EdgeUse& a, const EdgeUse& b) { return a.high != b.high ? a.high < b.high : a.corner < b.corner; });
    };
    if (executor)
      executor->parallel_ranges(vertices, kVerticesPerPiece, sort);
    else
      sort(0, vertices);
  }

  // f(lower vertex, the edge's uses by rising corner) for every edge, in the order of its vertices.
  template <class F>
  void each_edge(F&& f) const {
    for (uint32_t v = 0; v + 1 < offsets_.size(); ++v)
      for (uint32_t begin = offsets_[v], end; begin < offsets_[v + 1]; begin = end) {
        for (end = begin + 1; end < offsets_[v + 1] && uses_[end].high == uses_[begin].high;) ++end;
        f(v, std::span<const EdgeUse>(&uses_[begin], end - begin));
      }
  }

  // Every edge is used as often one way as the other: the faces enclose a volume, and winding numbers are whole.
  bool closed() const {
    bool all = true;
    each_edge([&](uint32_t, std::span<const EdgeUse> uses) { all = all && net_use(uses) == 0; });
    return all;
  }

 private:
  static constexpr size_t kVerticesPerPiece = 8192;
  std::vector<uint32_t> offsets_;  // by lower vertex
  std::vector<EdgeUse> uses_;
};

}  // namespace knead
