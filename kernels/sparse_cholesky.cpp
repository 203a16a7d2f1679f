#include "kernels/sparse_cholesky.h"

#include <algorithm>
#include <atomic>

#include "graph/error.h"
#include "kernels/energy_lanes.h"

namespace knead {
namespace {

constexpr uint32_t kAskEvery = 256;        // fronts between two questions whether to go on
constexpr size_t kLargeFront = 100000;     // entries: a front above this asks by itself
constexpr size_t kKeptStorage = 4u << 20;  // floats that a thread keeps for its next front
constexpr size_t kParts = 8;               // subtrees that are solved at once
constexpr double kWorthParting = 50000;    // entries of a subtree

}  // namespace

FactorPlan::FactorPlan(const Dissection& dissection, std::vector<std::array<uint32_t, 2>> edges, const std::function<void()>& check) {
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
  double largest = 0;
  for (uint32_t e = 0; e < edges.size(); ++e) {
    const auto [low, high] = std::minmax(edges[e][0], edges[e][1]);
    rows[node_of_[low]].push_back(high);
    own[node_of_[low]].push_back(e);
  }
  for (uint32_t n = 0; n < count; ++n) {
    if (check && n % kAskEvery == 0) check();
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
    bytes_ += sizeof(float) * r * r;
    largest = std::max(largest, static_cast<double>(front.ld) * front.height);
    front.panels = static_cast<uint32_t>(panels_.size());
    for (uint32_t at = 0; at < front.width; at += kPanelWidth) {
      Panel panel;
      panel.first = front.first + at;
      panel.width = std::min(kPanelWidth, front.width - at);
      panel.rows = front.rows + at + panel.width;
      panel.row_count = front.height - at - panel.width;
      values_ += size_t{panel.blocks()} * kPanelBlock * panel.width;
      highest_ = std::max(highest_, panel.blocks() * kPanelBlock);
      panels_.push_back(panel);
    }
    front.panel_count = static_cast<uint32_t>(panels_.size()) - front.panels;
  }
  bytes_ += sizeof(float) * (static_cast<double>(values_) + largest);
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
      own_.push_back({local(front, high), local(front, low), e});
    }
    front.to_parent = static_cast<uint32_t>(to_parent_.size());
    if (front.parent == DissectionNode::kNone) continue;
    for (const uint32_t place : rows[n]) to_parent_.push_back(local(fronts_[front.parent], place));
    successors_[n].push_back(static_cast<int>(front.parent));
    ++waits_for_[front.parent];
  }
  cut_into_parts();
}

// The subtree with the most entries is split until there are enough of them, or they are too small to be worth it.
void FactorPlan::cut_into_parts() {
  const size_t count = fronts_.size();
  std::vector<double> weight(count, 0);  // entries at and below
  std::vector<uint32_t> first(count);    // the first panel at or below
  std::vector<uint32_t> open;
  for (uint32_t n = 0; n < count; ++n) {
    const Front& front = fronts_[n];
    weight[n] += static_cast<double>(front.width) * front.height;
    first[n] = front.children.empty() ? front.panels : first[front.children.front()];
    if (front.parent == DissectionNode::kNone)
      open.push_back(n);
    else
      weight[front.parent] += weight[n];
  }
  std::vector<char> above(count, 0);
  const auto lighter = [&](uint32_t a, uint32_t b) { return weight[a] != weight[b] ? weight[a] < weight[b] : a < b; };
  while (!open.empty() && open.size() < kParts) {
    const auto heaviest = std::max_element(open.begin(), open.end(), lighter);
    const uint32_t n = *heaviest;
    if (weight[n] < kWorthParting || fronts_[n].children.empty()) break;
    above[n] = 1;
    open.erase(heaviest);
    open.insert(open.end(), fronts_[n].children.begin(), fronts_[n].children.end());
  }
  std::vector<uint32_t> place_above(node_of_.size(), DissectionNode::kNone);
  for (uint32_t n = 0; n < count; ++n) {
    if (!above[n]) continue;
    for (uint32_t i = 0; i < fronts_[n].width; ++i) {
      place_above[fronts_[n].first + i] = static_cast<uint32_t>(top_places_.size());
      top_places_.push_back(fronts_[n].first + i);
    }
    rest_.push_back({fronts_[n].panels, fronts_[n].panels + fronts_[n].panel_count});
  }
  std::sort(open.begin(), open.end());
  part_rows_ = rows_;
  const uint32_t behind = (size() + 15) / 16 * 16;
  for (uint32_t part = 0; part < open.size(); ++part) {
    const Front& root = fronts_[open[part]];
    parts_.push_back({first[open[part]], root.panels + root.panel_count});
    for (uint32_t k = panels_[parts_[part].begin].rows; k < root.rows + root.height; ++k)
      if (place_above[rows_[k]] != DissectionNode::kNone)
        part_rows_[k] = behind + part * static_cast<uint32_t>(top_places_.size()) + place_above[rows_[k]];
  }
}

void SparseCholesky::factor_front(const EnergyLanes& lanes, uint32_t n, const SparseCholesky* before, const std::vector<char>& changed) {
  const FactorPlan::Front& front = plan_->fronts_[n];
  const uint32_t ld = front.ld;
  thread_local std::vector<float> storage;
  storage.assign(size_t{ld} * front.height, 0.0f);
  float* a = storage.data();
  for (uint32_t i = 0; i < front.width; ++i) a[size_t{i} * ld + i] = diagonal_[front.first + i];
  for (uint32_t k = front.own; k < front.own + front.own_count; ++k) {
    const FactorPlan::Own& own = plan_->own_[k];
    a[size_t{own.column} * ld + own.row] += (*entries_)[own.edge];
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
    lanes.store_panel(a, ld, begin, begin + panel.width, front.height, panel_values_[p]);
  }
  const uint32_t below = front.height - front.width;
  updates_[n] = Buffer<float>(size_t{below} * below);
  float* out = updates_[n].data_for_write();
  for (uint32_t j = 0; j < below; ++j) std::copy_n(a + size_t{front.width + j} * ld + front.width + j, below - j, out + size_t{j} * below + j);
  if (storage.size() > kKeptStorage) storage = {};
}

void SparseCholesky::make(Executor& executor, const EnergyLanes& lanes, const SparseCholesky* before, const std::vector<char>& changed,
                          const std::function<void()>& check) {
  const auto& fronts = plan_->fronts_;
  const auto entries = [&](uint32_t p) { return size_t{plan_->panels_[p].blocks()} * kPanelBlock * plan_->panels_[p].width; };
  const auto anew = [&](size_t n) { return !before || changed[n]; };
  size_t own = 0;
  for (size_t n = 0; n < fronts.size(); ++n)
    for (uint32_t p = fronts[n].panels; anew(n) && p < fronts[n].panels + fronts[n].panel_count; ++p) own += entries(p);
  values_ = Buffer<float>(own);
  panel_values_.resize(plan_->panels_.size());
  float* next = values_.data_for_write();
  for (size_t n = 0; n < fronts.size(); ++n)
    for (uint32_t p = fronts[n].panels; p < fronts[n].panels + fronts[n].panel_count; ++p) {
      panel_values_[p] = anew(n) ? next : before->panel_values_[p];
      if (anew(n)) next += entries(p);
    }
  executor.run_graph(plan_->successors_, plan_->waits_for_, [&](int task) {
    const auto n = static_cast<uint32_t>(task);
    if (!anew(n)) return;
    if (check && (n % kAskEvery == 0 || size_t{fronts[n].ld} * fronts[n].height > kLargeFront)) check();
    factor_front(lanes, n, before, changed);
  });
}

SparseCholesky::SparseCholesky(Executor& executor, const EnergyLanes& lanes, std::shared_ptr<const FactorPlan> plan, std::span<const float> entries,
                               std::span<const float> diagonal, const std::function<void()>& check)
    : plan_(std::move(plan)),
      entries_(std::make_shared<const std::vector<float>>(entries.begin(), entries.end())),
      diagonal_(diagonal.begin(), diagonal.end()),
      updates_(plan_->fronts_.size()) {
  make(executor, lanes, nullptr, {}, check);
}

SparseCholesky::SparseCholesky(Executor& executor, const EnergyLanes& lanes, const SparseCholesky& before, std::span<const float> diagonal,
                               const std::function<void()>& check)
    : plan_(before.plan_),
      entries_(before.entries_),
      diagonal_(diagonal.begin(), diagonal.end()),
      updates_(plan_->fronts_.size()),
      shared_(before.values_) {
  const auto& fronts = plan_->fronts_;
  std::vector<char> changed(fronts.size(), 0);
  for (uint32_t p = 0; p < diagonal.size(); ++p)
    if (diagonal[p] != before.diagonal_[p]) changed[plan_->node_of_[p]] = 1;
  for (size_t n = 0; n < fronts.size(); ++n)
    if (changed[n] && fronts[n].parent != DissectionNode::kNone) changed[fronts[n].parent] = 1;
  make(executor, lanes, &before, changed, check);
}

void SparseCholesky::solve(Executor& executor, const EnergyLanes& lanes, Row4* x, float* scratch) const {
  const FactorPlan& plan = *plan_;
  const FactorView parts{plan.panels_.data(), plan.part_rows_.data(), panel_values_.data()};
  const FactorView whole{plan.panels_.data(), plan.rows_.data(), panel_values_.data()};
  const size_t top = plan.top_places_.size(), scratch_each = 3 * size_t{plan.highest_};
  Row4* behind = x + (plan.size() + 15) / 16 * 16;
  executor.parallel_ranges(plan.parts_.size(), 1, [&](size_t part, size_t) {
    std::fill_n(behind + part * top, top, Row4{0, 0, 0, 0});
    lanes.solve_forward(parts, plan.parts_[part].begin, plan.parts_[part].end, x);
  });
  for (size_t i = 0; i < top; ++i) {
    Row4& to = x[plan.top_places_[i]];
    for (size_t part = 0; part < plan.parts_.size(); ++part) {
      const Row4& from = behind[part * top + i];
      to = {to.x + from.x, to.y + from.y, to.z + from.z, 0};
    }
  }
  for (const FactorPlan::Part& run : plan.rest_) lanes.solve_forward(whole, run.begin, run.end, x);
  for (auto run = plan.rest_.rbegin(); run != plan.rest_.rend(); ++run) lanes.solve_backward(whole, run->begin, run->end, x, scratch);
  executor.parallel_ranges(plan.parts_.size(), 1, [&](size_t part, size_t) {
    lanes.solve_backward(whole, plan.parts_[part].begin, plan.parts_[part].end, x, scratch + (part + 1) * scratch_each);
  });
}

}  // namespace knead
