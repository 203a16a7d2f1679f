// A row of four floats (x, y, z, 0) holds a three-vector of the equilibrium solver, so that one aligned load reads it. Row4 is a row in memory, RowValue a
// row in a register, and RowLanes reads and writes as many rows as a pack has lanes.
#pragma once
#include "kernels/pack.h"

namespace knead {

struct alignas(16) Row4 {
  float x, y, z, w;
};

KNEAD_HD Vec3f to_vec(const Row4& r) {
  return {r.x, r.y, r.z};
}
KNEAD_HD Row4 to_row(const Vec3f& v) {
  return {v.x, v.y, v.z, 0};
}

#if defined(__CUDACC__)
struct alignas(16) RowValue {
  float x, y, z, w;
};
KNEAD_HD RowValue operator+(const RowValue& a, const RowValue& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z, a.w + b.w};
}
KNEAD_HD RowValue operator-(const RowValue& a, const RowValue& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z, a.w - b.w};
}
KNEAD_HD RowValue operator*(const RowValue& a, const RowValue& b) {
  return {a.x * b.x, a.y * b.y, a.z * b.z, a.w * b.w};
}
KNEAD_HD RowValue operator*(const RowValue& a, float by) {
  return {a.x * by, a.y * by, a.z * by, a.w * by};
}
KNEAD_HD float sum_of(const RowValue& a) {
  return a.x + a.y + a.z;
}
#else
using RowValue = Pack<4>;
KNEAD_HD float sum_of(const RowValue& a) {  // of the three
  return a[0] + a[1] + a[2];
}
#endif
KNEAD_HD float squared(const RowValue& a) {
  return sum_of(a * a);
}

KNEAD_HD RowValue row_at(const Row4* v, size_t i) {
  return *reinterpret_cast<const RowValue*>(v + i);
}
KNEAD_HD void put_row(Row4* v, size_t i, const RowValue& q) {
  *reinterpret_cast<RowValue*>(v + i) = q;
}

template <class F>
struct RowLanes;

template <>
struct RowLanes<float> {
  static KNEAD_HD Vec3f load(const Row4* v, const uint32_t* i) { return to_vec(v[*i]); }
  static KNEAD_HD void store(Row4* to, const Vec3f& x) { *to = to_row(x); }  // consecutive rows
};

#if defined(__SSE2__) && !defined(__CUDACC__)
namespace detail {
KNEAD_HD Pack<4> row_at(const Row4* v, uint32_t i) {
  return _mm_load_ps(&v[i].x);
}
KNEAD_HD Pack<4> rows_at(const Row4* v, const uint32_t* i, Pack<4>) {
  return row_at(v, *i);
}
KNEAD_HD void put_rows(Row4* to, Pack<4> r) {
  _mm_store_ps(&to->x, r);
}
#if defined(__AVX2__)
KNEAD_HD Pack<8> rows_at(const Row4* v, const uint32_t* i, Pack<8>) {
  return _mm256_insertf128_ps(_mm256_castps128_ps256(row_at(v, i[0])), row_at(v, i[4]), 1);
}
KNEAD_HD void put_rows(Row4* to, Pack<8> r) {
  _mm_store_ps(&to[0].x, _mm256_castps256_ps128(r));
  _mm_store_ps(&to[4].x, _mm256_extractf128_ps(r, 1));
}
#endif
#if defined(__AVX512F__)
KNEAD_HD Pack<16> rows_at(const Row4* v, const uint32_t* i, Pack<16>) {
  __m512 r = _mm512_zextps128_ps512(row_at(v, i[0]));
  r = _mm512_maskz_insertf32x4(0xffff, r, row_at(v, i[4]), 1);
  r = _mm512_maskz_insertf32x4(0xffff, r, row_at(v, i[8]), 2);
  return _mm512_maskz_insertf32x4(0xffff, r, row_at(v, i[12]), 3);
}
KNEAD_HD void put_rows(Row4* to, Pack<16> r) {
  _mm_store_ps(&to[0].x, _mm512_maskz_extractf32x4_ps(0xf, r, 0));
  _mm_store_ps(&to[4].x, _mm512_maskz_extractf32x4_ps(0xf, r, 1));
  _mm_store_ps(&to[8].x, _mm512_maskz_extractf32x4_ps(0xf, r, 2));
  _mm_store_ps(&to[12].x, _mm512_maskz_extractf32x4_ps(0xf, r, 3));
}
#endif

template <int W>
struct PackRowLanes {
  using F = Pack<W>;
  static KNEAD_HD Vec3<F> load(const Row4* v, const uint32_t* i) {
    const F r0 = rows_at(v, i, F{}), r1 = rows_at(v, i + 1, F{}), r2 = rows_at(v, i + 2, F{}), r3 = rows_at(v, i + 3, F{});
    const F xy01 = low(r0, r1), xy23 = low(r2, r3);
    return {even(xy01, xy23), odd(xy01, xy23), even(high(r0, r1), high(r2, r3))};
  }
  static KNEAD_HD void store(Row4* to, const Vec3<F>& x) {
    const F zero{};
    const F xy01 = low(x.x, x.y), xy23 = high(x.x, x.y), z01 = low(x.z, zero), z23 = high(x.z, zero);
    put_rows(to, even(xy01, z01));
    put_rows(to + 1, odd(xy01, z01));
    put_rows(to + 2, even(xy23, z23));
    put_rows(to + 3, odd(xy23, z23));
  }
};
}  // namespace detail

template <>
struct RowLanes<Pack<4>> : detail::PackRowLanes<4> {};
#if defined(__AVX2__)
template <>
struct RowLanes<Pack<8>> : detail::PackRowLanes<8> {};
#endif
#if defined(__AVX512F__)
template <>
struct RowLanes<Pack<16>> : detail::PackRowLanes<16> {};
#endif
#endif

}  // namespace knead
