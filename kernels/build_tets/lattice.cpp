#include "kernels/build_tets/lattice.h"

#include <algorithm>
#include <numeric>

namespace knead {
namespace {

constexpr size_t kPiece = 1024;

// The nearest kept cell to a point, best first down the octree.
class NearestCell {
 public:
  NearestCell(const Octree& octree, const Cells& cells) : octree_(octree), cells_(cells), holds_(octree.nodes().size(), 0) {
    for (size_t n = octree.nodes().size(); n-- > 0;) {  // children come after their parents
      const OctreeNode& node = octree.node(static_cast<uint32_t>(n));
      if (node.is_leaf()) holds_[n] = cells.of_node[n] != Octree::kNone;
      for (uint32_t child = 0; !node.is_leaf() && child < 8; ++child) holds_[n] |= holds_[node.first_child + child];
    }
  }

  uint32_t find(const Vec3d& p, Vec3d& nearest) const {
    double best = INFINITY;
    uint32_t cell = 0;
    visit(0, p, best, cell, nearest);
    return cell;
  }

 private:
  static Vec3d clamped(const OctreeNode& node, const Vec3d& p) {
    Vec3d q;
    const Vec3d lower = node.lower();
    for (int k = 0; k < 3; ++k) q[k] = std::clamp(p[k], lower[k], lower[k] + node.size());
    return q;
  }
  double distance(uint32_t index, const Vec3d& p) const { return length(clamped(octree_.node(index), p) - p); }

  void visit(uint32_t index, const Vec3d& p, double& best, uint32_t& cell, Vec3d& nearest) const {
    const OctreeNode& node = octree_.node(index);
    if (node.is_leaf()) {
      best = distance(index, p);
      cell = cells_.of_node[index];
      nearest = clamped(node, p);
      return;
    }
    std::array<std::pair<double, uint32_t>, 8> children;
    for (uint32_t child = 0; child < 8; ++child) children[child] = {distance(node.first_child + child, p), node.first_child + child};
    std::sort(children.begin(), children.end());
    for (const auto& [far, child] : children)
      if (holds_[child] && far < best) visit(child, p, best, cell, nearest);
  }

  const Octree& octree_;
  const Cells& cells_;
  std::vector<uint8_t> holds_;  // a kept cell somewhere below
};

// A cell's surface as a closed cage: its active slots but the centre, in slot units about (1, 1, 1).
struct Cage {
  std::vector<uint8_t> slots;
  std::vector<Vec3d> places;
  std::vector<std::array<uint8_t, 3>> triangles;

  Cage(uint32_t active, uint32_t octant) {
    std::array<uint8_t, 27> index{};
    for (uint8_t s = 0; s < 27; ++s) {
      if (s == kCentreSlot || (active >> s & 1) == 0) continue;
      index[s] = static_cast<uint8_t>(slots.size());
      slots.push_back(s);
      places.push_back(Vec3d{s % 3 - 1.0, s / 3 % 3 - 1.0, s / 9 - 1.0});
    }
    for (int face = 0; face < 6; ++face) {
      const FaceTriangles over = face_triangles(active, octant, face, 0);
      for (size_t i = 0; i < over.count; ++i) {
        std::array<uint8_t, 3> t{index[over.slots[i][0]], index[over.slots[i][1]], index[over.slots[i][2]]};
        if (dot(cross(places[t[1]] - places[t[0]], places[t[2]] - places[t[0]]), places[t[0]]) < 0) std::swap(t[1], t[2]);
        triangles.push_back(t);
      }
    }
  }
};

struct Tets {  // around the centre of each copy
  std::vector<uint32_t> offsets, tets;
  Tets(const RawTets& raw, size_t copies) : offsets(copies + 1, 0) {
    std::vector<uint32_t> copy_of(raw.places.size(), Octree::kNone);
    for (uint32_t copy = 0; copy < copies; ++copy) copy_of[raw.slot_vertices[27 * size_t{copy} + kCentreSlot]] = copy;
    const auto each = [&](auto&& f) {
      for (uint32_t t = 0; t < raw.tets.size(); ++t)
        for (const uint32_t v : raw.tets[t])
          if (copy_of[v] != Octree::kNone) f(copy_of[v], t);
    };
    each([&](uint32_t copy, uint32_t) { ++offsets[copy + 1]; });
    std::partial_sum(offsets.begin(), offsets.end(), offsets.begin());
    tets.resize(offsets.back());
    std::vector<uint32_t> next(offsets.begin(), offsets.end() - 1);
    each([&](uint32_t copy, uint32_t t) { tets[next[copy]++] = t; });
  }
};

struct Row {
  std::array<uint32_t, 27> indices;
  std::array<double, 27> weights;
  size_t count = 0;
  void add(uint32_t index, double weight) {
    indices[count] = index;
    weights[count++] = weight;
  }
};

class Weigher {
 public:
  Weigher(const Octree& octree, const Cells& cells, const Copies& copies, const RawTets& raw, LatticeKind kind)
      : octree_(octree),
        cells_(cells),
        copies_(copies),
        raw_(raw),
        kind_(kind),
        around_(raw, kind == LatticeKind::kBarycentric ? copies.count() : 0) {}

  Row row(uint32_t copy, const Vec3d& point) const {
    const OctreeNode& node = octree_.node(cells_.nodes[copies_.cell[copy]]);
    const uint32_t* vertex = &raw_.slot_vertices[27 * size_t{copy}];
    Vec3d inside = (1 / node.size()) * (point - node.lower());  // in the unit cube
    for (int k = 0; k < 3; ++k) inside[k] = std::clamp(inside[k], 0.0, 1.0);
    Row row;
    if (kind_ == LatticeKind::kBarycentric) {
      barycentric(copy, point, row);
    } else if (kind_ == LatticeKind::kTrilinear) {
      const auto weights = trilinear_coordinates(inside);
      for (int corner = 0; corner < 8; ++corner) row.add(vertex[corner_slot(corner)], weights[static_cast<size_t>(corner)]);
    } else {
      const Cage cage(raw_.active(copy), octant_of(node));
      std::array<double, 27> weights;
      mean_value_coordinates(cage.places, cage.triangles, 2.0 * inside - Vec3d{1, 1, 1}, std::span(weights).first(cage.slots.size()));
      for (size_t i = 0; i < cage.slots.size(); ++i) row.add(vertex[cage.slots[i]], weights[i]);
    }
    return row;
  }

 private:
  // The first of the cell's tets that holds the point; where rounding leaves it just outside all of them, the one it is least outside of.
  void barycentric(uint32_t copy, const Vec3d& point, Row& row) const {
    const double scale = std::ldexp(double{kPlaceUnit}, octree_.depth());
    const auto place = [&](uint32_t v) { return Vec3d{double(raw_.places[v][0]), double(raw_.places[v][1]), double(raw_.places[v][2])}; };
    const Vec3d p = scale * point;
    double best = -INFINITY;
    uint32_t chosen = 0;
    std::array<double, 4> weights{};
    for (uint32_t i = around_.offsets[copy]; i < around_.offsets[copy + 1] && best < -1e-12; ++i) {
      const auto& tet = raw_.tets[around_.tets[i]];
      const auto w = barycentric_coordinates(p, place(tet[0]), place(tet[1]), place(tet[2]), place(tet[3]));
      const double least = *std::min_element(w.begin(), w.end());
      if (least <= best) continue;
      best = least;
      chosen = around_.tets[i];
      weights = w;
    }
    for (size_t k = 0; k < 4; ++k) row.add(raw_.tets[chosen][k], weights[k]);
  }

  const Octree& octree_;
  const Cells& cells_;
  const Copies& copies_;
  const RawTets& raw_;
  LatticeKind kind_;
  Tets around_;
};

}  // namespace

std::vector<uint32_t> bind_vertices(const Octree& octree, const Cells& cells, const Copies& copies, const SoftBody& body, std::vector<Vec3d>& points,
                                    Executor& executor) {
  std::vector<uint32_t> copy_of(points.size(), Octree::kNone);
  executor.parallel_ranges(cells.count(), 256, [&](size_t begin, size_t end) {
    for (size_t c = begin; c < end; ++c) {
      const OctreeNode& node = octree.node(cells.nodes[c]);
      const Vec3d lower = node.lower(), upper = lower + Vec3d{node.size(), node.size(), node.size()};
      for (uint32_t e = cells.offsets[c]; e < cells.offsets[c + 1]; ++e)
        for (size_t k = 0; k < 3; ++k) {
          const uint32_t v = body.triangles[3 * size_t{cells.triangles[e]} + k];
          const Vec3d& p = body.points[v];
          const bool here = p.x >= lower.x && p.y >= lower.y && p.z >= lower.z && p.x < upper.x && p.y < upper.y && p.z < upper.z;
          if (here && copy_of[v] == Octree::kNone) copy_of[v] = copies.entry_copy[e];  // a vertex is in one leaf: no other task looks at it
        }
    }
  });
  if (std::find(copy_of.begin(), copy_of.end(), Octree::kNone) == copy_of.end()) return copy_of;
  const NearestCell nearest(octree, cells);
  executor.parallel_ranges(points.size(), kPiece, [&](size_t begin, size_t end) {
    for (size_t v = begin; v < end; ++v) {
      if (copy_of[v] != Octree::kNone) continue;
      const Vec3d p = points[v];
      copy_of[v] = copies.first[nearest.find(p, points[v])];
    }
  });
  return copy_of;
}

LatticeRows make_lattice_rows(const Octree& octree, const Cells& cells, const Copies& copies, const RawTets& raw, const std::vector<Vec3d>& points,
                              const std::vector<uint32_t>& copy_of_vertex, LatticeKind kind, Executor& executor) {
  struct Part {
    std::vector<uint32_t> counts, indices;
    std::vector<float> weights;
  };
  std::vector<Part> parts((points.size() + kPiece - 1) / kPiece);
  const Weigher weigher(octree, cells, copies, raw, kind);
  executor.parallel_ranges(points.size(), kPiece, [&](size_t begin, size_t end) {
    Part& part = parts[begin / kPiece];
    for (size_t v = begin; v < end; ++v) {
      const size_t before = part.indices.size();
      const Row row = weigher.row(copy_of_vertex[v], points[v]);
      append_row(std::span(row.indices).first(row.count), std::span(row.weights).first(row.count), part.indices, part.weights);
      part.counts.push_back(static_cast<uint32_t>(part.indices.size() - before));
    }
  });
  LatticeRows rows;
  rows.offsets.push_back(0);
  for (const Part& part : parts) {
    for (const uint32_t count : part.counts) rows.offsets.push_back(rows.offsets.back() + count);
    rows.indices.insert(rows.indices.end(), part.indices.begin(), part.indices.end());
    rows.weights.insert(rows.weights.end(), part.weights.begin(), part.weights.end());
  }
  return rows;
}

}  // namespace knead
