// A collider as the kernels see it from M.
#pragma once
#include <cstdint>

#include "kernels/sdf_sample.h"
#include "kernels/vec.h"

namespace knead {

// The loop's y is in M's local space, the equilibrium's in tet space; `scale` and `centre` are in the space of y.
struct ColliderView {
  SdfView sdf;
  float matrix[9];  // index = matrix * y + offset
  Vec3f offset;
  float scale;   // units of y per unit of the grid's values
  Vec3f centre;  // of the collider: where to push from when the distance has no slope

  template <class F>
  KNEAD_HD Vec3<F> to_index(const Vec3<F>& y) const {
    return {matrix[0] * y.x + matrix[1] * y.y + matrix[2] * y.z + offset.x, matrix[3] * y.x + matrix[4] * y.y + matrix[5] * y.z + offset.y,
            matrix[6] * y.x + matrix[7] * y.y + matrix[8] * y.z + offset.z};
  }
  // A gradient in index space turned into the space of y.
  KNEAD_HD Vec3f from_index(const Vec3f& g) const {
    return {matrix[0] * g.x + matrix[3] * g.y + matrix[6] * g.z, matrix[1] * g.x + matrix[4] * g.y + matrix[7] * g.z,
            matrix[2] * g.x + matrix[5] * g.y + matrix[8] * g.z};
  }
};

}  // namespace knead
