// L-BFGS: the two loops over the remembered pairs (Nocedal 1980) by inner products, so that a direction takes a handful of launches and of passes over
// memory whatever it remembers, and on a device the host has no part in it. With q = g - sum alpha y and r = M q, the factors of either loop need only
// s.g, y.r and s.y. The host sums pieces (`over`), devices rows.
#pragma once
#include "kernels/row4.h"

namespace knead {

struct History {
  static constexpr uint32_t kMost = 8;            // pairs: twice as many save no iteration
  static constexpr double kLeastCurvature = 0.2;  // of the curvature that the metric had along a step: what its pair says at least
  double sy[kMost][kMost];                        // s_i . y_j, of pairs i that are not younger than j
  double over[kMost];                             // 1 / s.y; 0 of a pair without use
  double alpha[kMost], factor[kMost];             // of y in q, and of s in the direction
  double steep[kMost];                            // s . g of the last direction
  double kept, added;                             // of the newest pair's y and of the gradient before, what y is made of instead
  double bulk, bulk_over;                         // of the enclosed volume's part: its gradient times r, and what that is divided by
};

// Which pairs there are, oldest first.
struct Ring {
  uint32_t pairs, newest;
  KNEAD_HD uint32_t slot(uint32_t age) const { return (newest + History::kMost - age) % History::kMost; }  // age 0: the newest
  KNEAD_HD bool has(uint32_t slot) const { return (newest + History::kMost - slot) % History::kMost < pairs; }
};

struct HistoryDots {
  double of[History::kMost] = {};
  double steps = 0, changes = 0, steep = 0;  // squares of the new pair, and its step times the gradient before
};
KNEAD_HD HistoryDots added(HistoryDots a, const HistoryDots& b) {
  for (uint32_t k = 0; k < History::kMost; ++k) a.of[k] += b.of[k];
  a.steps += b.steps;
  a.changes += b.changes;
  a.steep += b.steep;
  return a;
}
KNEAD_HD double product(const Row4* a, const Row4* b, size_t p) {
  return static_cast<double>(sum_of(quad_at(a, p) * quad_at(b, p)));
}
// For a piece of the rows on the host.
inline double product(const Row4* a, const Row4* b, size_t begin, size_t end) {
  Quad sums[4] = {};
  size_t p = begin;
  for (; p + 4 <= end; p += 4)
    for (size_t k = 0; k < 4; ++k) sums[k] = sums[k] + quad_at(a, p + k) * quad_at(b, p + k);
  for (; p < end; ++p) sums[0] = sums[0] + quad_at(a, p) * quad_at(b, p);
  return static_cast<double>(sum_of((sums[0] + sums[1]) + (sums[2] + sums[3])));
}

struct PairRows {
  const Row4 *steps, *changes;  // [kMost][rows]
  size_t rows;
  KNEAD_HD const Row4* step(uint32_t slot) const { return steps + slot * rows; }
  KNEAD_HD const Row4* change(uint32_t slot) const { return changes + slot * rows; }
  // With v, for a piece of the rows on the host.
  HistoryDots with_steps(const Ring& ring, const Row4* v, size_t begin, size_t end) const { return with(steps, ring, v, begin, end); }
  HistoryDots with_changes(const Ring& ring, const Row4* v, size_t begin, size_t end) const { return with(changes, ring, v, begin, end); }

 private:
  HistoryDots with(const Row4* all, const Ring& ring, const Row4* v, size_t begin, size_t end) const {
    HistoryDots dots;
    for (uint32_t k = 0; k < History::kMost; ++k)
      if (ring.has(k)) dots.of[k] = product(all + k * rows, v, begin, end);
    return dots;
  }
};

// Stores the step that was taken and the change of the gradient in the newest slot. Where the energy bends less along it than a part of what the metric
// thought, or downwards as by a saddle, the change is mixed with the metric's own B s so that this part is left (Powell 1978): the next step along it is
// longer, but not out of all proportion. B s is -along g, since s = -along B^-1 g.
struct RememberPair {
  static constexpr const char* kKernel = "remember_pair";
  PairRows rows;
  Ring ring;  // with the new pair
  const Row4 *before, *after, *gradient_before, *gradient_after;
  Row4 *step, *change;  // the newest slot's
  History* history;
  double along;  // of the direction, the step

  KNEAD_HD HistoryDots operator()(uint32_t p) const {
    store(p);
    HistoryDots dots;
    for (uint32_t k = 0; k < History::kMost; ++k)
      if (ring.has(k)) dots.of[k] = product(rows.step(k), change, p);
    dots.steps = product(step, step, p);
    dots.changes = product(change, change, p);
    dots.steep = product(step, gradient_before, p);
    return dots;
  }
  HistoryDots over(size_t begin, size_t end) const {
    for (size_t p = begin; p < end; ++p) store(p);
    HistoryDots dots = rows.with_steps(ring, change, begin, end);
    dots.steps = product(step, step, begin, end);
    dots.changes = product(change, change, begin, end);
    dots.steep = product(step, gradient_before, begin, end);
    return dots;
  }
  KNEAD_HD void store(size_t p) const {
    put_quad(step, p, quad_at(after, p) - quad_at(before, p));
    put_quad(change, p, quad_at(gradient_after, p) - quad_at(gradient_before, p));
  }
  static KNEAD_HD HistoryDots combine(const HistoryDots& a, const HistoryDots& b) { return added(a, b); }
  KNEAD_HD void finish(const HistoryDots& dots) const {
    const double straight = dots.of[ring.newest], expected = -along * dots.steep;
    const bool damped = straight < History::kLeastCurvature * expected;
    history->kept = damped ? (1 - History::kLeastCurvature) * expected / (expected - straight) : 1;
    history->added = (history->kept - 1) * along;
    history->steep[ring.newest] = dots.steep;
    for (uint32_t age = 0; age < ring.pairs; ++age) {
      const uint32_t i = ring.slot(age);
      history->sy[i][ring.newest] = history->kept * dots.of[i] + history->added * history->steep[i];
    }
    const double sy = history->sy[ring.newest][ring.newest];
    history->over[ring.newest] = sy > 1e-10 * sqrt(dots.steps * dots.changes) ? 1 / sy : 0;
  }
};

// What RememberPair makes of the newest pair's change of the gradient.
struct DampPair {
  static constexpr const char* kKernel = "damp_pair";
  Row4* change;
  const Row4* gradient_before;
  const History* history;
  KNEAD_HD void operator()(uint32_t p) const {
    if (history->kept == 1) return;
    put_quad(change, p, quad_at(change, p) * static_cast<float>(history->kept) + quad_at(gradient_before, p) * static_cast<float>(history->added));
  }
};

// The first loop: from the newest pair to the oldest.
struct FirstLoop {
  static constexpr const char* kKernel = "history_first";
  PairRows rows;
  Ring ring;
  const Row4* gradient;
  History* history;

  KNEAD_HD HistoryDots operator()(uint32_t p) const {
    HistoryDots dots;
    for (uint32_t k = 0; k < History::kMost; ++k)
      if (ring.has(k)) dots.of[k] = product(rows.step(k), gradient, p);
    return dots;
  }
  HistoryDots over(size_t begin, size_t end) const { return rows.with_steps(ring, gradient, begin, end); }
  static KNEAD_HD HistoryDots combine(const HistoryDots& a, const HistoryDots& b) { return added(a, b); }
  KNEAD_HD void finish(const HistoryDots& dots) const {
    for (uint32_t age = 0; age < ring.pairs; ++age) {
      const uint32_t i = ring.slot(age);
      double along = history->steep[i] = dots.of[i];
      for (uint32_t younger = 0; younger < age; ++younger) along -= history->alpha[ring.slot(younger)] * history->sy[i][ring.slot(younger)];
      history->alpha[i] = along * history->over[i];
    }
  }
};

// q, on which the metric then works.
struct WithoutChanges {
  static constexpr const char* kKernel = "history_apply";
  PairRows rows;
  Ring ring;
  const Row4* gradient;
  const History* history;
  Row4* q;

  KNEAD_HD void operator()(uint32_t p) const {
    Quad sum = quad_at(gradient, p);
    for (uint32_t age = 0; age < ring.pairs; ++age) {
      const uint32_t i = ring.slot(age);
      sum = sum - quad_at(rows.change(i), p) * static_cast<float>(history->alpha[i]);
    }
    put_quad(q, p, sum);
  }
};

// The enclosed volume's part of the Hessian has rank 1 (Sherman and Morrison 1950). First what it is divided by, once for a metric.
struct BulkOver {
  static constexpr const char* kKernel = "bulk_over";
  const Row4 *bulk, *solved;
  double compliance;
  History* history;
  KNEAD_HD double operator()(uint32_t p) const { return product(bulk, solved, p); }
  double over(size_t begin, size_t end) const { return product(bulk, solved, begin, end); }
  static KNEAD_HD double combine(double a, double b) { return a + b; }
  KNEAD_HD void finish(double along) const { history->bulk_over = 1 / (compliance + along); }
};
struct BulkAlong {
  static constexpr const char* kKernel = "bulk_along";
  const Row4 *bulk, *r;
  History* history;
  KNEAD_HD double operator()(uint32_t p) const { return product(bulk, r, p); }
  double over(size_t begin, size_t end) const { return product(bulk, r, begin, end); }
  static KNEAD_HD double combine(double a, double b) { return a + b; }
  KNEAD_HD void finish(double along) const { history->bulk = along * history->bulk_over; }
};

// The second loop: from the oldest pair to the newest. `r` is what the metric made of q, as yet without the volume's part.
struct SecondLoop {
  static constexpr const char* kKernel = "history_second";
  PairRows rows;
  Ring ring;
  const Row4* solved;  // of the volume; null: it is not kept
  Row4* r;
  History* history;
  float scale;  // of the metric
  uint32_t unused = 0;

  KNEAD_HD HistoryDots operator()(uint32_t p) const {
    complete(p);
    HistoryDots dots;
    for (uint32_t k = 0; k < History::kMost; ++k)
      if (ring.has(k)) dots.of[k] = product(rows.change(k), r, p);
    return dots;
  }
  HistoryDots over(size_t begin, size_t end) const {
    for (size_t p = begin; p < end; ++p) complete(p);
    return rows.with_changes(ring, r, begin, end);
  }
  KNEAD_HD void complete(size_t p) const {
    Quad at = quad_at(r, p);
    if (solved) at = at - quad_at(solved, p) * static_cast<float>(history->bulk);
    put_quad(r, p, at * scale);
  }
  static KNEAD_HD HistoryDots combine(const HistoryDots& a, const HistoryDots& b) { return added(a, b); }
  KNEAD_HD void finish(const HistoryDots& dots) const {
    for (uint32_t age = ring.pairs; age-- > 0;) {
      const uint32_t i = ring.slot(age);
      double along = dots.of[i];
      for (uint32_t older = age + 1; older < ring.pairs; ++older) along += history->factor[ring.slot(older)] * history->sy[ring.slot(older)][i];
      history->factor[i] = history->alpha[i] - along * history->over[i];
    }
  }
};

// The direction, downhill, in the place of r, and how steep it is.
struct Downhill {
  static constexpr const char* kKernel = "history_direction";
  PairRows rows;
  Ring ring;
  const History* history;
  const Row4* gradient;
  Row4* direction;
  double* slope;

  KNEAD_HD double operator()(uint32_t p) const {
    Quad sum = quad_at(direction, p);
    for (uint32_t age = ring.pairs; age-- > 0;) {
      const uint32_t i = ring.slot(age);
      sum = sum + quad_at(rows.step(i), p) * static_cast<float>(history->factor[i]);
    }
    put_quad(direction, p, sum * -1);
    return product(gradient, direction, p);
  }
  static KNEAD_HD double combine(double a, double b) { return a + b; }
  KNEAD_HD void finish(double along) const { *slope = along; }
};

// to = a + by b
struct CombineRows {
  static constexpr const char* kKernel = "combine_rows";
  Row4* to;
  const Row4 *a, *b;
  float by;
  uint32_t unused = 0;
  KNEAD_HD void operator()(uint32_t p) const { put_quad(to, p, quad_at(a, p) + quad_at(b, p) * by); }
};

// H's positions.
struct MovedPlaces {
  static constexpr const char* kKernel = "moved_places";
  const Vec3f* rest;
  const Row4* u;
  const uint32_t* vertex_at;
  Vec3f* to;
  KNEAD_HD void operator()(uint32_t p) const { to[vertex_at[p]] = rest[vertex_at[p]] + to_vec(u[p]); }
};

}  // namespace knead
