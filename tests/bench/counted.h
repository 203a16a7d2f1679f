// A lane type that counts its arithmetic: a body run with it says exactly how many operations its lanes take. Additions, subtractions,
// multiplications, divisions, roots and reciprocals count one each; comparisons, selections and negations none.
#pragma once
#include <cmath>

#include "kernels/pack.h"

namespace knead::bench {

struct Counted {
  float v = 0;
  static inline double operations = 0;

  static Counted of(float v) { return ++operations, Counted{v}; }
  friend Counted operator+(Counted a, Counted b) { return of(a.v + b.v); }
  friend Counted operator-(Counted a, Counted b) { return of(a.v - b.v); }
  friend Counted operator*(Counted a, Counted b) { return of(a.v * b.v); }
  friend Counted operator/(Counted a, Counted b) { return of(a.v / b.v); }
  friend Counted operator+(Counted a, float b) { return of(a.v + b); }
  friend Counted operator-(Counted a, float b) { return of(a.v - b); }
  friend Counted operator*(Counted a, float b) { return of(a.v * b); }
  friend Counted operator*(float a, Counted b) { return of(a * b.v); }
  friend Counted operator/(float a, Counted b) { return of(a / b.v); }
  friend Counted operator-(Counted a) { return {-a.v}; }
  friend bool operator<(Counted a, Counted b) { return a.v < b.v; }
  friend bool operator<=(Counted a, Counted b) { return a.v <= b.v; }
  friend bool operator>(Counted a, Counted b) { return a.v > b.v; }
  friend bool operator>=(Counted a, Counted b) { return a.v >= b.v; }
  friend bool operator>(Counted a, float b) { return a.v > b; }
  friend bool operator==(Counted a, Counted b) { return a.v == b.v; }
};

}  // namespace knead::bench

namespace knead {

template <>
struct Lane<bench::Counted> {
  using F = bench::Counted;
  static constexpr uint32_t kWidth = 1;
  static F all(float v) { return {v}; }
  static F load(const float* v) { return {*v}; }
  static F gather(const float* v, const uint32_t* i) { return {v[*i]}; }
  static Vec3<F> rows(const Vec3f* v, const uint32_t* i) { return {{v[*i].x}, {v[*i].y}, {v[*i].z}}; }
  static void put_rows(Vec3f* v, const uint32_t* i, uint32_t, const Vec3<F>& x) { v[*i] = {x.x.v, x.y.v, x.z.v}; }
  static F root(F v) { return F::of(Lane<float>::root(v.v)); }
  static F reciprocal(F v) { return F::of(1 / v.v); }
  static F over_root(F a, F v) { return ++F::operations, F::of(Lane<float>::over_root(a.v, v.v)); }
  static F abs(F v) { return {std::abs(v.v)}; }
  static F turned(F v, F by) { return {Lane<float>::turned(v.v, by.v)}; }
  static bool same_sign(F a, F b) { return Lane<float>::same_sign(a.v, b.v); }
};

}  // namespace knead
