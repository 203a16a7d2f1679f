// Three-vectors for host, device and SIMD lanes: F is float, double or a Pack.
#pragma once
#include <cmath>
#include <cstdint>

#include "graph/device_code.h"

namespace knead {

template <class F>
struct Vec3 {
  F x, y, z;
  KNEAD_HD F& operator[](int k) { return k == 0 ? x : k == 1 ? y : z; }
  KNEAD_HD const F& operator[](int k) const { return k == 0 ? x : k == 1 ? y : z; }
  KNEAD_HD Vec3& operator+=(const Vec3& b) {
    x = x + b.x;
    y = y + b.y;
    z = z + b.z;
    return *this;
  }
  KNEAD_HD Vec3& operator-=(const Vec3& b) {
    x = x - b.x;
    y = y - b.y;
    z = z - b.z;
    return *this;
  }
  friend KNEAD_HD Vec3 operator+(const Vec3& a, const Vec3& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
  friend KNEAD_HD Vec3 operator-(const Vec3& a, const Vec3& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
  friend KNEAD_HD Vec3 operator-(const Vec3& a) { return {-a.x, -a.y, -a.z}; }
  friend KNEAD_HD Vec3 operator*(const Vec3& a, const F& s) { return {a.x * s, a.y * s, a.z * s}; }
  friend KNEAD_HD Vec3 operator*(const F& s, const Vec3& a) { return {a.x * s, a.y * s, a.z * s}; }
};

template <class F>
KNEAD_HD F dot(const Vec3<F>& a, const Vec3<F>& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class F>
KNEAD_HD Vec3<F> cross(const Vec3<F>& a, const Vec3<F>& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
template <class F>
KNEAD_HD F length(const Vec3<F>& a) {
  return std::sqrt(dot(a, a));
}

using Vec3f = Vec3<float>;
using Vec3d = Vec3<double>;

KNEAD_HD Vec3d to_double(const Vec3f& a) {
  return {a.x, a.y, a.z};
}
KNEAD_HD Vec3f to_float(const Vec3d& a) {
  return {static_cast<float>(a.x), static_cast<float>(a.y), static_cast<float>(a.z)};
}

}  // namespace knead
