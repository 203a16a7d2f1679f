#include "kernels/nested_dissection.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace knead {
namespace {

constexpr std::array<double, 5> kCuts{0.5, 0.44, 0.56, 0.38, 0.62};  // tried along each axis, as shares of the vertices
constexpr size_t kManyVertices = 20000;                              // above this only the middle cuts are tried
constexpr size_t kWorthAsking = 1000;                                // vertices: parts above this ask whether to go on

class Dissector {
 public:
  Dissector(std::span<const Vec3f> points, std::span<const std::array<uint32_t, 2>> edges, uint32_t leaf, const std::function<void()>& check)
      : points_(points), check_(check), leaf_(std::max(leaf, 1u)), first_(points.size() + 1, 0), part_(points.size(), 0) {
    for (const auto& [a, b] : edges) ++first_[a + 1], ++first_[b + 1];
    for (size_t v = 0; v < points.size(); ++v) first_[v + 1] += first_[v];
    neighbours_.resize(first_.back());
    std::vector<uint32_t> cursor(first_.begin(), first_.end() - 1);
    for (const auto& [a, b] : edges) {
      neighbours_[cursor[a]++] = b;
      neighbours_[cursor[b]++] = a;
    }
  }

  Dissection run() {
    std::vector<uint32_t> all(points_.size());
    for (uint32_t v = 0; v < all.size(); ++v) all[v] = v;
    if (!all.empty()) dissect(all);
    return std::move(result_);
  }

 private:
  struct Cut {
    double cost = std::numeric_limits<double>::infinity();
    int axis = -1;
    float at = 0;
    bool upper = false;  // the separator is taken from the upper side
  };

  // Emits the node of `vertices` after those of its parts; returns its number.
  uint32_t dissect(std::vector<uint32_t>& vertices) {
    if (vertices.size() <= leaf_) return emit(vertices);
    if (check_ && vertices.size() > kWorthAsking) check_();
    const uint32_t part = ++parts_;
    for (const uint32_t v : vertices) part_[v] = part;
    const Cut cut = best_cut(vertices, part);
    if (cut.axis < 0) return emit(vertices);
    std::vector<uint32_t> lower, upper, separator;
    for (const uint32_t v : vertices) {
      const bool above = points_[v][cut.axis] >= cut.at;
      if (above == cut.upper && touches(v, part, cut, !above))
        separator.push_back(v);
      else
        (above ? upper : lower).push_back(v);
    }
    if (separator.empty()) {  // parts that do not touch: an empty node would join them for nothing, but parents must exist
      separator.push_back((upper.empty() ? lower : upper).back());
      (upper.empty() ? lower : upper).pop_back();
    }
    vertices = {};
    std::vector<uint32_t> children;
    for (std::vector<uint32_t>* half : {&lower, &upper})
      if (!half->empty()) children.push_back(dissect(*half));
    const uint32_t node = emit(separator);
    for (const uint32_t child : children) result_.nodes[child].parent = node;
    return node;
  }

  uint32_t emit(const std::vector<uint32_t>& vertices) {
    DissectionNode node;
    node.first = static_cast<uint32_t>(result_.order.size());
    node.count = static_cast<uint32_t>(vertices.size());
    result_.order.insert(result_.order.end(), vertices.begin(), vertices.end());
    result_.nodes.push_back(node);
    return static_cast<uint32_t>(result_.nodes.size() - 1);
  }

  bool touches(uint32_t v, uint32_t part, const Cut& cut, bool above) const {
    for (uint32_t e = first_[v]; e < first_[v + 1]; ++e) {
      const uint32_t n = neighbours_[e];
      if (part_[n] == part && (points_[n][cut.axis] >= cut.at) == above) return true;
    }
    return false;
  }

  // The plane with the fewest vertices to separate, among some that halve the part roughly.
  Cut best_cut(const std::vector<uint32_t>& vertices, uint32_t part) {
    Cut best;
    std::vector<float> along(vertices.size());
    for (int axis = 0; axis < 3; ++axis) {
      float last = std::numeric_limits<float>::quiet_NaN();
      for (size_t c = 0; c < (vertices.size() > kManyVertices ? 1 : kCuts.size()); ++c) {
        for (size_t i = 0; i < vertices.size(); ++i) along[i] = points_[vertices[i]][axis];
        const auto place = along.begin() + static_cast<ptrdiff_t>(kCuts[c] * static_cast<double>(along.size()));
        std::nth_element(along.begin(), place, along.end());
        Cut cut{0, axis, *place, false};
        if (cut.at == last) continue;
        last = cut.at;
        size_t above = 0, low_side = 0, high_side = 0;
        for (const uint32_t v : vertices) {
          const bool is_above = points_[v][axis] >= cut.at;
          above += is_above;
          if (touches(v, part, cut, !is_above)) ++(is_above ? high_side : low_side);
        }
        const size_t below = vertices.size() - above;
        if (above == 0 || below == 0) continue;
        cut.upper = high_side <= low_side;
        const double separator = static_cast<double>(std::min(low_side, high_side));
        const double halves[2] = {static_cast<double>(above), static_cast<double>(below)};
        const double balance = std::min(halves[0], halves[1]) / (halves[0] + halves[1]);
        cut.cost = (separator + 1) / std::pow(std::max(balance, 1e-3), 0.7);
        if (cut.cost < best.cost) best = cut;
      }
    }
    return best;
  }

  std::span<const Vec3f> points_;
  const std::function<void()>& check_;
  uint32_t leaf_, parts_ = 0;
  std::vector<uint32_t> first_, neighbours_, part_;
  Dissection result_;
};

}  // namespace

Dissection nested_dissection(std::span<const Vec3f> points, std::span<const std::array<uint32_t, 2>> edges, uint32_t leaf,
                             const std::function<void()>& check) {
  return Dissector(points, edges, leaf, check).run();
}

}  // namespace knead
