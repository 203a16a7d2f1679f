// One lane of the lattice maps; see lattice_map.h.
#pragma once
#include "kernels/lane_table.h"
#include "kernels/loop/restore_volume_body.h"
#include "kernels/pack.h"

namespace knead {

// x + step with the bits of x where the step is zero, negative zeros included.
template <class F>
KNEAD_HD Vec3<F> moved(const Vec3<F>& x, const Vec3<F>& step) {
  const F zero{};
  return {step.x == zero ? x.x : x.x + step.x, step.y == zero ? x.y : x.y + step.y, step.z == zero ? x.z : x.z + step.z};
}

// A turn and a scale of vectors. A zero comes out as a zero, and with no turn every component as its product with the scale.
struct Linear3 {
  float rows[9];

  template <class F>
  KNEAD_HD Vec3<F> operator()(const Vec3<F>& v) const {
    return {v.x * rows[0] + v.y * rows[1] + v.z * rows[2], v.x * rows[3] + v.y * rows[4] + v.z * rows[5],
            v.x * rows[6] + v.y * rows[7] + v.z * rows[8]};
  }
};

// A lane is a vertex of H that M influences.
struct MapToTets {
  static constexpr const char* kKernel = "map_to_tets";
  const Vec3f* displacement;  // of M, local space
  const Vec3f* from;          // x, tet space
  Vec3f* to;
  LaneTable gather;
  Linear3 to_cells;  // local space to tet space, times the gain
  float max_step;    // cells

  template <class F>
  KNEAD_HD void lane(uint32_t t) const {
    using L = Lane<F>;
    Vec3<F> sum{};
    for (uint32_t k = 0; gather.has(t, k); ++k) {
      const size_t entry = gather.entry(t, k);
      sum += L::rows(displacement, gather.indices + entry) * L::load(gather.values + entry);
    }
    const Vec3<F> step = clamped(to_cells(sum), max_step);
    L::put_rows(to, gather.order + t, gather.lanes - t, moved(L::rows(from, gather.order + t), step));
  }
  KNEAD_HD void operator()(uint32_t t) const { lane<float>(t); }
};

// A lane is a vertex of M.
struct MapToSurface {
  static constexpr const char* kKernel = "map_to_surface";
  const Vec3f* tets_now;   // x, tet space
  const Vec3f* tets_rest;  // x_rest
  const Vec3f* rest;       // y_rest, local space
  Vec3f* to;
  LaneTable map;
  Linear3 to_local;  // tet space to local space

  template <class F>
  KNEAD_HD void lane(uint32_t t) const {
    using L = Lane<F>;
    Vec3<F> sum{};
    for (uint32_t k = 0; map.has(t, k); ++k) {
      const size_t entry = map.entry(t, k);
      const uint32_t* j = map.indices + entry;
      sum += (L::rows(tets_now, j) - L::rows(tets_rest, j)) * L::load(map.values + entry);
    }
    L::put_rows(to, map.order + t, map.lanes - t, moved(L::rows(rest, map.order + t), to_local(sum)));
  }
  KNEAD_HD void operator()(uint32_t t) const { lane<float>(t); }
};

}  // namespace knead
