// Which of n things belong together, found by joining pairs (union-find with path halving).
#pragma once
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <vector>

namespace knead {

// A set's root is its smallest member, whatever the order of the joins.
class DisjointSets {
 public:
  explicit DisjointSets(size_t n = 0) { reset(n); }
  void reset(size_t n) {  // each on its own again
    parent_.resize(n);
    std::iota(parent_.begin(), parent_.end(), 0u);
  }
  size_t size() const { return parent_.size(); }
  uint32_t find(uint32_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  bool join(uint32_t a, uint32_t b) {  // false when they were together before
    a = find(a), b = find(b);
    parent_[std::max(a, b)] = std::min(a, b);
    return a != b;
  }

 private:
  std::vector<uint32_t> parent_;
};

}  // namespace knead
