// Sparse Cholesky for many solves by the multifrontal method (Duff and Reid 1983; Liu 1992) over a nested dissection, in float32: three right-hand
// sides at once, and quick enough to be made anew for a frame's contacts (kernels/factor_body.h).
#pragma once
#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "graph/buffer.h"
#include "graph/executor.h"
#include "kernels/factor_body.h"
#include "kernels/metric.h"
#include "kernels/nested_dissection.h"

namespace knead {

// What belongs to the matrix's pattern: the tree of fronts and where everything goes. Shared by all factors.
class FactorPlan {
 public:
  // In places of the dissection: `edges`, each once.
  FactorPlan(const Dissection& dissection, std::vector<std::array<uint32_t, 2>> edges, const std::function<void()>& check = {});

  uint32_t size() const { return static_cast<uint32_t>(node_of_.size()); }
  size_t stored_values() const { return values_; }
  double flops() const { return flops_; }  // of one factorisation
  double bytes() const { return bytes_; }  // of a factor with its updates, and of what it needs while it is made

 private:
  friend class SparseCholesky;
  struct Front {
    uint32_t first = 0, width = 0, height = 0, ld = 0;
    uint32_t parent = DissectionNode::kNone;
    uint32_t rows = 0;  // its columns and then the rows below them, in rows_
    uint32_t panels = 0, panel_count = 0;
    uint32_t own = 0, own_count = 0;  // its edges, in own_
    uint32_t to_parent = 0;           // where its rows below are in its parent's front, in to_parent_
    std::vector<uint32_t> children;
  };
  // Subtrees that are solved at once: whole nodes and all that is below them, so consecutive panels.
  struct Part {
    uint32_t begin = 0, end = 0;  // panels
  };
  void cut_into_parts();

  struct Own {
    uint32_t row, column;  // in the front
    uint32_t edge;
  };
  std::vector<Front> fronts_;
  std::vector<Panel> panels_;
  std::vector<uint32_t> rows_, to_parent_, node_of_;
  std::vector<Own> own_;
  std::vector<std::vector<int>> successors_;
  std::vector<int> waits_for_;
  std::vector<Part> parts_, rest_;    // rest_: runs of panels above the parts, in order
  std::vector<uint32_t> top_places_;  // of the panels above the parts
  std::vector<uint32_t> part_rows_;   // rows_, but places above the parts are given in rows of the part's own, behind the vector
  size_t values_ = 0;
  uint32_t highest_ = 0;
  double flops_ = 0, bytes_ = 0;
};

class SparseCholesky : public Metric {
 public:
  // The factor of the matrix with these entries, by edge, and this diagonal. Throws Error(kInput) when it is not positive definite. `check` is called
  // now and then by any thread, and may throw.
  SparseCholesky(Executor& executor, const EnergyLanes& lanes, std::shared_ptr<const FactorPlan> plan, std::span<const float> entries,
                 std::span<const float> diagonal, const std::function<void()>& check = {});

  // The factor for another diagonal. Only the fronts above places where it differs are made anew; the others are shared with `before`, which must
  // have kept its updates (a factor made by the constructor has).
  SparseCholesky(Executor& executor, const EnergyLanes& lanes, const SparseCholesky& before, std::span<const float> diagonal,
                 const std::function<void()>& check = {});

  std::unique_ptr<Metric> renewed(Executor& executor, const EnergyLanes& lanes, std::span<const float> diagonal,
                                  const std::function<void()>& check) const override {
    return std::make_unique<SparseCholesky>(executor, lanes, *this, diagonal, check);
  }
  std::unique_ptr<Metric> remade(Executor& executor, const EnergyLanes& lanes, std::span<const float> entries, std::span<const float> diagonal,
                                 const std::function<void()>& check) const override {
    return std::make_unique<SparseCholesky>(executor, lanes, plan_, entries, diagonal, check);
  }

  // x <- A^-1 x
  void solve(Executor& executor, const EnergyLanes& lanes, Row4* x, float* scratch) const override;
  size_t solve_rows() const override { return (plan_->size() + 15) / 16 * 16 + plan_->parts_.size() * plan_->top_places_.size(); }
  size_t scratch_floats() const override { return 3 * size_t{plan_->highest_} * (plan_->parts_.size() + 1); }

 private:
  void make(Executor& executor, const EnergyLanes& lanes, const SparseCholesky* before, const std::vector<char>& changed,
            const std::function<void()>& check);
  void factor_front(const EnergyLanes& lanes, uint32_t n, const SparseCholesky* before, const std::vector<char>& changed);

  std::shared_ptr<const FactorPlan> plan_;
  std::shared_ptr<const std::vector<float>> entries_;
  std::vector<float> diagonal_;
  std::vector<Buffer<float>> updates_;  // by front: what it hands to its parent, by columns of full height
  Buffer<float> values_, shared_;       // of the panels made here, and those of the factor before
  std::vector<float*> panel_values_;    // where a panel's entries are
};

}  // namespace knead
