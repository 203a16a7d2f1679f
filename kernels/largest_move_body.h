// The largest move of a vertex in a round of a loop.
#pragma once
#include "kernels/vec.h"

namespace knead {

struct LargestMove {
  static constexpr const char* kKernel = "unrest";
  const Vec3f *before, *after;
  double* to;  // the root of the largest, over the size
  double size;

  // A vertex that is no longer a number has moved infinitely far.
  KNEAD_HD double operator()(uint32_t i) const {
    const Vec3f d = after[i] - before[i];
    const float squared = dot(d, d);
    return squared <= 3.4e38f ? static_cast<double>(squared) : HUGE_VAL;
  }
  static KNEAD_HD double combine(double a, double b) { return a < b ? b : a; }
  KNEAD_HD void finish(double squared) const { *to = std::sqrt(squared) / size; }
};

}  // namespace knead
