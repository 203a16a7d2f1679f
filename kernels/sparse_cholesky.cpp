#include "kernels/sparse_cholesky.h"

#include <Eigen/Dense>
#include <algorithm>
#include <string>

#include "graph/error.h"
#include "kernels/energy_lanes.h"

namespace knead {
namespace {

using Front = Eigen::MatrixXd;

struct Tree {
  std::vector<std::vector<uint32_t>> children;
  std::vector<std::vector<uint32_t>> rows;      // below each node's own columns, rising
  std::vector<uint32_t> node_of;                // by place
};

// Which rows each node's columns reach: those of its entries, and what its children hand on.
Tree make_tree(const Dissection& dissection, std::span<const std::array<uint32_t, 2>> edges) {
  const auto& nodes = dissection.nodes;
  Tree tree;
  tree.children.resize(nodes.size());
  tree.rows.resize(nodes.size());
  tree.node_of.resize(dissection.order.size());
  for (uint32_t n = 0; n < nodes.size(); ++n) {
    for (uint32_t i = 0; i < nodes[n].count; ++i) tree.node_of[nodes[n].first + i] = n;
    if (nodes[n].parent != DissectionNode::kNone) tree.children[nodes[n].parent].push_back(n);
  }
  for (const auto& [a, b] : edges) tree.rows[tree.node_of[std::min(a, b)]].push_back(std::max(a, b));
  for (uint32_t n = 0; n < nodes.size(); ++n) {
    std::vector<uint32_t>& rows = tree.rows[n];
    for (const uint32_t child : tree.children[n]) rows.insert(rows.end(), tree.rows[child].begin(), tree.rows[child].end());
    std::sort(rows.begin(), rows.end());
    rows.erase(std::unique(rows.begin(), rows.end()), rows.end());
    rows.erase(rows.begin(), std::lower_bound(rows.begin(), rows.end(), nodes[n].first + nodes[n].count));
  }
  return tree;
}

// Columns [begin, end) of a factored front become a panel's block.
void store_panel(const Front& l, uint32_t begin, uint32_t end, float* to) {
  const Eigen::Index width = end - begin, height = l.rows() - begin;
  Front b(height, width);
  b.topRows(width).setIdentity();
  l.block(begin, begin, width, width).triangularView<Eigen::Lower>().solveInPlace(b.topRows(width));
  b.bottomRows(height - width).noalias() = l.block(end, begin, height - width, width) * b.topRows(width).triangularView<Eigen::Lower>();
  const Eigen::Index blocks = (height + kPanelBlock - 1) / kPanelBlock;
  for (Eigen::Index block = 0; block < blocks; ++block)
    for (Eigen::Index j = 0; j < width; ++j)
      for (Eigen::Index k = 0; k < kPanelBlock; ++k) {
        const Eigen::Index i = block * kPanelBlock + k;
        *to++ = i < height ? static_cast<float>(b(i, j)) : 0.0f;
      }
}

}  // namespace

SparseCholesky::SparseCholesky(Executor& executor, const Dissection& dissection, std::span<const std::array<uint32_t, 2>> edges,
                               std::span<const double> entries, std::span<const double> diagonal) {
  const auto& nodes = dissection.nodes;
  const Tree tree = make_tree(dissection, edges);

  std::vector<uint32_t> first_panel(nodes.size() + 1, 0);
  size_t values = 0;
  uint32_t highest = 0;
  for (uint32_t n = 0; n < nodes.size(); ++n) {
    first_panel[n] = static_cast<uint32_t>(panels_.size());
    // Rows of the node's later columns, then its rows below: each panel's rows are a tail of that list.
    const uint32_t begin = static_cast<uint32_t>(rows_.size());
    for (uint32_t i = 0; i < nodes[n].count; ++i) rows_.push_back(nodes[n].first + i);
    rows_.insert(rows_.end(), tree.rows[n].begin(), tree.rows[n].end());
    for (uint32_t at = 0; at < nodes[n].count; at += kPanelWidth) {
      Panel panel;
      panel.first = nodes[n].first + at;
      panel.width = std::min(kPanelWidth, nodes[n].count - at);
      panel.rows = begin + at + panel.width;
      panel.row_count = static_cast<uint32_t>(rows_.size()) - panel.rows;
      panel.values = values;
      values += size_t{panel.blocks()} * kPanelBlock * panel.width;
      highest = std::max(highest, panel.blocks() * kPanelBlock);
      panels_.push_back(panel);
    }
  }
  first_panel[nodes.size()] = static_cast<uint32_t>(panels_.size());
  scratch_floats_ = 3 * size_t{highest};
  values_ = Buffer<float>(values);
  float* const out = values_.data_for_write();

  std::vector<std::vector<uint32_t>> own(nodes.size());  // edges by the node that eliminates them
  for (uint32_t e = 0; e < edges.size(); ++e) own[tree.node_of[std::min(edges[e][0], edges[e][1])]].push_back(e);
  std::vector<Front> updates(nodes.size());
  std::vector<std::vector<int>> successors(nodes.size());
  std::vector<int> waits_for(nodes.size(), 0);
  for (uint32_t n = 0; n < nodes.size(); ++n)
    if (nodes[n].parent != DissectionNode::kNone) {
      successors[n].push_back(static_cast<int>(nodes[n].parent));
      ++waits_for[nodes[n].parent];
    }
  executor.run_graph(successors, waits_for, [&](int task) {
    const uint32_t n = static_cast<uint32_t>(task);
    const DissectionNode& node = nodes[n];
    const std::vector<uint32_t>& rows = tree.rows[n];
    const auto local = [&](uint32_t place) -> Eigen::Index {
      if (place < node.first + node.count) return place - node.first;
      return node.count + (std::lower_bound(rows.begin(), rows.end(), place) - rows.begin());
    };
    const Eigen::Index width = node.count, height = width + static_cast<Eigen::Index>(rows.size());
    Front front = Front::Zero(height, height);  // lower half
    for (Eigen::Index i = 0; i < width; ++i) front(i, i) = diagonal[node.first + static_cast<uint32_t>(i)];
    for (const uint32_t e : own[n]) {
      const Eigen::Index i = local(edges[e][0]), j = local(edges[e][1]);
      front(std::max(i, j), std::min(i, j)) += entries[e];
    }
    for (const uint32_t child : tree.children[n]) {
      const std::vector<uint32_t>& from = tree.rows[child];
      std::vector<Eigen::Index> to(from.size());
      for (size_t i = 0; i < from.size(); ++i) to[i] = local(from[i]);
      for (size_t j = 0; j < from.size(); ++j)
        for (size_t i = j; i < from.size(); ++i) front(to[i], to[j]) += updates[child](static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j));
      updates[child] = Front();
    }
    Eigen::Ref<Front> corner = front.topLeftCorner(width, width);
    const Eigen::LLT<Eigen::Ref<Front>> llt(corner);
    if (llt.info() != Eigen::Success)
      throw Error(ErrorCode::kInput, "the rest shape's stiffness matrix is not positive definite", "give the body a positive hold, or pin some of its vertices");
    auto below = front.bottomLeftCorner(height - width, width);
    corner.triangularView<Eigen::Lower>().transpose().solveInPlace<Eigen::OnTheRight>(below);
    if (height > width) {
      updates[n] = front.bottomRightCorner(height - width, height - width);
      updates[n].selfadjointView<Eigen::Lower>().rankUpdate(below, -1.0);
    }
    for (uint32_t p = first_panel[n]; p < first_panel[n + 1]; ++p) {
      const uint32_t begin = panels_[p].first - node.first;
      store_panel(front, begin, begin + panels_[p].width, out + panels_[p].values);
    }
  });
}

void SparseCholesky::solve(const EnergyLanes& lanes, Row4* x, float* scratch) const {
  const FactorView view{panels_.data(), rows_.data(), values_.host().data()};
  lanes.solve_forward(view, 0, static_cast<uint32_t>(panels_.size()), x, scratch);
  lanes.solve_backward(view, 0, static_cast<uint32_t>(panels_.size()), x, scratch);
}

}  // namespace knead
