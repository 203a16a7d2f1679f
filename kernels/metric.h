// What L-BFGS over H takes for the inverse of the energy's second derivative: a symmetric positive definite operator that applies, nearly or exactly,
// the inverse of a matrix P with one value per edge of H and one per vertex, the same for x, y and z.
#pragma once
#include <functional>
#include <memory>
#include <span>

#include "graph/executor.h"
#include "kernels/rows4.h"

namespace knead {

struct EnergyLanes;

class Metric {
 public:
  virtual ~Metric() = default;

  // The same for another diagonal. Only of metrics that were not made so themselves.
  virtual std::unique_ptr<Metric> renewed(Executor& executor, const EnergyLanes& lanes, std::span<const float> diagonal,
                                          const std::function<void()>& check) const = 0;
  // The same for other entries, by edge, and another diagonal.
  virtual std::unique_ptr<Metric> remade(Executor& executor, const EnergyLanes& lanes, std::span<const float> entries,
                                         std::span<const float> diagonal, const std::function<void()>& check) const = 0;

  // x <- M x. `x` has solve_rows() rows, those from size() on for the solve itself; `scratch` has scratch_floats() of room, aligned as a Row4.
  // Neither number changes when a metric is renewed or remade.
  virtual void solve(Executor& executor, const EnergyLanes& lanes, Row4* x, float* scratch) const = 0;
  virtual size_t solve_rows() const = 0;
  virtual size_t scratch_floats() const = 0;
};

}  // namespace knead
