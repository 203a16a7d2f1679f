// Morton keys: places in the order of a curve that keeps neighbours together.
#pragma once
#include <algorithm>
#include <cstdint>

#include "kernels/vec.h"

namespace knead {

constexpr int kMortonBits = 21;  // per axis

// 21 bits of each, x lowest.
inline uint64_t morton_key(uint32_t x, uint32_t y, uint32_t z) {
  const auto spread = [](uint64_t v) {  // every bit of v to every third bit
    v &= 0x1fffff;
    v = (v | v << 32) & 0x1f00000000ffffull;
    v = (v | v << 16) & 0x1f0000ff0000ffull;
    v = (v | v << 8) & 0x100f00f00f00f00full;
    v = (v | v << 4) & 0x10c30c30c30c30c3ull;
    return (v | v << 2) & 0x1249249249249249ull;
  };
  return spread(x) | spread(y) << 1 | spread(z) << 2;
}

// Of a point in [0, 1)^3, at 2^21 a side.
inline uint64_t morton_key(const Vec3d& unit) {
  constexpr double kSide = 1 << kMortonBits;
  const auto cell = [](double u) { return static_cast<uint32_t>(std::clamp(u * kSide, 0.0, kSide - 1)); };
  return morton_key(cell(unit.x), cell(unit.y), cell(unit.z));
}

}  // namespace knead
