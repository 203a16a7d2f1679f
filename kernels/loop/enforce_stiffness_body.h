// One lane of enforce_stiffness; see enforce_stiffness.h for the method.
#pragma once
#include "kernels/lane_table.h"
#include "kernels/loop/restore_volume_body.h"
#include "kernels/pack.h"

namespace knead {

template <class Table>
struct EnforceStiffnessOn {
  static constexpr const char* kKernel = "enforce_stiffness";
  const Vec3f* from;  // x, tet space
  Vec3f* to;
  Table edges;
  const float* weights;  // of s, per vertex of H; may be null
  float stiffness;       // s
  float ignored;         // where all relative length errors are up to this, they are the rounding of the rest shape
  float max_step;        // cells
  bool stretched_only;

  template <class F>
  KNEAD_HD void lane(uint32_t t) const {
    using L = Lane<F>;
    const F zero{}, one = L::all(1.0f), tiny = L::all(1e-30f), accepted = L::all(ignored);
    const Vec3<F> a = L::rows(from, edges.order + t);
    Vec3<F> sum{};
    F count{}, worst{};
    for (uint32_t k = 0; edges.has(t, k); ++k) {
      const size_t entry = edges.entry(t, k);
      const Vec3<F> q = L::rows(from, edges.indices + entry) - a;
      const F rest = L::load(edges.values + entry), is_edge = rest > zero ? one : zero;
      const F squared = q.x * q.x + tiny + q.y * q.y + q.z * q.z;
      // An edge of no length has no direction to grow in: q is zero, and so is its term.
      F error = is_edge - L::over_root(rest, squared);  // (now - rest) / now
      if (stretched_only) error = error > zero ? error : zero;
      const F size = L::abs(error);
      worst = worst > size ? worst : size;
      sum += q * error;
      count = count + is_edge;
    }
    F share = L::all(stiffness) / (count > one ? count : one);
    if (weights) share = share * L::gather(weights, edges.order + t);
    L::put_rows(to, edges.order + t, edges.lanes - t, a + clamped(sum * (worst > accepted ? share : zero), max_step));
  }
  KNEAD_HD void operator()(uint32_t t) const { lane<float>(t); }
};
using EnforceStiffness = EnforceStiffnessOn<LaneTable>;

}  // namespace knead
