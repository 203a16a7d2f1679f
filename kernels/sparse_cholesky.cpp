#include "kernels/sparse_cholesky.h"

#include <algorithm>
#include <atomic>

#include "graph/error.h"
#include "kernels/energy_lanes.h"

namespace knead {

FactorPlan::FactorPlan(const Dissection& dissection, std::vector<std::array<uint32_t, 2>> edges, std::vector<float> entries) {
  const auto& nodes = dissection.nodes;
  const size_t count = nodes.size();
  fronts_.resize(count);
  node_of_.resize(dissection.order.size());
  std::vector<std::vector<uint32_t>> rows(count);  // below each front's own columns, rising
  for (uint32_t n = 0; n < count; ++n) {
    fronts_[n].first = nodes[n].first;
    fronts_[n].width = nodes[n].count;
    fronts_[n].parent = nodes[n].parent;
    for (uint32_t i = 0; i < nodes[n].count; ++i) node_of_[nodes[n].first + i] = n;
    if (nodes[n].parent != DissectionNode::kNone) fronts_[nodes[n].parent].children.push_back(n);
  }
  std::vector<std::vector<uint32_t>> own(count);  // edges by the front that eliminates them
  for (uint32_t e = 0; e < edges.size(); ++e) {
    const auto [low, high] = std::minmax(edges[e][0], edges[e][1]);
    rows[node_of_[low]].push_back(high);
    own[node_of_[low]].push_back(e);
  }
  for (uint32_t n = 0; n < count; ++n) {
    Front& front = fronts_[n];
    std::vector<uint32_t>& below = rows[n];
    for (const uint32_t child : front.children) below.insert(below.end(), rows[child].begin(), rows[child].end());
    std::sort(below.begin(), below.end());
    below.erase(std::unique(below.begin(), below.end()), below.end());
    below.erase(below.begin(), std::lower_bound(below.begin(), below.end(), front.first + front.width));
    front.height = front.width + static_cast<uint32_t>(below.size());
    front.ld = FrontFactor<float>::stride(front.height);
    front.rows = static_cast<uint32_t>(rows_.size());
    for (uint32_t i = 0; i < front.width; ++i) rows_.push_back(front.first + i);
    rows_.insert(rows_.end(), below.begin(), below.end());
    const double w = front.width, r = static_cast<double>(below.size());
    flops_ += w * w * w / 3 + w * w * r + w * r * r;
    front.panels = static_cast<uint32_t>(panels_.size());
    for (uint32_t at = 0; at < front.width; at += kPanelWidth) {
      Panel panel;
      panel.first = front.first + at;
      panel.width = std::min(kPanelWidth, front.width - at);
      panel.rows = front.rows + at + panel.width;
      panel.row_count = front.height - at - panel.width;
      panel.values = values_;
      values_ += size_t{panel.blocks()} * kPanelBlock * panel.width;
      highest_ = std::max(highest_, panel.blocks() * kPanelBlock);
      panels_.push_back(panel);
    }
    front.panel_count = static_cast<uint32_t>(panels_.size()) - front.panels;
  }
  const auto local = [&](const Front& front, uint32_t place) {
    const auto begin = rows_.begin() + front.rows;
    return static_cast<uint32_t>(std::lower_bound(begin, begin + front.height, place) - begin);
  };
  successors_.resize(count);
  waits_for_.assign(count, 0);
  for (uint32_t n = 0; n < count; ++n) {
    Front& front = fronts_[n];
    front.own = static_cast<uint32_t>(own_.size());
    front.own_count = static_cast<uint32_t>(own[n].size());
    for (const uint32_t e : own[n]) {
      const auto [low, high] = std::minmax(edges[e][0], edges[e][1]);
      own_.push_back({local(front, high), local(front, low), entries[e]});
    }
    front.to_parent = static_cast<uint32_t>(to_parent_.size());
    if (front.parent == DissectionNode::kNone) continue;
    for (const uint32_t place : rows[n]) to_parent_.push_back(local(fronts_[front.parent], place));
    successors_[n].push_back(static_cast<int>(front.parent));
    ++waits_for_[front.parent];
  }
}

void SparseCholesky::factor_front(const EnergyLanes& lanes, uint32_t n, std::span<const float> diagonal, const SparseCholesky* before,
                                  const std::vector<char>& changed) {
  const FactorPlan::Front& front = plan_->fronts_[n];
  const uint32_t ld = front.ld;
  thread_local std::vector<float> storage;
  storage.assign(size_t{ld} * front.height, 0.0f);
  float* a = storage.data();
  for (uint32_t i = 0; i < front.width; ++i) a[size_t{i} * ld + i] = diagonal[front.first + i];
  for (uint32_t k = front.own; k < front.own + front.own_count; ++k) {
    const FactorPlan::Own& own = plan_->own_[k];
    a[size_t{own.column} * ld + own.row] += own.entry;
  }
  for (const uint32_t c : front.children) {
    const FactorPlan::Front& child = plan_->fronts_[c];
    const uint32_t count = child.height - child.width;
    if (count == 0) continue;
    const uint32_t* to = plan_->to_parent_.data() + child.to_parent;
    const Buffer<float>& update = before && !changed[c] ? before->updates_[c] : updates_[c];
    const float* from = update.host().data();
    for (uint32_t j = 0; j < count; ++j, from += count) {
      float* column = a + size_t{to[j]} * ld;
      for (uint32_t i = j; i < count; ++i) column[to[i]] += from[i];
    }
  }
  if (!lanes.eliminate(a, ld, front.width, front.height))
    throw Error(ErrorCode::kInput, "the rest shape's stiffness matrix is not positive definite",
                "give the body a positive hold, or pin some of its vertices");
  for (uint32_t p = front.panels; p < front.panels + front.panel_count; ++p) {
    const Panel& panel = plan_->panels_[p];
    const uint32_t begin = panel.first - front.first;
    lanes.store_panel(a, ld, begin, begin + panel.width, front.height, values_.data_for_write() + panel.values);
  }
  const uint32_t below = front.height - front.width;
  updates_[n] = Buffer<float>(size_t{below} * below);
  float* out = updates_[n].data_for_write();
  for (uint32_t j = 0; j < below; ++j) std::copy_n(a + size_t{front.width + j} * ld + front.width, below, out + size_t{j} * below);
}

SparseCholesky::SparseCholesky(Executor& executor, const EnergyLanes& lanes, std::shared_ptr<const FactorPlan> plan, std::span<const float> diagonal)
    : plan_(std::move(plan)), diagonal_(diagonal.begin(), diagonal.end()), updates_(plan_->fronts_.size()), values_(plan_->values_) {
  executor.run_graph(plan_->successors_, plan_->waits_for_, [&](int n) { factor_front(lanes, static_cast<uint32_t>(n), diagonal, nullptr, {}); });
}

SparseCholesky::SparseCholesky(Executor& executor, const EnergyLanes& lanes, const SparseCholesky& before, std::span<const float> diagonal)
    : plan_(before.plan_), updates_(plan_->fronts_.size()), values_(plan_->values_) {
  const auto& fronts = plan_->fronts_;
  std::vector<char> changed(fronts.size(), 0);
  for (uint32_t p = 0; p < diagonal.size(); ++p)
    if (diagonal[p] != before.diagonal_[p]) changed[plan_->node_of_[p]] = 1;
  for (size_t n = 0; n < fronts.size(); ++n)
    if (changed[n] && fronts[n].parent != DissectionNode::kNone) changed[fronts[n].parent] = 1;
  const float* kept = before.values_.host().data();
  float* values = values_.data_for_write();
  executor.run_graph(plan_->successors_, plan_->waits_for_, [&](int task) {
    const uint32_t n = static_cast<uint32_t>(task);
    if (changed[n]) return factor_front(lanes, n, diagonal, &before, changed);
    for (uint32_t p = fronts[n].panels; p < fronts[n].panels + fronts[n].panel_count; ++p) {
      const Panel& panel = plan_->panels_[p];
      std::copy_n(kept + panel.values, size_t{panel.blocks()} * kPanelBlock * panel.width, values + panel.values);
    }
  });
}

void SparseCholesky::solve(const EnergyLanes& lanes, Row4* x, float* scratch) const {
  const FactorView view{plan_->panels_.data(), plan_->rows_.data(), values_.host().data()};
  lanes.solve_forward(view, 0, static_cast<uint32_t>(plan_->panels_.size()), x);
  lanes.solve_backward(view, 0, static_cast<uint32_t>(plan_->panels_.size()), x, scratch);
}

}  // namespace knead
