// SIMD lanes for kernel bodies. A body is a template over its lane type F: float, or pack<W>, W floats side by side (GCC and Clang vector extension:
// + - * /, comparisons and `mask ? a : b` are the language's own). Lane<F> has what the language lacks. A body that is written with both serves the
// serial executor, the CPU's vectors and the GPU.
#pragma once
#include <cstdint>
#if defined(__SSE2__) && !defined(__CUDACC__)  // nvcc knows no vector types; a device lane is a float
#include <immintrin.h>
#endif

#include "kernels/vec.h"

namespace knead {

namespace detail {
template <int W>
struct PackType {
  typedef float type __attribute__((vector_size(4 * W), may_alias));
};
}  // namespace detail
template <int W>
using Pack = typename detail::PackType<W>::type;

template <class F>
struct Lane;

template <>
struct Lane<float> {
  static constexpr uint32_t kWidth = 1;
  static KNEAD_HD float all(float v) { return v; }
  static KNEAD_HD float load(const float* v) { return *v; }
  static KNEAD_HD float gather(const float* v, const uint32_t* i) { return v[*i]; }
  static KNEAD_HD Vec3f rows(const Vec3f* v, const uint32_t* i) { return v[*i]; }
  static KNEAD_HD void put_rows(Vec3f* v, const uint32_t* i, uint32_t, const Vec3f& x) { v[*i] = x; }
  static KNEAD_HD float root(float v) { return sqrtf(v); }
  static KNEAD_HD float reciprocal(float v) { return 1 / v; }
  static KNEAD_HD float over_root(float a, float v) { return a / sqrtf(v); }
  static KNEAD_HD float abs(float v) { return fabsf(v); }
  static KNEAD_HD float turned(float v, float by) { return copysignf(1.0f, by) * v; }  // with the other sign where `by` has a minus
  static KNEAD_HD double sum(float v) { return v; }
  static KNEAD_HD bool same_sign(float a, float b) { return copysignf(1.0f, a) == copysignf(1.0f, b); }  // of zeros too
};

#if defined(__SSE2__) && !defined(__CUDACC__)  // nvcc knows no vector types; a device lane is a float
namespace detail {
KNEAD_HD Pack<4> row(const Vec3f* v, uint32_t i) {
  return _mm_loadu_ps(&v[i].x);
}  // reads 4 bytes past the row: see Buffer::kPaddingBytes
KNEAD_HD Pack<4> four_rows(const Vec3f* v, const uint32_t* i, Pack<4>) {
  return row(v, *i);
}
KNEAD_HD Pack<4> low(Pack<4> a, Pack<4> b) {
  return _mm_unpacklo_ps(a, b);
}
KNEAD_HD Pack<4> high(Pack<4> a, Pack<4> b) {
  return _mm_unpackhi_ps(a, b);
}
KNEAD_HD Pack<4> even(Pack<4> a, Pack<4> b) {
  return _mm_shuffle_ps(a, b, 0x44);
}
KNEAD_HD Pack<4> odd(Pack<4> a, Pack<4> b) {
  return _mm_shuffle_ps(a, b, 0xee);
}
KNEAD_HD Pack<4> root(Pack<4> v) {
  return _mm_sqrt_ps(v);
}
KNEAD_HD Pack<4> rough_reciprocal(Pack<4> v) {
  return _mm_rcp_ps(v);
}
KNEAD_HD Pack<4> rough_inverse_root(Pack<4> v) {
  return _mm_rsqrt_ps(v);
}
#if defined(__AVX2__)
KNEAD_HD Pack<8> four_rows(const Vec3f* v, const uint32_t* i, Pack<8>) {
  return _mm256_insertf128_ps(_mm256_castps128_ps256(row(v, i[0])), row(v, i[4]), 1);
}
KNEAD_HD Pack<8> low(Pack<8> a, Pack<8> b) {
  return _mm256_unpacklo_ps(a, b);
}
KNEAD_HD Pack<8> high(Pack<8> a, Pack<8> b) {
  return _mm256_unpackhi_ps(a, b);
}
KNEAD_HD Pack<8> even(Pack<8> a, Pack<8> b) {
  return _mm256_shuffle_ps(a, b, 0x44);
}
KNEAD_HD Pack<8> odd(Pack<8> a, Pack<8> b) {
  return _mm256_shuffle_ps(a, b, 0xee);
}
KNEAD_HD Pack<8> root(Pack<8> v) {
  return _mm256_sqrt_ps(v);
}
KNEAD_HD Pack<8> rough_reciprocal(Pack<8> v) {
  return _mm256_rcp_ps(v);
}
KNEAD_HD Pack<8> rough_inverse_root(Pack<8> v) {
  return _mm256_rsqrt_ps(v);
}
#endif
#if defined(__AVX512F__)
// The zeroing forms with a full mask compile to the plain instructions, without GCC 12's false warnings about the plain intrinsics' undefined
// operand.
KNEAD_HD Pack<16> four_rows(const Vec3f* v, const uint32_t* i, Pack<16>) {
  __m512 r = _mm512_zextps128_ps512(row(v, i[0]));
  r = _mm512_maskz_insertf32x4(0xffff, r, row(v, i[4]), 1);
  r = _mm512_maskz_insertf32x4(0xffff, r, row(v, i[8]), 2);
  return _mm512_maskz_insertf32x4(0xffff, r, row(v, i[12]), 3);
}
KNEAD_HD Pack<16> low(Pack<16> a, Pack<16> b) {
  return _mm512_maskz_unpacklo_ps(0xffff, a, b);
}
KNEAD_HD Pack<16> high(Pack<16> a, Pack<16> b) {
  return _mm512_maskz_unpackhi_ps(0xffff, a, b);
}
KNEAD_HD Pack<16> even(Pack<16> a, Pack<16> b) {
  return _mm512_maskz_shuffle_ps(0xffff, a, b, 0x44);
}
KNEAD_HD Pack<16> odd(Pack<16> a, Pack<16> b) {
  return _mm512_maskz_shuffle_ps(0xffff, a, b, 0xee);
}
KNEAD_HD Pack<16> root(Pack<16> v) {
  return _mm512_maskz_sqrt_ps(0xffff, v);
}
KNEAD_HD Pack<16> rough_reciprocal(Pack<16> v) {
  return _mm512_maskz_rcp14_ps(0xffff, v);
}
KNEAD_HD Pack<16> rough_inverse_root(Pack<16> v) {
  return _mm512_maskz_rsqrt14_ps(0xffff, v);
}
#endif

template <int W>
struct PackLane {
  using F = Pack<W>;
  typedef float Unaligned __attribute__((vector_size(4 * W), may_alias, aligned(4)));
  typedef int32_t Bits __attribute__((vector_size(4 * W), may_alias));
  static constexpr uint32_t kWidth = W;
  static KNEAD_HD F all(float v) { return F{} + v; }
  static KNEAD_HD F load(const float* v) { return *reinterpret_cast<const Unaligned*>(v); }
  static KNEAD_HD F gather(const float* v, const uint32_t* i) {
    F r{};
    for (int l = 0; l < W; ++l) r[l] = v[i[l]];
    return r;
  }
  // W rows of packed three-vectors: 16-byte loads and a 4x4 transpose inside every 128 bits, which beats the gather instructions on packed rows.
  static KNEAD_HD Vec3<F> rows(const Vec3f* v, const uint32_t* i) {
    const F r0 = four_rows(v, i, F{}), r1 = four_rows(v, i + 1, F{}), r2 = four_rows(v, i + 2, F{}), r3 = four_rows(v, i + 3, F{});
    const F xy01 = low(r0, r1), xy23 = low(r2, r3);
    return {even(xy01, xy23), odd(xy01, xy23), even(high(r0, r1), high(r2, r3))};
  }
  static KNEAD_HD void put_rows(Vec3f* v, const uint32_t* i, uint32_t count, const Vec3<F>& x) {
    for (uint32_t l = 0; l < W && l < count; ++l) v[i[l]] = {x.x[l], x.y[l], x.z[l]};
  }
  static KNEAD_HD F root(F v) { return detail::root(v); }
  // 1 / v to about 1e-6, for normal numbers: a table's estimate and a step of Newton's method, a fraction of a division's time.
  static KNEAD_HD F reciprocal(F v) {
    const F rough = detail::rough_reciprocal(v);
    return rough * (2.0f - v * rough);
  }
  // a / sqrt(v), likewise.
  static KNEAD_HD F over_root(F a, F v) {
    const F rough = detail::rough_inverse_root(v);
    return (a * rough) * (1.5f - (0.5f * v * rough) * rough);
  }
  static KNEAD_HD F abs(F v) { return (F)((Bits)v & INT32_MAX); }
  static KNEAD_HD F turned(F v, F by) { return (F)((Bits)v ^ ((Bits)by & INT32_MIN)); }
  static KNEAD_HD auto same_sign(F a, F b) { return ((Bits)a ^ (Bits)b) >= 0; }
  static KNEAD_HD double sum(F v) {
    double all = 0;
    for (int l = 0; l < W; ++l) all += v[l];
    return all;
  }
};
}  // namespace detail

template <>
struct Lane<Pack<4>> : detail::PackLane<4> {};
#if defined(__AVX2__)
template <>
struct Lane<Pack<8>> : detail::PackLane<8> {};
#endif
#if defined(__AVX512F__)
template <>
struct Lane<Pack<16>> : detail::PackLane<16> {};
#endif
#endif  // __SSE2__

}  // namespace knead
