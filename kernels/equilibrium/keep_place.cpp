#include "kernels/equilibrium/keep_place.h"

#include <algorithm>

namespace knead {
namespace {

// Of the metric. From 0 on, all of the grids, no iteration is saved on eight of ten scenes and 4 of 51 on one; the coarsest alone takes 41 to 116 for 35 to 43
// on tori.
constexpr size_t kAnswerGrid = 2;

}  // namespace

KeepPlace::KeepPlace(Executor& executor, const EquilibriumRest& rest) : executor_(executor), rest_(rest) {
  if (!any()) return;
  const uint32_t parts = rest.floating.count;
  const auto& tree = rest.floating.tree;
  for (size_t row = 0; row + 1 < tree.size(); ++row) tree_.emplace_back(tree[row].size() - 1, executor.memory());
  sums_ = Buffer<SixSums>(6 * size_t{parts}, executor.memory());
  factors_ = Buffer<SixSums>(parts, executor.memory());
  inverse_ = Buffer<double>(36 * size_t{parts}, executor.memory());
  answers_ = filled<Row4>(executor, 6 * rest.grids->solve_rows());
}

SixRows KeepPlace::motions(bool weighted) const {
  return {rest_.on.arms, nullptr, weighted ? rest_.on.mass : nullptr};
}
SixRows KeepPlace::answers() const {
  return {nullptr, answers_.view(executor_.device()).data(), nullptr, rest_.grids->solve_rows()};
}

// By part, in the executor's memory.
void KeepPlace::sums(const SixRows& six, const Row4* v, SixSums* to) {
  for (size_t row = 0; row <= tree_.size(); ++row) {
    const bool last = row == tree_.size();
    const size_t n = last ? factors_.size() : tree_[row].size();
    SixSums* here = last ? to : tree_[row].data_for_write();
    const uint32_t* offsets = rest_.on.part_tree[row];
    if (row == 0)
      parallel_for(executor_, n, PartSums{six, v, offsets, rest_.on.members, here});
    else
      parallel_for(executor_, n, PartSumsAgain{tree_[row - 1].data_for_write(), offsets, here});
  }
}

// v <- v - six (inverse of_sums v)
void KeepPlace::subtract(const SixRows& of_sums, const double* inverse, bool transposed, const SixRows& six, Row4* v) {
  SixSums *products = sums_.data_for_write(), *factors = factors_.data_for_write();
  sums(of_sums, v, products);
  parallel_for(executor_, factors_.size(), PartFactors{products, inverse, factors, transposed});
  parallel_for(executor_, rest_.vertices, WithoutSix{six, factors, rest_.on.part_of, v, FloatingParts::kNone});
}

void KeepPlace::project(Row4* u) {
  if (any()) subtract(motions(true), rest_.on.part_inverse, false, motions(false), u);
}
void KeepPlace::balance_forces(Row4* gradient) {
  if (any()) subtract(motions(false), rest_.on.part_inverse, true, motions(true), gradient);
}

void KeepPlace::renew(const Multigrid& metric, const EnergySimd& lanes, Row4* work) {
  if (!any()) return;
  const size_t parts = factors_.size(), rows = rest_.grids->solve_rows();
  for (uint32_t which = 0; which < 6; ++which) {
    Row4* answer = answers_.data_for_write() + which * rows;
    parallel_for(executor_, rest_.vertices, OneOfSix{motions(true), rest_.on.part_of, answer, which, FloatingParts::kNone});
    metric.solve(executor_, lanes, answer, work, std::min(kAnswerGrid, metric.levels().size() - 1));
    sums(motions(true), answer, sums_.data_for_write() + which * parts);
  }
  parallel_for(executor_, parts, PartInverse{sums_.data_for_write(), inverse_.data_for_write(), static_cast<uint32_t>(parts)});
  has_answers_ = true;
}

void KeepPlace::before_metric(Row4* q) {
  if (has_answers_) subtract(answers(), inverse_.data_for_write(), true, motions(true), q);
}
void KeepPlace::after_metric(Row4* r) {
  if (has_answers_) subtract(motions(true), inverse_.data_for_write(), false, answers(), r);
}

}  // namespace knead
