// One lane of the lattice maps; see lattice_map.h.
#pragma once
#include "kernels/lane_table.h"
#include "kernels/pack.h"
#include "kernels/restore_volume_body.h"

namespace knead {

// x + step with the bits of x where the step is zero, negative zeros included.
template <class F>
KNEAD_HD Vec3<F> moved(const Vec3<F>& x, const Vec3<F>& step) {
  const F zero{};
  return {step.x == zero ? x.x : x.x + step.x, step.y == zero ? x.y : x.y + step.y, step.z == zero ? x.z : x.z + step.z};
}

// A lane is a vertex of H that M influences.
struct MapToTets {
  const Vec3f* displacement;  // of M, local units
  const Vec3f* from;          // x, tet space
  Vec3f* to;
  LaneTable gather;
  float to_cells;             // local units to cells, times the gain
  float max_step;             // cells

  template <class F>
  KNEAD_HD void lane(uint32_t t) const {
    using L = Lane<F>;
    Vec3<F> sum{};
    for (uint32_t k = 0; gather.has(t, k); ++k) {
      const size_t entry = gather.entry(t, k);
      sum += L::rows(displacement, gather.indices + entry) * L::load(gather.values + entry);
    }
    const Vec3<F> step = clamped(sum * L::all(to_cells), max_step);
    L::put_rows(to, gather.order + t, gather.lanes - t, moved(L::rows(from, gather.order + t), step));
  }
  KNEAD_HD void operator()(uint32_t t) const { lane<float>(t); }
};

// A lane is a vertex of M.
struct MapToSurface {
  const Vec3f* tets_now;   // x, tet space
  const Vec3f* tets_rest;  // x_rest
  const Vec3f* rest;       // y_rest, local space
  Vec3f* to;
  LaneTable map;
  float to_local;          // cells to local units

  template <class F>
  KNEAD_HD void lane(uint32_t t) const {
    using L = Lane<F>;
    Vec3<F> sum{};
    for (uint32_t k = 0; map.has(t, k); ++k) {
      const size_t entry = map.entry(t, k);
      const uint32_t* j = map.indices + entry;
      sum += (L::rows(tets_now, j) - L::rows(tets_rest, j)) * L::load(map.values + entry);
    }
    L::put_rows(to, map.order + t, map.lanes - t, moved(L::rows(rest, map.order + t), sum * L::all(to_local)));
  }
  KNEAD_HD void operator()(uint32_t t) const { lane<float>(t); }
};

}  // namespace knead
