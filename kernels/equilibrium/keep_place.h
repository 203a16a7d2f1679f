// A body that nothing holds keeps its place: of each of its floating parts the displacement has neither a mean nor a turn, weighted by mass,
//
//   sum_j m_j u_j = 0   and   sum_j m_j r_j x u_j = 0,   r_j from the centre of mass at rest,
//
// six linear conditions a part. A pull on the mass, even like weight, and a couple balance what presses: they are the conditions' multipliers. The descent stays
// where the conditions hold. With T the six rigid motions and C^T those times mass, gradients have P = I - T (C T)^-1 C taken to them, as P^T g, and a metric M
// becomes Q M Q^T with Q = I - Y (C Y)^-1 C: for Y = M C^T this is the inverse of the energy's second derivative among such displacements; any other Y leaves
// the metric symmetric and positive, and steps where they should be.
#pragma once
#include <vector>

#include "kernels/equilibrium/keep_place_body.h"
#include "kernels/equilibrium/rest_tables.h"
#include "kernels/equilibrium/rows.h"

namespace knead {

class KeepPlace {
 public:
  KeepPlace(Executor& executor, const EquilibriumRest& rest);
  bool any() const { return rest_.floating.count > 0; }  // Else nothing below changes anything.

  void project(Row4* u);                // u <- P u
  void balance_forces(Row4* gradient);  // g <- P^T g

  // Y for a metric, as its coarse grids know it: a body that lies on its contacts under even pulls. Y = T, rigid motions that no contact resists, takes 54 to
  // 128 iterations for 34 to 52 (examples' head and crush, spot, head_ict_2400 and penguin of the test data).
  void renew(const Multigrid& metric, const EnergySimd& lanes, Row4* work);
  // What goes before the metric, q <- Q^T q, and after, r <- Q r; nothing before the first renew.
  void before_metric(Row4* q);
  void after_metric(Row4* r);

 private:
  void sums(const SixRows& six, const Row4* v, SixSums* to);
  void subtract(const SixRows& of_sums, const double* inverse, bool transposed, const SixRows& six, Row4* v);
  SixRows motions(bool weighted) const;
  SixRows answers() const;  // Y

  Executor& executor_;
  const EquilibriumRest& rest_;
  std::vector<Buffer<SixSums>> tree_;  // a row each of FloatingParts::tree, but for the last
  Buffer<SixSums> sums_, factors_;     // [6][parts], [parts]
  Buffer<double> inverse_;             // of C Y, by part
  Buffer<Row4> answers_;               // [6][solve rows]
  bool has_answers_ = false;
};

// A metric among the displacements that keep the body's place.
struct PlacedMetric {
  Executor& executor;
  const Multigrid& metric;
  const EnergySimd& lanes;
  KeepPlace& place;
  size_t grid;  // as Multigrid::solve has it
  Row4* work;

  // x <- M x
  void solve(Row4* x) const {
    place.before_metric(x);
    metric.solve(executor, lanes, x, work, grid);
    place.after_metric(x);
  }
};

}  // namespace knead
