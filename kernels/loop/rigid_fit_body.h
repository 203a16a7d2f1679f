// The rigid motion that takes H at rest nearest to H now, and what undoes it; see hold.h. The rotation is the one of Horn's quaternion: the
// eigenvector to the largest eigenvalue of a symmetric 4x4 matrix made of the covariance, found by Jacobi's method. It is never a reflection.
#pragma once
#include "graph/executor.h"
#include "kernels/loop/hold_body.h"

namespace knead {

// x_rest = R^T (x - centre) + rest_centre for a body that has only moved rigidly by R.
struct RigidFit {
  double rotation[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};  // R, row-major
  Vec3d centre{0, 0, 0}, rest_centre{0, 0, 0};
  bool moved = false;
};

struct RigidSum {
  double of[RigidSums::kSums] = {};
};

// A symmetric 4x4 matrix that is turned until it is diagonal. Indices are constants, so that a device keeps it in registers.
struct Jacobi4 {
  double a[4][4];  // the upper triangle counts
  double v[4][4];  // columns: the eigenvectors

  template <int p, int q>
  KNEAD_HD void turn() {
    const double apq = a[p][q], tiny = 1e-18 * (fabs(a[p][p]) + fabs(a[q][q]));
    if (fabs(apq) <= tiny) return;
    const double theta = (a[q][q] - a[p][p]) / (2 * apq);
    const double t = (theta < 0 ? -1.0 : 1.0) / (fabs(theta) + sqrt(theta * theta + 1));
    const double c = 1 / sqrt(t * t + 1), s = t * c;
    a[p][p] -= t * apq;
    a[q][q] += t * apq;
    a[p][q] = 0;
    for (int k = 0; k < 4; ++k) {
      if (k != p && k != q) {
        double &kp = k < p ? a[k][p] : a[p][k], &kq = k < q ? a[k][q] : a[q][k];
        const double x = kp, y = kq;
        kp = c * x - s * y;
        kq = s * x + c * y;
      }
      const double x = v[k][p], y = v[k][q];
      v[k][p] = c * x - s * y;
      v[k][q] = s * x + c * y;
    }
  }
  KNEAD_HD void solve() {
    for (int sweep = 0; sweep < 12; ++sweep) {
      double off = 0, on = 0;
      for (int p = 0; p < 4; ++p) {
        on += fabs(a[p][p]);
        for (int q = p + 1; q < 4; ++q) off += fabs(a[p][q]);
      }
      if (!(off > 1e-17 * on)) return;
      turn<0, 1>(), turn<0, 2>(), turn<0, 3>(), turn<1, 2>(), turn<1, 3>(), turn<2, 3>();
    }
  }
};

KNEAD_HD RigidFit rigid_fit_of(const RigidSum& sums) {
  const double* s = sums.of;
  RigidFit fit;
  const double weight = s[0], travelled = s[1];
  if (!(weight > 0) || travelled == 0) return fit;
  fit.moved = true;
  fit.rest_centre = (1 / weight) * Vec3d{s[5], s[6], s[7]};
  fit.centre = fit.rest_centre + (1 / weight) * Vec3d{s[2], s[3], s[4]};
  constexpr int kUpper[3][3] = {{17, 18, 19}, {18, 20, 21}, {19, 21, 22}};
  double m[3][3];  // sum w (x - centre) (r - rest_centre)^T
  for (int a = 0; a < 3; ++a)
    for (int b = 0; b < 3; ++b) m[a][b] = (s[8 + 3 * a + b] + s[kUpper[a][b]]) / weight - fit.centre[a] * fit.rest_centre[b];
  Jacobi4 horn{{{m[0][0] + m[1][1] + m[2][2], m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]},
                {0, m[0][0] - m[1][1] - m[2][2], m[0][1] + m[1][0], m[2][0] + m[0][2]},
                {0, 0, m[1][1] - m[0][0] - m[2][2], m[1][2] + m[2][1]},
                {0, 0, 0, m[2][2] - m[0][0] - m[1][1]}},
               {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}}};
  horn.solve();
  int best = 0;
  double top = horn.a[0][0], w = horn.v[0][0], x = horn.v[1][0], y = horn.v[2][0], z = horn.v[3][0];
  for (int k = 1; k < 4; ++k)
    if (horn.a[k][k] > top) best = k, top = horn.a[k][k], w = horn.v[0][k], x = horn.v[1][k], y = horn.v[2][k], z = horn.v[3][k];
  // Sums of two eigenvalues are twice the covariance's singular values.
  double largest = 0, least = 1e300, middle = 0;
  for (int k = 0; k < 4; ++k) {
    if (k == best) continue;
    const double spread = fabs(top + horn.a[k][k]);
    largest = spread > largest ? spread : largest;
    least = spread < least ? spread : least;
    middle += spread;
  }
  middle -= largest + least;
  if (!(middle > 1e-6 * largest)) return fit;  // points on a line or collapsed to it: no rotation to speak of
  const double size = 1 / sqrt(w * w + x * x + y * y + z * z);
  w *= size, x *= size, y *= size, z *= size;
  const double rotation[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y), 2 * (x * y + w * z),    1 - 2 * (x * x + z * z),
                              2 * (y * z - w * x),     2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)};
  for (int k = 0; k < 9; ++k) fit.rotation[k] = rotation[k];
  return fit;
}

KNEAD_HD RigidMotion undoing(const RigidFit& fit) {
  RigidMotion back;
  back.moved = fit.moved;
  back.centre = to_float(fit.centre);
  back.shift = to_float(fit.rest_centre - fit.centre);
  for (int a = 0; a < 3; ++a)
    for (int b = 0; b < 3; ++b) back.turn[3 * a + b] = static_cast<float>(fit.rotation[3 * b + a] - (a == b ? 1 : 0));
  return back;
}

struct FitRigid {
  static constexpr const char* kKernel = "rigid_fit";
  RigidSums sums;
  RigidFit* fit;        // may be null
  RigidMotion* motion;  // what undoes it
  const float* pinned;  // the largest pin, which holds the frame where it is above zero; may be null

  KNEAD_HD RigidSum operator()(uint32_t t) const {
    float terms[RigidSums::kSums] = {};
    sums.lane(t, terms);
    RigidSum sum;
    for (int k = 0; k < RigidSums::kSums; ++k) sum.of[k] = terms[k];
    return sum;
  }
  static KNEAD_HD RigidSum combine(const RigidSum& a, const RigidSum& b) {
    RigidSum sum;
    for (int k = 0; k < RigidSums::kSums; ++k) sum.of[k] = a.of[k] + b.of[k];
    return sum;
  }
  KNEAD_HD void finish(const RigidSum& sum) const {
    const RigidFit found = rigid_fit_of(sum);
    if (fit) *fit = found;
    *motion = pinned && *pinned > 0 ? RigidMotion{} : undoing(found);
  }
  RigidSum sum_on_host(Executor& executor, size_t lanes) const;  // by SIMD lanes
};

// The largest and the mean weight that is painted.
struct PaintSum {
  double sum = 0;
  float most = 0;
};
struct SumPaint {
  static constexpr const char* kKernel = "sum_paint";
  const float* paint;
  uint32_t count;
  float* most;  // may be null
  float* mean;  // may be null

  KNEAD_HD PaintSum operator()(uint32_t i) const { return {paint[i], paint[i]}; }
  static KNEAD_HD PaintSum combine(const PaintSum& a, const PaintSum& b) { return {a.sum + b.sum, a.most < b.most ? b.most : a.most}; }
  KNEAD_HD void finish(const PaintSum& sum) const {
    if (most) *most = sum.most;
    if (mean) *mean = count > 0 ? static_cast<float>(sum.sum / count) : 0.0f;
  }
};

}  // namespace knead
