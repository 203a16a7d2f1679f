// L-BFGS: the two loops over the remembered pairs (Nocedal 1980) by inner products, so that a direction takes a handful of launches and of passes over
// memory whatever it remembers, and on a device the host has no part in it. With q = g - sum alpha y and r = M q, the factors of either loop need only
// s.g, y.r and s.y. The host sums pieces (`over`), devices rows.
#pragma once
#include "kernels/row4.h"

namespace knead {

// What L-BFGS remembers beside the pairs' rows: products, and the factors of the two loops.
struct LbfgsSums {
  static constexpr uint32_t kMost = 8;  // Twice as many pairs save no iteration.
  // A pair says at least this part of the curvature that the metric had along the pair's step.
  static constexpr double kLeastCurvature = 0.2;
  double sy[kMost][kMost];  // s_i . y_j, of pairs i that are not younger than j
  double over[kMost];       // 1 / s.y; 0 of a pair without use
  double alpha[kMost];      // the factor of y in q
  double factor[kMost];     // the factor of s in the direction
  double steep[kMost];      // s . g of the last direction
  double kept, added;       // The newest pair's y becomes kept y + added g, with g the gradient before.
  double volume;            // the factor of `solved` in SecondLoop: the enclosed volume's gradient times r, over the term's scale
  double volume_over;       // 1 / that scale
};

// Which pairs there are, oldest first.
struct LbfgsRing {
  uint32_t pairs, newest;
  KNEAD_HD uint32_t slot(uint32_t age) const { return (newest + LbfgsSums::kMost - age) % LbfgsSums::kMost; }  // age 0: the newest
  KNEAD_HD bool has(uint32_t slot) const { return (newest + LbfgsSums::kMost - slot) % LbfgsSums::kMost < pairs; }
};

struct LbfgsDots {
  double of[LbfgsSums::kMost] = {};
  double steps = 0, changes = 0;  // squares of the new pair
  double steep = 0;               // the new pair's step times the gradient before
};
KNEAD_HD LbfgsDots added(LbfgsDots a, const LbfgsDots& b) {
  for (uint32_t k = 0; k < LbfgsSums::kMost; ++k) a.of[k] += b.of[k];
  a.steps += b.steps;
  a.changes += b.changes;
  a.steep += b.steep;
  return a;
}
KNEAD_HD double product(const Row4* a, const Row4* b, size_t p) {
  return static_cast<double>(sum_of(row_at(a, p) * row_at(b, p)));
}
// For a piece of the rows on the host.
inline double product(const Row4* a, const Row4* b, size_t begin, size_t end) {
  RowValue sums[4] = {};
  size_t p = begin;
  for (; p + 4 <= end; p += 4)
    for (size_t k = 0; k < 4; ++k) sums[k] = sums[k] + row_at(a, p + k) * row_at(b, p + k);
  for (; p < end; ++p) sums[0] = sums[0] + row_at(a, p) * row_at(b, p);
  return static_cast<double>(sum_of((sums[0] + sums[1]) + (sums[2] + sums[3])));
}

struct PairRows {
  const Row4 *steps, *changes;  // [kMost][rows]
  size_t rows;
  KNEAD_HD const Row4* step(uint32_t slot) const { return steps + slot * rows; }
  KNEAD_HD const Row4* change(uint32_t slot) const { return changes + slot * rows; }
  // With v, for a piece of the rows on the host.
  LbfgsDots with_steps(const LbfgsRing& ring, const Row4* v, size_t begin, size_t end) const { return with(steps, ring, v, begin, end); }
  LbfgsDots with_changes(const LbfgsRing& ring, const Row4* v, size_t begin, size_t end) const { return with(changes, ring, v, begin, end); }

 private:
  LbfgsDots with(const Row4* all, const LbfgsRing& ring, const Row4* v, size_t begin, size_t end) const {
    LbfgsDots dots;
    for (uint32_t k = 0; k < LbfgsSums::kMost; ++k)
      if (ring.has(k)) dots.of[k] = product(all + k * rows, v, begin, end);
    return dots;
  }
};

// Stores the step that was taken and the change of the gradient in the newest slot. Where the energy bends less along the step than a part of what
// the metric thought, or downwards as by a saddle, the change is mixed with the metric's own B s so that this part is left (Powell 1978): the next step along
// the same way is longer, but not out of all proportion. B s is -along g, since s = -along B^-1 g.
struct RememberPair {
  static constexpr const char* kKernel = "remember_pair";
  PairRows rows;
  LbfgsRing ring;  // with the new pair
  const Row4 *before, *after, *gradient_before, *gradient_after;
  Row4 *step, *change;  // the newest slot's
  LbfgsSums* sums;
  double along;  // of the direction, the step

  KNEAD_HD LbfgsDots operator()(uint32_t p) const {
    store(p);
    LbfgsDots dots;
    for (uint32_t k = 0; k < LbfgsSums::kMost; ++k)
      if (ring.has(k)) dots.of[k] = product(rows.step(k), change, p);
    dots.steps = product(step, step, p);
    dots.changes = product(change, change, p);
    dots.steep = product(step, gradient_before, p);
    return dots;
  }
  LbfgsDots over(size_t begin, size_t end) const {
    for (size_t p = begin; p < end; ++p) store(p);
    LbfgsDots dots = rows.with_steps(ring, change, begin, end);
    dots.steps = product(step, step, begin, end);
    dots.changes = product(change, change, begin, end);
    dots.steep = product(step, gradient_before, begin, end);
    return dots;
  }
  KNEAD_HD void store(size_t p) const {
    put_row(step, p, row_at(after, p) - row_at(before, p));
    put_row(change, p, row_at(gradient_after, p) - row_at(gradient_before, p));
  }
  static KNEAD_HD LbfgsDots combine(const LbfgsDots& a, const LbfgsDots& b) { return added(a, b); }
  KNEAD_HD void finish(const LbfgsDots& dots) const {
    const double straight = dots.of[ring.newest], expected = -along * dots.steep;
    const bool damped = straight < LbfgsSums::kLeastCurvature * expected;
    sums->kept = damped ? (1 - LbfgsSums::kLeastCurvature) * expected / (expected - straight) : 1;
    sums->added = (sums->kept - 1) * along;
    sums->steep[ring.newest] = dots.steep;
    for (uint32_t age = 0; age < ring.pairs; ++age) {
      const uint32_t i = ring.slot(age);
      sums->sy[i][ring.newest] = sums->kept * dots.of[i] + sums->added * sums->steep[i];
    }
    const double sy = sums->sy[ring.newest][ring.newest];
    sums->over[ring.newest] = sy > 1e-10 * sqrt(dots.steps * dots.changes) ? 1 / sy : 0;
  }
};

// What RememberPair makes of the newest pair's change of the gradient.
struct DampPair {
  static constexpr const char* kKernel = "damp_pair";
  Row4* change;
  const Row4* gradient_before;
  const LbfgsSums* sums;
  KNEAD_HD void operator()(uint32_t p) const {
    if (sums->kept == 1) return;
    put_row(change, p, row_at(change, p) * static_cast<float>(sums->kept) + row_at(gradient_before, p) * static_cast<float>(sums->added));
  }
};

// The first loop: from the newest pair to the oldest.
struct FirstLoop {
  static constexpr const char* kKernel = "lbfgs_first";
  PairRows rows;
  LbfgsRing ring;
  const Row4* gradient;
  LbfgsSums* sums;

  KNEAD_HD LbfgsDots operator()(uint32_t p) const {
    LbfgsDots dots;
    for (uint32_t k = 0; k < LbfgsSums::kMost; ++k)
      if (ring.has(k)) dots.of[k] = product(rows.step(k), gradient, p);
    return dots;
  }
  LbfgsDots over(size_t begin, size_t end) const { return rows.with_steps(ring, gradient, begin, end); }
  static KNEAD_HD LbfgsDots combine(const LbfgsDots& a, const LbfgsDots& b) { return added(a, b); }
  KNEAD_HD void finish(const LbfgsDots& dots) const {
    for (uint32_t age = 0; age < ring.pairs; ++age) {
      const uint32_t i = ring.slot(age);
      double along = sums->steep[i] = dots.of[i];
      for (uint32_t younger = 0; younger < age; ++younger) along -= sums->alpha[ring.slot(younger)] * sums->sy[i][ring.slot(younger)];
      sums->alpha[i] = along * sums->over[i];
    }
  }
};

// q, on which the metric then works.
struct WithoutChanges {
  static constexpr const char* kKernel = "lbfgs_apply";
  PairRows rows;
  LbfgsRing ring;
  const Row4* gradient;
  const LbfgsSums* sums;
  Row4* q;

  KNEAD_HD void operator()(uint32_t p) const {
    RowValue sum = row_at(gradient, p);
    for (uint32_t age = 0; age < ring.pairs; ++age) {
      const uint32_t i = ring.slot(age);
      sum = sum - row_at(rows.change(i), p) * static_cast<float>(sums->alpha[i]);
    }
    put_row(q, p, sum);
  }
};

// The enclosed volume's part of the Hessian has rank 1 (Sherman and Morrison 1950): volume volume^T / compliance. `solved` is the metric's inverse times
// `volume`. VolumeTermScale finds what the part is divided by, once for a metric, VolumeTermPart the part of one direction.
struct VolumeTermScale {
  static constexpr const char* kKernel = "volume_term_scale";
  const Row4 *volume, *solved;
  double compliance;
  LbfgsSums* sums;
  KNEAD_HD double operator()(uint32_t p) const { return product(volume, solved, p); }
  double over(size_t begin, size_t end) const { return product(volume, solved, begin, end); }
  static KNEAD_HD double combine(double a, double b) { return a + b; }
  KNEAD_HD void finish(double along) const { sums->volume_over = 1 / (compliance + along); }
};
struct VolumeTermPart {
  static constexpr const char* kKernel = "volume_term_part";
  const Row4 *volume, *r;
  LbfgsSums* sums;
  KNEAD_HD double operator()(uint32_t p) const { return product(volume, r, p); }
  double over(size_t begin, size_t end) const { return product(volume, r, begin, end); }
  static KNEAD_HD double combine(double a, double b) { return a + b; }
  KNEAD_HD void finish(double along) const { sums->volume = along * sums->volume_over; }
};

// The second loop: from the oldest pair to the newest. `r` is what the metric made of q, as yet without the volume's part.
struct SecondLoop {
  static constexpr const char* kKernel = "lbfgs_second";
  PairRows rows;
  LbfgsRing ring;
  const Row4* solved;  // as VolumeTermScale has it; null: the volume is not kept
  Row4* r;
  LbfgsSums* sums;
  float scale;  // of the metric
  uint32_t unused = 0;

  KNEAD_HD LbfgsDots operator()(uint32_t p) const {
    complete(p);
    LbfgsDots dots;
    for (uint32_t k = 0; k < LbfgsSums::kMost; ++k)
      if (ring.has(k)) dots.of[k] = product(rows.change(k), r, p);
    return dots;
  }
  LbfgsDots over(size_t begin, size_t end) const {
    for (size_t p = begin; p < end; ++p) complete(p);
    return rows.with_changes(ring, r, begin, end);
  }
  KNEAD_HD void complete(size_t p) const {
    RowValue at = row_at(r, p);
    if (solved) at = at - row_at(solved, p) * static_cast<float>(sums->volume);
    put_row(r, p, at * scale);
  }
  static KNEAD_HD LbfgsDots combine(const LbfgsDots& a, const LbfgsDots& b) { return added(a, b); }
  KNEAD_HD void finish(const LbfgsDots& dots) const {
    for (uint32_t age = ring.pairs; age-- > 0;) {
      const uint32_t i = ring.slot(age);
      double along = dots.of[i];
      for (uint32_t older = age + 1; older < ring.pairs; ++older) along += sums->factor[ring.slot(older)] * sums->sy[ring.slot(older)][i];
      sums->factor[i] = sums->alpha[i] - along * sums->over[i];
    }
  }
};

// The direction, downhill, which overwrites r, and the energy's slope along the direction.
struct Downhill {
  static constexpr const char* kKernel = "lbfgs_direction";
  PairRows rows;
  LbfgsRing ring;
  const LbfgsSums* sums;
  const Row4* gradient;
  Row4* direction;
  double* slope;

  KNEAD_HD double operator()(uint32_t p) const {
    RowValue sum = row_at(direction, p);
    for (uint32_t age = ring.pairs; age-- > 0;) {
      const uint32_t i = ring.slot(age);
      sum = sum + row_at(rows.step(i), p) * static_cast<float>(sums->factor[i]);
    }
    put_row(direction, p, sum * -1);
    return product(gradient, direction, p);
  }
  static KNEAD_HD double combine(double a, double b) { return a + b; }
  KNEAD_HD void finish(double along) const { *slope = along; }
};

// H's positions.
struct MovedVertices {
  static constexpr const char* kKernel = "moved_vertices";
  const Vec3f* rest;
  const Row4* u;
  const uint32_t* vertex_at;
  Vec3f* to;
  KNEAD_HD void operator()(uint32_t p) const { to[vertex_at[p]] = rest[vertex_at[p]] + to_vec(u[p]); }
};

}  // namespace knead
