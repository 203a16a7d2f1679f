// Three-vectors in rows of four floats (x, y, z, 0), as the equilibrium solver keeps them: one aligned load a row, and a row is a vector of its own
// in sums.
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

// A row as one value, in sums.
#if defined(__CUDACC__)
struct alignas(16) Quad {
  float x, y, z, w;
};
KNEAD_HD Quad operator+(const Quad& a, const Quad& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z, a.w + b.w};
}
KNEAD_HD Quad operator-(const Quad& a, const Quad& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z, a.w - b.w};
}
KNEAD_HD Quad operator*(const Quad& a, const Quad& b) {
  return {a.x * b.x, a.y * b.y, a.z * b.z, a.w * b.w};
}
KNEAD_HD Quad operator*(const Quad& a, float by) {
  return {a.x * by, a.y * by, a.z * by, a.w * by};
}
KNEAD_HD float sum_of(const Quad& a) {
  return a.x + a.y + a.z;
}
#else
using Quad = Pack<4>;
KNEAD_HD float sum_of(const Quad& a) {  // of the three
  return a[0] + a[1] + a[2];
}
#endif
KNEAD_HD float squared(const Quad& a) {
  return sum_of(a * a);
}

KNEAD_HD Quad quad_at(const Row4* v, size_t i) {
  return *reinterpret_cast<const Quad*>(v + i);
}
KNEAD_HD void put_quad(Row4* v, size_t i, const Quad& q) {
  *reinterpret_cast<Quad*>(v + i) = q;
}

struct FillWords {
  static constexpr const char* kKernel = "fill_words";
  uint32_t* to;
  uint32_t word;
  KNEAD_HD void operator()(uint32_t i) const { to[i] = word; }
};

template <class F>
struct Rows4;

template <>
struct Rows4<float> {
  static KNEAD_HD Vec3f load(const Row4* v, const uint32_t* i) { return to_vec(v[*i]); }
  static KNEAD_HD void store(Row4* to, const Vec3f& x) { *to = to_row(x); }  // consecutive rows
};

#if defined(__SSE2__) && !defined(__CUDACC__)
namespace detail {
KNEAD_HD Pack<4> quad(const Row4* v, uint32_t i) {
  return _mm_load_ps(&v[i].x);
}
KNEAD_HD Pack<4> quads(const Row4* v, const uint32_t* i, Pack<4>) {
  return quad(v, *i);
}
KNEAD_HD void put_quads(Row4* to, Pack<4> r) {
  _mm_store_ps(&to->x, r);
}
#if defined(__AVX2__)
KNEAD_HD Pack<8> quads(const Row4* v, const uint32_t* i, Pack<8>) {
  return _mm256_insertf128_ps(_mm256_castps128_ps256(quad(v, i[0])), quad(v, i[4]), 1);
}
KNEAD_HD void put_quads(Row4* to, Pack<8> r) {
  _mm_store_ps(&to[0].x, _mm256_castps256_ps128(r));
  _mm_store_ps(&to[4].x, _mm256_extractf128_ps(r, 1));
}
#endif
#if defined(__AVX512F__)
KNEAD_HD Pack<16> quads(const Row4* v, const uint32_t* i, Pack<16>) {
  __m512 r = _mm512_zextps128_ps512(quad(v, i[0]));
  r = _mm512_maskz_insertf32x4(0xffff, r, quad(v, i[4]), 1);
  r = _mm512_maskz_insertf32x4(0xffff, r, quad(v, i[8]), 2);
  return _mm512_maskz_insertf32x4(0xffff, r, quad(v, i[12]), 3);
}
KNEAD_HD void put_quads(Row4* to, Pack<16> r) {
  _mm_store_ps(&to[0].x, _mm512_maskz_extractf32x4_ps(0xf, r, 0));
  _mm_store_ps(&to[4].x, _mm512_maskz_extractf32x4_ps(0xf, r, 1));
  _mm_store_ps(&to[8].x, _mm512_maskz_extractf32x4_ps(0xf, r, 2));
  _mm_store_ps(&to[12].x, _mm512_maskz_extractf32x4_ps(0xf, r, 3));
}
#endif

template <int W>
struct PackRows4 {
  using F = Pack<W>;
  static KNEAD_HD Vec3<F> load(const Row4* v, const uint32_t* i) {
    const F r0 = quads(v, i, F{}), r1 = quads(v, i + 1, F{}), r2 = quads(v, i + 2, F{}), r3 = quads(v, i + 3, F{});
    const F xy01 = low(r0, r1), xy23 = low(r2, r3);
    return {even(xy01, xy23), odd(xy01, xy23), even(high(r0, r1), high(r2, r3))};
  }
  static KNEAD_HD void store(Row4* to, const Vec3<F>& x) {
    const F zero{};
    const F xy01 = low(x.x, x.y), xy23 = high(x.x, x.y), z01 = low(x.z, zero), z23 = high(x.z, zero);
    put_quads(to, even(xy01, z01));
    put_quads(to + 1, odd(xy01, z01));
    put_quads(to + 2, even(xy23, z23));
    put_quads(to + 3, odd(xy23, z23));
  }
};
}  // namespace detail

template <>
struct Rows4<Pack<4>> : detail::PackRows4<4> {};
#if defined(__AVX2__)
template <>
struct Rows4<Pack<8>> : detail::PackRows4<8> {};
#endif
#if defined(__AVX512F__)
template <>
struct Rows4<Pack<16>> : detail::PackRows4<16> {};
#endif
#endif

}  // namespace knead
