// The parts of H that nothing holds, neither a pin nor a pull to rest, with their rigid motions: what keep_place.h takes out.
#pragma once
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "kernels/row4.h"
#include "kernels/vec.h"

namespace knead {

struct FloatingParts {
  static constexpr uint32_t kNone = UINT32_MAX;
  static constexpr uint32_t kFan = 32;      // Sums have at most this many terms,
  static constexpr uint32_t kMostRows = 7;  // so that 2^32 terms take this many rows of sums.
  uint32_t count = 0;
  std::vector<uint32_t> of_vertex;  // the part of each vertex, or kNone
  std::vector<float> mass;          // by vertex
  std::vector<Row4> arms;           // by vertex: from the centre of the part's mass, over the part's radius of gyration
  std::vector<double> inverse;      // [count][36] of the sums over a part of mass times products of its six rigid motions
  std::vector<uint32_t> members;    // vertices, part by part
  // How sums over the parts are made: the first row has offsets into `members`, the others into the sums of the row before; the last one has a sum a part.
  std::vector<std::vector<uint32_t>> tree;
};

// Parts hang together by tets. `corners`: by tet; a vertex is `held` by what is not zero.
FloatingParts floating_parts(std::span<const std::array<uint32_t, 4>> corners, std::span<const Vec3d> rest, std::span<const double> mass,
                             std::span<const uint8_t> held);

}  // namespace knead
