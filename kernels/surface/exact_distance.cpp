#include "kernels/surface/exact_distance.h"

#include <cmath>

namespace knead {

SignedDistance HalfSpaceDistance::signed_distance(const Vec3d& p, double radius) const {
  if (std::abs(p.z) > radius) return {};
  return {p.z, {p.x, p.y, 0}, {0, 0, 1}, 0};
}

SignedDistance HalfSpaceDistance::signed_distance_near(const Vec3d& p, uint32_t&) const {
  return signed_distance(p);
}

}  // namespace knead
