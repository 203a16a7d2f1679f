#include "kernels/equilibrium/floating_parts.h"

#include <algorithm>
#include <cmath>

#include "kernels/equilibrium/keep_place_body.h"

namespace knead {
namespace {

uint32_t root_of(std::vector<uint32_t>& above, uint32_t p) {
  while (above[p] != p) p = above[p] = above[above[p]];
  return p;
}

// By vertex, the part that it is of, parts in the order of their first vertices.
uint32_t find_parts(std::span<const std::array<uint32_t, 4>> corners, std::span<const uint8_t> held, std::vector<uint32_t>& part) {
  const uint32_t n = static_cast<uint32_t>(held.size());
  std::vector<uint32_t> above(n);
  for (uint32_t p = 0; p < n; ++p) above[p] = p;
  for (const auto& tet : corners)
    for (size_t c = 1; c < 4; ++c) {
      const uint32_t a = root_of(above, tet[0]), b = root_of(above, tet[c]);
      above[std::max(a, b)] = std::min(a, b);
    }
  std::vector<uint8_t> stays(n, 0);
  for (uint32_t p = 0; p < n; ++p)
    if (held[p]) stays[root_of(above, p)] = 1;
  uint32_t count = 0;
  part.assign(n, FloatingParts::kNone);
  for (uint32_t p = 0; p < n; ++p) {
    const uint32_t root = root_of(above, p);
    if (stays[root]) continue;
    part[p] = root == p ? count++ : part[root];  // A root is the first of its part.
  }
  return count;
}

// Each row sums at most kFan of the row before, none across two parts.
void make_tree(const std::vector<uint32_t>& ends, FloatingParts& parts) {
  std::vector<uint32_t> end = ends;  // of each part, among what the next row sums
  do {
    std::vector<uint32_t> offsets{0};
    for (size_t k = 0; k < end.size(); ++k) {
      const uint32_t last = end[k];
      while (offsets.back() < last) offsets.push_back(std::min(last, offsets.back() + FloatingParts::kFan));
      end[k] = static_cast<uint32_t>(offsets.size() - 1);
    }
    parts.tree.push_back(std::move(offsets));
  } while (parts.tree.back().size() - 1 > parts.count);
}

}  // namespace

FloatingParts floating_parts(std::span<const std::array<uint32_t, 4>> corners, std::span<const Vec3d> rest, std::span<const double> mass,
                             std::span<const uint8_t> held) {
  FloatingParts parts;
  const uint32_t n = static_cast<uint32_t>(rest.size());
  parts.count = find_parts(corners, held, parts.of_vertex);
  if (parts.count == 0) return {};
  parts.mass.assign(mass.begin(), mass.end());
  std::vector<uint32_t> ends(parts.count, 0);
  std::vector<double> weight(parts.count, 0), spread(parts.count, 0);
  std::vector<Vec3d> centre(parts.count, {0, 0, 0});
  for (uint32_t p = 0; p < n; ++p) {
    const uint32_t k = parts.of_vertex[p];
    if (k == FloatingParts::kNone) continue;
    ++ends[k];
    weight[k] += mass[p];
    centre[k] += mass[p] * rest[p];
  }
  for (uint32_t k = 0; k < parts.count; ++k) {
    centre[k] = (1 / weight[k]) * centre[k];
    if (k > 0) ends[k] += ends[k - 1];
  }
  std::vector<uint32_t> cursor(parts.count, 0);
  for (uint32_t k = 1; k < parts.count; ++k) cursor[k] = ends[k - 1];
  parts.members.resize(ends.back());
  for (uint32_t p = 0; p < n; ++p) {
    const uint32_t k = parts.of_vertex[p];
    if (k == FloatingParts::kNone) continue;
    parts.members[cursor[k]++] = p;
    spread[k] += mass[p] * dot(rest[p] - centre[k], rest[p] - centre[k]);
  }
  parts.arms.assign(n, {0, 0, 0, 0});
  parts.inverse.assign(36 * size_t{parts.count}, 0);
  for (uint32_t p = 0; p < n; ++p) {
    const uint32_t k = parts.of_vertex[p];
    if (k == FloatingParts::kNone) continue;
    parts.arms[p] = to_row(to_float(std::sqrt(weight[k] / spread[k]) * (rest[p] - centre[k])));
    const SixRows here{&parts.arms[p], nullptr, &parts.mass[p]};
    const SixRows motions{&parts.arms[p], nullptr, nullptr};
    for (uint32_t a = 0; a < 6; ++a) {
      double factors[6] = {}, sums[6] = {};
      factors[a] = 1;
      const Row4 motion = to_row(motions.combined(factors, 0));
      here.add_products(&motion, 0, sums);
      for (uint32_t b = 0; b < 6; ++b) parts.inverse[36 * size_t{k} + 6 * b + a] += sums[b];
    }
  }
  for (uint32_t k = 0; k < parts.count; ++k) invert_six(parts.inverse.data() + 36 * size_t{k});
  make_tree(ends, parts);
  return parts;
}

}  // namespace knead
