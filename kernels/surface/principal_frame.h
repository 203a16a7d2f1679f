// Axes that a shape carries with it, so that what is built along them turns with the shape.
#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <span>

#include "kernels/vec.h"

namespace knead {

// The principal axes of the triangles' area, the longest first, as the columns of a rotation (row-major, right-handed): x = rotation * x_in_frame.
// Axes point where the area's third moment along them is positive; that fixes the two with the clearest skewness, and right-handedness the third.
// Sums are over exact integrals in double, so that neither the tessellation nor the order of triangles nor loose vertices matter beyond rounding.
//
// Empty when rounding would decide: two axes of about the same length (kLeastGap), fewer than two with a skewness (kLeastSkewness), no area. Balls,
// boxes, plates, capsules and tori are such shapes. A frame that is a signed permutation of the coordinate axes but for rounding (kAligned) comes out
// as just that. Triangles with corners that are missing or not finite are left out.
std::optional<std::array<double, 9>> principal_frame(std::span<const Vec3f> points, std::span<const uint32_t> triangles);

}  // namespace knead
