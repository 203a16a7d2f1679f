// One lane of restore_volume; see restore_volume.h for the method.
#pragma once
#include "kernels/lane_table.h"
#include "kernels/pack.h"

namespace knead {

// The least-squares step delta of (sum w b b^T + lambda (tr/3) I) delta = sum w b r from its sums. Everything is divided by the trace first, so that
// neither cells of any size nor flat neighbourhoods leave float's range, and the pivots of the LDL^T stay above the regularisation.
template <class F>
struct VolumeSystem {
  F xx{}, xy{}, xz{}, yy{}, yz{}, zz{};  // sum w b b^T
  Vec3<F> right{};                       // sum w b r

  // `pull`: w r
  KNEAD_HD void add(const Vec3<F>& b, const F& weight, const F& pull) {
    const Vec3<F> w = b * weight;
    xx = xx + w.x * b.x;
    xy = xy + w.x * b.y;
    xz = xz + w.x * b.z;
    yy = yy + w.y * b.y;
    yz = yz + w.y * b.z;
    zz = zz + w.z * b.z;
    right += b * pull;
  }
  KNEAD_HD Vec3<F> step(float regularisation) const {
    const F tiny = Lane<F>::all(1e-30f), least = Lane<F>::all(1e-6f);
    const F trace = xx + yy + zz;
    const F scale = 1.0f / (trace > tiny ? trace : tiny);
    const F over0 = Lane<F>::reciprocal(xx * scale + regularisation * (1.0f / 3) + least);
    const F a01 = xy * scale, a02 = xz * scale;
    const F l10 = a01 * over0, l20 = a02 * over0;
    F d1 = yy * scale + regularisation * (1.0f / 3) - l10 * a01;
    d1 = d1 > least ? d1 : least;
    const F a12 = yz * scale - l20 * a01;
    const F over1 = Lane<F>::reciprocal(d1);
    const F l21 = a12 * over1;
    F d2 = zz * scale + regularisation * (1.0f / 3) - l20 * a02 - l21 * a12;
    d2 = d2 > least ? d2 : least;
    const F y0 = right.x * scale;
    const F y1 = right.y * scale - l10 * y0;
    const F y2 = right.z * scale - l20 * y0 - l21 * y1;
    const F z = y2 * Lane<F>::reciprocal(d2);
    const F y = y1 * over1 - l21 * z;
    return {y0 * over0 - l10 * y - l20 * z, y, z};
  }
};

// v, no longer than `longest`.
template <class F>
KNEAD_HD Vec3<F> clamped(const Vec3<F>& v, float longest) {
  const F squared = dot(v, v);
  const F limit = Lane<F>::all(longest * longest), one = Lane<F>::all(1.0f);
  const F shrink = Lane<F>::over_root(Lane<F>::all(longest), squared > limit ? squared : limit);
  return v * (squared > limit ? shrink : one);
}

template <class Table>
struct RestoreVolumeOn {
  static constexpr const char* kKernel = "restore_volume";
  const Vec3f* from;  // x, tet space
  Vec3f* to;
  Table strips;  // kernels/build_tets/strips.h
  float regularisation;
  float relaxation;
  float ignored;   // where all relative volume errors are up to this, they are the rounding of the rest shape
  float max_step;  // cells
  bool relative;   // tets count by their relative error, not by their error in cells^3

  template <class F>
  KNEAD_HD void lane(uint32_t t) const {
    using L = Lane<F>;
    const F zero{}, one = L::all(1.0f), accepted = L::all(ignored);
    const Vec3<F> a = L::rows(from, strips.order + t);
    VolumeSystem<F> system;
    Vec3<F> p = a, q = a, r = a;
    F before{}, worst{};
    for (uint32_t k = 0; strips.has(t, k); ++k) {
      const size_t entry = strips.entry(t, k);
      const F over_rest = L::load(strips.values + entry);  // 1 / (6 V0), signed; zero where there is no tet
      const auto keep = L::same_sign(over_rest, before);
      before = over_rest;
      p = {keep ? p.x : q.x, keep ? p.y : q.y, keep ? p.z : q.z};
      q = r;
      r = L::rows(from, strips.indices + entry);
      const Vec3<F> base = cross(p - r, q - r);
      const F weight = L::abs(over_rest);
      const auto counts = weight > zero;
      const F unit = counts ? one : zero;
      const F error = dot(r - a, base) * over_rest - unit;  // V / V0 - 1
      const F size = L::abs(error);
      worst = worst > size ? worst : size;
      if (relative)
        system.add(base, weight, L::turned(error, over_rest));
      else
        system.add(base, unit, error / (counts ? over_rest : one));
    }
    const Vec3<F> step = clamped(system.step(regularisation) * L::all(relaxation), max_step);
    const auto moves = worst > accepted;
    L::put_rows(to, strips.order + t, strips.lanes - t, {moves ? a.x + step.x : a.x, moves ? a.y + step.y : a.y, moves ? a.z + step.z : a.z});
  }
  KNEAD_HD void operator()(uint32_t t) const { lane<float>(t); }
};
using RestoreVolume = RestoreVolumeOn<LaneTable>;

}  // namespace knead
