// Steps of kernels/equilibrium/keep_place.h: sums over the floating parts of H, and what they take out of a vector.
#pragma once
#include "kernels/row4.h"

namespace knead {

// Six vectors over H, of which each floating part has its own stretch: rigid motions, which are told from the arms, or any others.
struct SixRows {
  const Row4* arms;   // from the centre of the part's mass, over the part's size; null: `rows`
  const Row4* rows;   // [6][count]
  const float* mass;  // each vertex is multiplied by its mass; null: by one
  size_t count = 0;

  // Adds the products of each of the six with v, at vertex p.
  KNEAD_HD void add_products(const Row4* v, uint32_t p, double* to) const {
    const double m = mass ? static_cast<double>(mass[p]) : 1;
    const Vec3f at = to_vec(v[p]);
    if (!arms) {
      for (uint32_t a = 0; a < 6; ++a) to[a] += m * static_cast<double>(dot(to_vec(rows[a * count + p]), at));
      return;
    }
    const Vec3f turn = cross(to_vec(arms[p]), at);
    for (int k = 0; k < 3; ++k) {
      to[k] += m * static_cast<double>(at[k]);
      to[3 + k] += m * static_cast<double>(turn[k]);
    }
  }
  // The six by factors, at vertex p.
  KNEAD_HD Vec3f combined(const double* factors, uint32_t p) const {
    const float m = mass ? mass[p] : 1.0f;
    float f[6];
    for (uint32_t a = 0; a < 6; ++a) f[a] = static_cast<float>(factors[a]);
    if (arms) return m * (Vec3f{f[0], f[1], f[2]} + cross(Vec3f{f[3], f[4], f[5]}, to_vec(arms[p])));
    Vec3f sum{0, 0, 0};
    for (uint32_t a = 0; a < 6; ++a) sum += f[a] * to_vec(rows[a * count + p]);
    return m * sum;
  }
};

struct SixSums {
  double of[6];
};

// The first sums, each over a few vertices of one part.
struct PartSums {
  static constexpr const char* kKernel = "part_sums";
  SixRows six;
  const Row4* v;
  const uint32_t *offsets, *members;
  SixSums* to;
  KNEAD_HD void operator()(uint32_t i) const {
    SixSums sum{};
    for (uint32_t e = offsets[i]; e < offsets[i + 1]; ++e) six.add_products(v, members[e], sum.of);
    to[i] = sum;
  }
};

// Sums of sums.
struct PartSumsAgain {
  static constexpr const char* kKernel = "part_sums_again";
  const SixSums* from;
  const uint32_t* offsets;
  SixSums* to;
  KNEAD_HD void operator()(uint32_t i) const {
    SixSums sum{};
    for (uint32_t e = offsets[i]; e < offsets[i + 1]; ++e)
      for (uint32_t a = 0; a < 6; ++a) sum.of[a] += from[e].of[a];
    to[i] = sum;
  }
};

// Gauss and Jordan, with the largest pivot of a column. A matrix without inverse becomes zero.
KNEAD_HD void invert_six(double* m) {
  double inverse[36];
  for (uint32_t k = 0; k < 36; ++k) inverse[k] = k % 7 == 0;
  for (uint32_t c = 0; c < 6; ++c) {
    uint32_t at = c;
    for (uint32_t r = c + 1; r < 6; ++r)
      if (fabs(m[6 * r + c]) > fabs(m[6 * at + c])) at = r;
    const double pivot = m[6 * at + c];
    if (!(fabs(pivot) > 0)) {
      for (uint32_t k = 0; k < 36; ++k) m[k] = 0;
      return;
    }
    for (uint32_t k = 0; k < 6; ++k) {
      const double a = m[6 * at + k], b = inverse[6 * at + k];
      m[6 * at + k] = m[6 * c + k];
      inverse[6 * at + k] = inverse[6 * c + k];
      m[6 * c + k] = a / pivot;
      inverse[6 * c + k] = b / pivot;
    }
    for (uint32_t r = 0; r < 6; ++r) {
      const double by = m[6 * r + c];
      if (r == c || by == 0) continue;
      for (uint32_t k = 0; k < 6; ++k) {
        m[6 * r + k] -= by * m[6 * c + k];
        inverse[6 * r + k] -= by * inverse[6 * c + k];
      }
    }
  }
  for (uint32_t k = 0; k < 36; ++k) m[k] = inverse[k];
}

// By part, the inverse of the matrix whose columns are sums.
struct PartInverse {
  static constexpr const char* kKernel = "part_inverse";
  const SixSums* columns;  // [6][parts]
  double* to;              // [parts][36], row by row
  uint32_t parts, unused = 0;
  KNEAD_HD void operator()(uint32_t i) const {
    double m[36];
    for (uint32_t c = 0; c < 6; ++c)
      for (uint32_t r = 0; r < 6; ++r) m[6 * r + c] = columns[c * parts + i].of[r];
    invert_six(m);
    for (uint32_t k = 0; k < 36; ++k) to[36 * static_cast<size_t>(i) + k] = m[k];
  }
};

// By part, what the six are to be multiplied by: the inverse times the sums, or its transpose.
struct PartFactors {
  static constexpr const char* kKernel = "part_factors";
  const SixSums* sums;
  const double* inverse;  // [parts][36]
  SixSums* to;
  uint32_t transposed, unused = 0;
  KNEAD_HD void operator()(uint32_t i) const {
    const double* m = inverse + 36 * static_cast<size_t>(i);
    for (uint32_t r = 0; r < 6; ++r) {
      double sum = 0;
      for (uint32_t c = 0; c < 6; ++c) sum += (transposed ? m[6 * c + r] : m[6 * r + c]) * sums[i].of[c];
      to[i].of[r] = sum;
    }
  }
};

// v <- v - the six by their factors.
struct WithoutSix {
  static constexpr const char* kKernel = "without_six";
  SixRows six;
  const SixSums* factors;
  const uint32_t* part_of;  // by vertex
  Row4* v;
  uint32_t none, unused = 0;
  KNEAD_HD void operator()(uint32_t p) const {
    if (part_of[p] != none) v[p] = to_row(to_vec(v[p]) - six.combined(factors[part_of[p]].of, p));
  }
};

// One of the six by itself.
struct OneOfSix {
  static constexpr const char* kKernel = "one_of_six";
  SixRows six;
  const uint32_t* part_of;
  Row4* to;
  uint32_t which, none;
  KNEAD_HD void operator()(uint32_t p) const {
    double factors[6] = {};
    factors[which] = 1;
    to[p] = to_row(part_of[p] == none ? Vec3f{0, 0, 0} : six.combined(factors, p));
  }
};

// The squared length of a gradient.
struct GradientSquares {
  static constexpr const char* kKernel = "gradient_squares";
  const Row4* gradient;
  double* result;
  KNEAD_HD double operator()(uint32_t p) const { return static_cast<double>(squared(row_at(gradient, p))); }
  static KNEAD_HD double combine(double a, double b) { return a + b; }
  KNEAD_HD void finish(double sum) const { *result = sum; }
};

}  // namespace knead
