// Which vertices of a mesh lie at exactly the same place, so that a soup of triangles has the topology that it looks like.
#pragma once
#include <bit>
#include <cstdint>
#include <span>
#include <type_traits>
#include <vector>

#include "kernels/vec.h"

namespace knead {

// For each vertex the first one at its place, bit for bit; zero is zero, whatever its sign. Where `used` is given, vertices whose entry is zero are
// nobody's first and keep their own number.
template <class F>
std::vector<uint32_t> first_at_same_place(std::span<const Vec3<F>> points, std::span<const uint8_t> used = {}) {
  using Bits = std::conditional_t<sizeof(F) == 4, uint32_t, uint64_t>;
  constexpr uint32_t kEmpty = UINT32_MAX;
  const auto bits = [&](uint32_t i, int k) { return std::bit_cast<Bits>(points[i][k] + F(0)); };
  const auto same = [&](uint32_t i, uint32_t j) { return bits(i, 0) == bits(j, 0) && bits(i, 1) == bits(j, 1) && bits(i, 2) == bits(j, 2); };
  size_t slots = 16;
  while (slots < 2 * points.size()) slots *= 2;
  std::vector<uint32_t> table(slots, kEmpty), first(points.size());
  for (uint32_t i = 0; i < points.size(); ++i) {
    first[i] = i;
    if (!used.empty() && !used[i]) continue;
    uint64_t hash = 0;
    for (int k = 0; k < 3; ++k) {
      hash = (hash ^ bits(i, k)) * 0x9e3779b97f4a7c15ull;
      hash ^= hash >> 29;
    }
    size_t slot = hash & (slots - 1);
    while (table[slot] != kEmpty && !same(table[slot], i)) slot = (slot + 1) & (slots - 1);
    if (table[slot] == kEmpty) table[slot] = i;
    first[i] = table[slot];
  }
  return first;
}

}  // namespace knead
