#include "kernels/surface/principal_frame.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace knead {
namespace {

// Float32 coordinates are off by 3e-8 of the body at random, and moments over hundreds of vertices by 1e-9. That over the gap of two eigenvalues is
// the error of their axes in radians: at this gap no more than 1e-6, and 1e-7 for most. Heads from the front to the back and from the crown to the
// throat differ by 3e-3.
constexpr double kLeastGap = 1e-3;       // of the larger eigenvalue
constexpr double kThinnest = 1e-4;       // of the largest eigenvalue: below this thickness an axis' own moments are noise
constexpr double kLeastSkewness = 1e-3;  // third moment over the deviation cubed: a thousand times what rounding makes of a symmetric shape
constexpr double kAligned = 1e-6;        // radians

using Eigen::Matrix3d;
using Eigen::Vector3d;

struct Corners {
  Vector3d a, b, c;
  double twice_area = 0;
};

// f(corners about `origin` over `size`) for every good triangle.
template <class F>
void each_triangle(std::span<const Vec3f> points, std::span<const uint32_t> triangles, const Vector3d& origin, double size, F&& f) {
  for (size_t t = 0; t + 2 < triangles.size(); t += 3) {
    if (std::max({triangles[t], triangles[t + 1], triangles[t + 2]}) >= points.size()) continue;
    Corners at;
    Vector3d* const corners[3] = {&at.a, &at.b, &at.c};
    for (size_t k = 0; k < 3; ++k) {
      const Vec3f& p = points[triangles[t + k]];
      *corners[k] = (Vector3d(double{p.x}, double{p.y}, double{p.z}) - origin) / size;
    }
    at.twice_area = (at.b - at.a).cross(at.c - at.a).norm();
    if (std::isfinite(at.twice_area) && at.twice_area > 0) f(at);
  }
}

// Integral of the cube of a linear function over a triangle, from its corner values, over twice the area: 3! h3 / 5!, h3 the complete symmetric
// polynomial.
double cubed(double a, double b, double c) {
  const double sum = a + b + c, squares = a * a + b * b + c * c, cubes = a * a * a + b * b * b + c * c * c;
  return (sum * sum * sum + 3 * sum * squares + 2 * cubes) / 120;
}

bool apart(double larger, double smaller) {
  return larger - smaller > kLeastGap * larger;
}

// Turns the columns of `axes` to where the third moments are positive. False when that is not clear.
bool point_axes(Matrix3d& axes, Vector3d skewness) {
  std::array<int, 3> by_clarity{0, 1, 2};
  std::sort(by_clarity.begin(), by_clarity.end(), [&](int i, int j) { return std::abs(skewness(i)) > std::abs(skewness(j)); });
  const int second = by_clarity[1], third = by_clarity[2];
  if (!(std::abs(skewness(second)) > kLeastSkewness)) return false;
  for (int k = 0; k < 3; ++k)
    if (skewness(k) < 0) axes.col(k) = -axes.col(k);
  if (axes.determinant() > 0) return true;
  axes.col(third) = -axes.col(third);
  return apart(std::abs(skewness(second)), std::abs(skewness(third)));  // else rounding decides which of the two gives way
}

void snap_to_coordinate_axes(Matrix3d& axes) {
  const Matrix3d whole = axes.array().round();
  if ((axes - whole).cwiseAbs().maxCoeff() < kAligned) axes = whole;
}

}  // namespace

std::optional<std::array<double, 9>> principal_frame(std::span<const Vec3f> points, std::span<const uint32_t> triangles) {
  // A first pass for size and centre, so that the moments neither cancel nor overflow.
  Vector3d lower = Vector3d::Constant(INFINITY), upper = -lower;
  each_triangle(points, triangles, Vector3d::Zero(), 1, [&](const Corners& at) {
    lower = lower.cwiseMin(at.a).cwiseMin(at.b).cwiseMin(at.c);
    upper = upper.cwiseMax(at.a).cwiseMax(at.b).cwiseMax(at.c);
  });
  const double size = (upper - lower).norm();
  if (!(size > 0) || !std::isfinite(size)) return {};
  const Vector3d middle = 0.5 * (lower + upper);
  double area = 0;
  Vector3d first = Vector3d::Zero();
  each_triangle(points, triangles, middle, size, [&](const Corners& at) {
    area += at.twice_area / 2;
    first += at.twice_area / 6 * (at.a + at.b + at.c);
  });
  if (!(area > 0)) return {};
  const Vector3d centre = middle + size / area * first;

  Matrix3d second = Matrix3d::Zero();
  each_triangle(points, triangles, centre, size, [&](const Corners& at) {
    const Vector3d sum = at.a + at.b + at.c;
    second += at.twice_area / 24 * (at.a * at.a.transpose() + at.b * at.b.transpose() + at.c * at.c.transpose() + sum * sum.transpose());
  });
  const Eigen::SelfAdjointEigenSolver<Matrix3d> solver(second / area);
  const Vector3d spread = solver.eigenvalues().reverse();  // largest first
  if (!(spread(1) > kThinnest * spread(0)) || !apart(spread(0), spread(1)) || !apart(spread(1), spread(2))) return {};
  Matrix3d axes = solver.eigenvectors().rowwise().reverse();

  Vector3d third = Vector3d::Zero();
  each_triangle(points, triangles, centre, size, [&](const Corners& at) {
    for (int k = 0; k < 3; ++k) third(k) += at.twice_area * cubed(axes.col(k).dot(at.a), axes.col(k).dot(at.b), axes.col(k).dot(at.c));
  });
  Vector3d skewness = Vector3d::Zero();
  for (int k = 0; k < 3; ++k)
    if (spread(k) > kThinnest * spread(0)) skewness(k) = third(k) / (area * std::pow(spread(k), 1.5));
  if (!point_axes(axes, skewness)) return {};
  snap_to_coordinate_axes(axes);
  std::array<double, 9> rotation;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) rotation[static_cast<size_t>(3 * r + c)] = axes(r, c);
  return rotation;
}

}  // namespace knead
