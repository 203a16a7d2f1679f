// One vertex of hold, and the sums of its rigid fit; see hold.h.
#pragma once
#include "kernels/vec.h"

namespace knead {

// x_rest = R^T (x - centre) + rest_centre for a body that has only moved rigidly by R.
struct RigidFit {
  double rotation[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};  // R, row-major
  Vec3d centre{0, 0, 0}, rest_centre{0, 0, 0};
  bool moved = false;

  KNEAD_HD Vec3d undone(const Vec3d& x) const {
    const Vec3d p = x - centre;
    return {rotation[0] * p.x + rotation[3] * p.y + rotation[6] * p.z + rest_centre.x,
            rotation[1] * p.x + rotation[4] * p.y + rotation[7] * p.z + rest_centre.y,
            rotation[2] * p.x + rotation[5] * p.y + rotation[8] * p.z + rest_centre.z};
  }
};

struct Hold {
  const Vec3f* from;      // x, tet space
  const Vec3f* rest;      // x_rest
  Vec3f* to;
  const float* weights;   // of the strength, per vertex of H; may be null
  const float* pins;      // 0 free to 1 pinned, per vertex of H; may be null
  float strength;
  RigidFit rigid;

  KNEAD_HD void operator()(uint32_t j) const {
    Vec3f x = from[j];
    if (rigid.moved) x = to_float(rigid.undone(to_double(x)));
    const float pull = weights ? strength * weights[j] : strength;
    if (pull > 0) x += pull * (rest[j] - x);
    const float pin = pins ? pins[j] : 0;
    if (pin > 0) x += pin * (rest[j] - x);
    to[j] = pin >= 1 ? rest[j] : x;
  }
};

// A lane is a vertex of H that M influences: the largest or the mean weight of those vertices of M.
struct PaintToTets {
  const float* paint;  // per vertex of M
  float* to;
  const uint32_t *order, *valence, *row_offsets, *indices;
  const float* values;
  bool largest;

  KNEAD_HD void operator()(uint32_t t) const {
    float sum = 0, most = 0;
    for (uint32_t k = 0; k < valence[t]; ++k) {
      const float w = paint[indices[row_offsets[k] + t]];
      sum += values[row_offsets[k] + t] * w;
      most = w > most ? w : most;
    }
    to[order[t]] = largest ? most : sum;
  }
};

}  // namespace knead
