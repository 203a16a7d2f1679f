// The volume that triangles enclose, signed: positive when they face outwards.
#pragma once
#include <cstddef>
#include <cstdint>
#include <span>
#include <type_traits>

#include "kernels/vec.h"

namespace knead {

// The part of one triangle: of the tet from `tip` to it. Over closed triangles the parts add up to what they enclose, wherever the tip is; one amid
// the body loses no precision.
inline double volume_part(const Vec3d& tip, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  return dot(a - tip, cross(b - tip, c - tip)) / 6;
}

// corners: three vertices of `points`.
template <class F>
double volume_part(std::span<const Vec3<F>> points, const uint32_t* corners, const Vec3d& tip) {
  const auto at = [&](int k) {
    const Vec3<F>& p = points[corners[k]];
    return Vec3d{p.x, p.y, p.z};
  };
  return volume_part(tip, at(0), at(1), at(2));
}

template <class F>
double signed_volume(std::span<const Vec3<F>> points, std::span<const uint32_t> triangles, const Vec3d& tip) {
  double volume = 0;
  for (size_t c = 0; c + 2 < triangles.size(); c += 3) volume += volume_part(points, &triangles[c], tip);
  return volume;
}

}  // namespace knead
