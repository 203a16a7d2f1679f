// Elastic energy of H and its gradient, tet by tet: a lane is a tet. Displacements u = x - x_rest go in, so that float32 keeps its digits however far
// the body is from the origin and however little it is deformed; nothing below subtracts numbers that are nearly equal.
//
// With G = sum_c (u_c - u_0) (x) grad N_c and F = I + G:
//   stable neo-Hookean   mu/2 (|F|^2 - 3) - mu (J - 1) + lambda/2 (J - 1)^2   Smith, de Goes, Kim 2018, without the logarithm; lambda here is
//                                                                              Lame's plus mu
//   corotated            mu |F - R|^2 + lambda/2 (J - 1)^2                     R is the rotation next to F
//   edges                mu/2 sum_e (|e| - L)^2 / L^2 + lambda/2 (J - 1)^2     springs (method.md 4)
// each times the tet's rest volume.
#pragma once
#include <cstddef>
#include <cstdint>

#include "kernels/row4.h"

namespace knead {

enum class ElasticTerm { kEdges, kCorotated, kStableNeoHookean };

template <class F>
struct Mat3 {
  Vec3<F> x, y, z;  // rows
};

// cof(A): its transpose times A is det(A) I.
template <class F>
KNEAD_HD Mat3<F> cofactors(const Mat3<F>& a) {
  return {cross(a.y, a.z), cross(a.z, a.x), cross(a.x, a.y)};
}

template <class F>
struct TetCorners {
  Vec3<F> a, b, c;  // of corners 1, 2 and 3, relative to corner 0's
};

struct ElasticTets {
  const Row4* u;            // displacements, cells
  const uint32_t* corners;  // [4][stride]
  const float* shape;       // [9][stride]: rows grad N_1, grad N_2, grad N_3, or for edges the rest vectors from corner 0 to the others
  const float* mu;          // [stride] mu V0; zero in padding
  const float* lambda;      // [stride] lambda V0
  Row4* forces;             // [4][stride] gradient by corner
  size_t stride;
  ElasticTerm term;
  const float* guard = nullptr;  // [stride] kappa V0 of the guard; null: none

  // On top of the first two, where H has little of M's material: kappa/2 min(0, J - kGuarded)^2. What is next to nothing resists before it is squeezed flat,
  // as a "third medium" does in contact mechanics.
  static constexpr float kGuarded = 0.3f;

  template <class F>
  struct Result {
    F energy;
    F volume;  // J = V / V0
  };

  // By J - 1.
  template <class F>
  static KNEAD_HD F flatness(const F& grown) {
    const F flat = grown + (1 - kGuarded), zero{};
    return flat < zero ? flat : zero;
  }

  template <class F>
  static KNEAD_HD Result<F> neo_hookean(const Mat3<F>& g, const F& mu, const F& lambda, const F& kappa, Mat3<F>& p) {
    const Mat3<F> m = cofactors(g);
    const F trace = g.x.x + g.y.y + g.z.z;
    const F higher = m.x.x + m.y.y + m.z.z + dot(g.x, m.x);  // J - 1 - trace
    const F grown = trace + higher;
    // cof(F) - I = trace I - G^T + cof(G)
    const Mat3<F> c{{trace - g.x.x + m.x.x, m.x.y - g.y.x, m.x.z - g.z.x},
                    {m.y.x - g.x.y, trace - g.y.y + m.y.y, m.y.z - g.z.y},
                    {m.z.x - g.x.z, m.z.y - g.y.z, trace - g.z.z + m.z.z}};
    const F bulk = lambda * grown, over = flatness(grown), guard = kappa * over, pressure = bulk + guard, both = pressure - mu;
    p.x = g.x * mu + c.x * both;
    p.y = g.y * mu + c.y * both;
    p.z = g.z * mu + c.z * both;
    p.x.x = p.x.x + pressure;
    p.y.y = p.y.y + pressure;
    p.z.z = p.z.z + pressure;
    const F squares = dot(g.x, g.x) + dot(g.y, g.y) + dot(g.z, g.z);
    return {mu * (0.5f * squares - higher) + 0.5f * bulk * grown + 0.5f * guard * over, 1.0f + grown};
  }

  // Newton's iteration for the polar factor (Higham 1986): R <- (R + R^-T) / 2.
  template <class F>
  static KNEAD_HD Mat3<F> rotation(Mat3<F> r) {
    using L = Lane<F>;
    const F tiny = L::all(1e-12f), zero{};
    for (int step = 0; step < 6; ++step) {
      const Mat3<F> m = cofactors(r);
      const F det = dot(r.x, m.x);
      const F size = det < zero ? -det : det;
      const F half = 0.5f / (size > tiny ? det : tiny);
      r.x = r.x * L::all(0.5f) + m.x * half;
      r.y = r.y * L::all(0.5f) + m.y * half;
      r.z = r.z * L::all(0.5f) + m.z * half;
    }
    return r;
  }

  template <class F>
  static KNEAD_HD Result<F> corotated(const Mat3<F>& g, const F& mu, const F& lambda, const F& kappa, Mat3<F>& p) {
    Mat3<F> f = g;
    f.x.x = f.x.x + 1.0f;
    f.y.y = f.y.y + 1.0f;
    f.z.z = f.z.z + 1.0f;
    const Mat3<F> r = rotation(f), cg = cofactors(g), cf = cofactors(f);
    const F grown = g.x.x + g.y.y + g.z.z + cg.x.x + cg.y.y + cg.z.z + dot(g.x, cg.x);
    const Vec3<F> ex = f.x - r.x, ey = f.y - r.y, ez = f.z - r.z;
    const F bulk = lambda * grown, over = flatness(grown), guard = kappa * over, pressure = bulk + guard, twice = mu + mu;
    p.x = ex * twice + cf.x * pressure;
    p.y = ey * twice + cf.y * pressure;
    p.z = ez * twice + cf.z * pressure;
    return {mu * (dot(ex, ex) + dot(ey, ey) + dot(ez, ez)) + 0.5f * bulk * grown + 0.5f * guard * over, 1.0f + grown};
  }

  // One spring from its rest vector and its stretch: adds the gradient at its far end, returns the energy.
  template <class F>
  static KNEAD_HD F spring(const Vec3<F>& rest, const Vec3<F>& stretch, const F& mu, Vec3<F>& pull) {
    using L = Lane<F>;
    const F tiny = L::all(1e-20f);
    const Vec3<F> now = rest + stretch;
    const F squared = dot(now, now), rest_squared = dot(rest, rest);
    const F size = L::root(squared > tiny ? squared : tiny), rest_size = L::root(rest_squared > tiny ? rest_squared : tiny);
    const F longer = (2.0f * dot(rest, stretch) + dot(stretch, stretch)) / (size + rest_size);
    const F weight = mu / (rest_squared > tiny ? rest_squared : tiny);
    pull = now * (weight * longer / size);
    return 0.5f * weight * longer * longer;
  }

  template <class F>
  static KNEAD_HD Result<F> edges(const TetCorners<F>& e, const TetCorners<F>& s, const F& mu, const F& lambda, TetCorners<F>& g) {
    using L = Lane<F>;
    Vec3<F> ab, bc, ca;
    F energy = spring(e.a, s.a, mu, g.a) + spring(e.b, s.b, mu, g.b) + spring(e.c, s.c, mu, g.c);
    energy = energy + spring(e.b - e.a, s.b - s.a, mu, ab) + spring(e.c - e.b, s.c - s.b, mu, bc) + spring(e.a - e.c, s.a - s.c, mu, ca);
    g.a += ca - ab;
    g.b += ab - bc;
    g.c += bc - ca;
    const Vec3<F> a = e.a + s.a, b = e.b + s.b, c = e.c + s.c;
    const Vec3<F> bc_area = cross(b, c), ca_area = cross(c, a), ab_area = cross(a, b);
    const F tiny = L::all(1e-20f);
    const F rest = dot(e.a, cross(e.b, e.c));
    const F over = 1.0f / (rest > tiny ? rest : tiny);
    const F grown = (dot(s.a, bc_area) + dot(e.a, cross(s.b, c)) + dot(e.a, cross(e.b, s.c))) * over;
    const F pressure = lambda * grown * over;
    g.a += bc_area * pressure;
    g.b += ca_area * pressure;
    g.c += ab_area * pressure;
    return {energy + 0.5f * lambda * grown * grown, 1.0f + grown};
  }

  template <class F>
  KNEAD_HD Result<F> lane(uint32_t t) const {
    using L = Lane<F>;
    using R = RowLanes<F>;
    const Vec3<F> u0 = R::load(u, corners + t);
    const TetCorners<F> s{R::load(u, corners + stride + t) - u0, R::load(u, corners + 2 * stride + t) - u0,
                          R::load(u, corners + 3 * stride + t) - u0};
    const float* d = shape + t;
    const TetCorners<F> n{{L::load(d), L::load(d + stride), L::load(d + 2 * stride)},
                          {L::load(d + 3 * stride), L::load(d + 4 * stride), L::load(d + 5 * stride)},
                          {L::load(d + 6 * stride), L::load(d + 7 * stride), L::load(d + 8 * stride)}};
    const F m = L::load(mu + t), l = L::load(lambda + t);
    TetCorners<F> f;
    Result<F> result;
    if (term == ElasticTerm::kEdges) {
      result = edges(n, s, m, l, f);
    } else {
      Mat3<F> g, p;
      g.x = n.a * s.a.x + n.b * s.b.x + n.c * s.c.x;
      g.y = n.a * s.a.y + n.b * s.b.y + n.c * s.c.y;
      g.z = n.a * s.a.z + n.b * s.b.z + n.c * s.c.z;
      const F kappa = guard ? L::load(guard + t) : F{};
      result = term == ElasticTerm::kCorotated ? corotated(g, m, l, kappa, p) : neo_hookean(g, m, l, kappa, p);
      f.a = {dot(p.x, n.a), dot(p.y, n.a), dot(p.z, n.a)};
      f.b = {dot(p.x, n.b), dot(p.y, n.b), dot(p.z, n.b)};
      f.c = {dot(p.x, n.c), dot(p.y, n.c), dot(p.z, n.c)};
    }
    R::store(forces + t, -(f.a + f.b + f.c));
    R::store(forces + stride + t, f.a);
    R::store(forces + 2 * stride + t, f.b);
    R::store(forces + 3 * stride + t, f.c);
    return result;
  }
  KNEAD_HD Result<float> operator()(uint32_t t) const { return lane<float>(t); }
};

struct ElasticSum {
  double energy = 0;
  float least_volume = 3.4e38f;  // smallest J
};

// All tets, on a device.
struct ElasticEnergy {
  static constexpr const char* kKernel = "elastic_energy";
  ElasticTets tets;
  ElasticSum* result;

  KNEAD_HD ElasticSum operator()(uint32_t t) const {
    const ElasticTets::Result<float> one = tets(t);
    return {one.energy, one.volume};
  }
  static KNEAD_HD ElasticSum combine(const ElasticSum& a, const ElasticSum& b) {
    return {a.energy + b.energy, b.least_volume < a.least_volume ? b.least_volume : a.least_volume};
  }
  KNEAD_HD void finish(const ElasticSum& sum) const { *result = sum; }
};

}  // namespace knead
