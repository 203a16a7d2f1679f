#include "kernels/build_tets/cell_copies.h"

#include <algorithm>
#include <numeric>

#include "kernels/build_tets/cell_material.h"
#include "kernels/surface/triangle_box.h"

namespace knead {
namespace {

constexpr size_t kCellPiece = 256;  // cells per task

struct Face {
  uint32_t first, second;  // cells, as in CopyLink
  uint8_t face;
};

// f(Face) for every pair of kept cells that share a face, from the smaller one.
template <class F>
void each_face(const Octree& octree, const Cells& cells, size_t begin, size_t end, F&& f) {
  for (size_t c = begin; c < end; ++c) {
    const OctreeNode& at = octree.node(cells.nodes[c]);
    for (int face = 0; face < 6; ++face) {
      const int axis = face >> 1, step = (face & 1) != 0 ? 1 : -1;
      const uint32_t next = octree.find(at.level, int64_t{at.x} + (axis == 0 ? step : 0), int64_t{at.y} + (axis == 1 ? step : 0),
                                        int64_t{at.z} + (axis == 2 ? step : 0));
      if (next == Octree::kNone || cells.of_node[next] == Octree::kNone) continue;
      if (octree.node(next).level == at.level && step < 0) continue;
      f(Face{static_cast<uint32_t>(c), cells.of_node[next], static_cast<uint8_t>(face)});
    }
  }
}

struct Box {
  Vec3d lower, upper;
  bool touches(const Box& b) const {
    for (int k = 0; k < 3; ++k)
      if (lower[k] > b.upper[k] || upper[k] < b.lower[k]) return false;
    return true;
  }
};

Box box_of(const OctreeNode& node) {
  return {node.lower(), node.lower() + Vec3d{node.size(), node.size(), node.size()}};
}

Box face_box(const OctreeNode& node, int face) {
  Box box = box_of(node);
  const int axis = face >> 1;
  ((face & 1) != 0 ? box.lower : box.upper)[axis] = (face & 1) != 0 ? box.upper[axis] : box.lower[axis];
  return box;
}

class Splitter {
 public:
  Splitter(const Octree& octree, const Cells& cells, const SoftBody& body, const WindingNumber& winding, Executor& executor)
      : octree_(octree), cells_(cells), body_(body), winding_(winding), executor_(executor) {}

  Copies run() {
    cut();
    const std::vector<CopyLink> crossed = gathered([&](size_t begin, size_t end, std::vector<CopyLink>& out) {
      CellMaterial material(body_, winding_);
      each_face(octree_, cells_, begin, end, [&](const Face& face) { link_crossed(face, material, out); });
    });
    note_neighbours(crossed);
    copies_.links = gathered([&](size_t begin, size_t end, std::vector<CopyLink>& out) {
      each_face(octree_, cells_, begin, end, [&](const Face& face) { link_crack(face, out); });
    });
    copies_.links.insert(copies_.links.begin(), crossed.begin(), crossed.end());
    return std::move(copies_);
  }

 private:
  template <class F>
  std::vector<CopyLink> gathered(F&& f) {
    std::vector<std::vector<CopyLink>> found((cells_.count() + kCellPiece - 1) / kCellPiece);
    executor_.parallel_ranges(cells_.count(), kCellPiece, [&](size_t begin, size_t end) { f(begin, end, found[begin / kCellPiece]); });
    std::vector<CopyLink> links;
    for (const auto& piece : found) links.insert(links.end(), piece.begin(), piece.end());
    return links;
  }

  uint32_t copies_of(uint32_t cell) const { return copies_.first[cell + 1] - copies_.first[cell]; }

  // Pieces of every cell, numbered as copies.
  void cut() {
    copies_.first.assign(cells_.count() + 1, 0);
    copies_.entry_copy.resize(cells_.triangles.size());
    executor_.parallel_ranges(cells_.count(), kCellPiece, [&](size_t begin, size_t end) {
      CellMaterial material(body_, winding_);
      std::vector<uint32_t> piece;
      for (size_t c = begin; c < end; ++c) {
        copies_.first[c + 1] = material.pieces(octree_.node(cells_.nodes[c]), cells_.touching(c), kMostPatches, piece);
        std::copy(piece.begin(), piece.end(), copies_.entry_copy.begin() + cells_.offsets[c]);
      }
    });
    std::partial_sum(copies_.first.begin(), copies_.first.end(), copies_.first.begin());
    for (uint32_t c = 0; c < cells_.count(); ++c) {
      copies_.cell.insert(copies_.cell.end(), copies_of(c), c);
      for (uint32_t e = cells_.offsets[c]; e < cells_.offsets[c + 1]; ++e) copies_.entry_copy[e] += copies_.first[c];
    }
  }

  // The copy of a cell that holds a point of M's inside on its border, in a face that M does not touch.
  uint32_t copy_at(uint32_t cell, const Vec3d& inside, CellMaterial& material) const {
    if (copies_of(cell) == 1) return copies_.first[cell];
    return copies_.entry_copy[cells_.offsets[cell] + material.nearest_along(octree_.node(cells_.nodes[cell]), cells_.touching(cell), inside)];
  }

  // Material passes through the face: a triangle of M touches it, or it is inside as a whole.
  void link_crossed(const Face& face, CellMaterial& material, std::vector<CopyLink>& out) const {
    const auto a = cells_.touching(face.first), b = cells_.touching(face.second);
    const Box box = face_box(octree_.node(cells_.nodes[face.first]), face.face);
    const Vec3d middle = 0.5 * (box.lower + box.upper);
    const Vec3d half = 0.5 * (box.upper - box.lower) + Vec3d{kTouchSlack, kTouchSlack, kTouchSlack};
    const size_t before = out.size();
    const bool single = copies_of(face.first) == 1 && copies_of(face.second) == 1;
    for (size_t i = 0; i < a.size() && !b.empty() && !(single && out.size() > before); ++i) {
      const uint32_t* v = &body_.triangles[3 * size_t{a[i]}];
      if (!triangle_touches_box(body_.points[v[0]], body_.points[v[1]], body_.points[v[2]], middle, half)) continue;
      const auto other = std::lower_bound(b.begin(), b.end(), a[i]);  // lists are in order of triangles
      if (other == b.end() || *other != a[i]) continue;
      const CopyLink link{copies_.entry_copy[cells_.offsets[face.first] + i],
                          copies_.entry_copy[cells_.offsets[face.second] + static_cast<size_t>(other - b.begin())], face.face};
      const auto same = [&](const CopyLink& l) { return l.first == link.first && l.second == link.second; };
      if (std::none_of(out.begin() + static_cast<ptrdiff_t>(before), out.end(), same)) out.push_back(link);
    }
    std::sort(out.begin() + static_cast<ptrdiff_t>(before), out.end(),
              [](const CopyLink& x, const CopyLink& y) { return x.first != y.first ? x.first < y.first : x.second < y.second; });
    if (out.size() > before) return;
    if (!a.empty() && !b.empty() && !is_inside(winding_, middle)) return;
    out.push_back({copy_at(face.first, middle, material), copy_at(face.second, middle, material), face.face});
  }

  void note_neighbours(const std::vector<CopyLink>& links) {
    neighbour_offsets_.assign(copies_.count() + 1, 0);
    for (const CopyLink& link : links) {
      ++neighbour_offsets_[link.first + 1];
      ++neighbour_offsets_[link.second + 1];
    }
    std::partial_sum(neighbour_offsets_.begin(), neighbour_offsets_.end(), neighbour_offsets_.begin());
    neighbours_.resize(neighbour_offsets_.back());
    std::vector<uint32_t> next(neighbour_offsets_.begin(), neighbour_offsets_.end() - 1);
    for (const CopyLink& link : links) {
      neighbours_[next[link.first]++] = link.second;
      neighbours_[next[link.second]++] = link.first;
    }
  }
  std::span<const uint32_t> neighbours(uint32_t copy) const {
    return {neighbours_.data() + neighbour_offsets_[copy], neighbours_.data() + neighbour_offsets_[copy + 1]};
  }

  // No material passes through the face, but both sides hang together round one of its edges: without this, every cell that M only dips into would be
  // cut off from its like beside it.
  void link_crack(const Face& face, std::vector<CopyLink>& out) const {
    const Box box = face_box(octree_.node(cells_.nodes[face.first]), face.face);
    const auto near = [&](uint32_t copy) {
      const uint32_t cell = copies_.cell[copy];
      return cell != face.first && cell != face.second && box_of(octree_.node(cells_.nodes[cell])).touches(box);
    };
    const auto linked = [&](uint32_t a, uint32_t b) {
      const auto around = neighbours(a);
      return std::find(around.begin(), around.end(), b) != around.end();
    };
    for (uint32_t a = copies_.first[face.first]; a < copies_.first[face.first + 1]; ++a)
      for (uint32_t b = copies_.first[face.second]; b < copies_.first[face.second + 1]; ++b) {
        if (linked(a, b)) continue;
        bool round = false;
        for (const uint32_t x : neighbours(a)) {
          if (round || !near(x)) continue;
          round = linked(x, b);
          for (const uint32_t y : neighbours(x)) round = round || (near(y) && linked(y, b));
        }
        if (round) out.push_back({a, b, face.face});
      }
  }

  const Octree& octree_;
  const Cells& cells_;
  const SoftBody& body_;
  const WindingNumber& winding_;
  Executor& executor_;
  Copies copies_;
  std::vector<uint32_t> neighbour_offsets_, neighbours_;
};

}  // namespace

Copies whole_cells(const Octree& octree, const Cells& cells) {
  Copies copies;
  copies.first.resize(cells.count() + 1);
  std::iota(copies.first.begin(), copies.first.end(), 0u);
  copies.cell.assign(copies.first.begin(), copies.first.end() - 1);
  copies.entry_copy.resize(cells.triangles.size());
  for (uint32_t c = 0; c < cells.count(); ++c)
    std::fill(copies.entry_copy.begin() + cells.offsets[c], copies.entry_copy.begin() + cells.offsets[c + 1], c);
  each_face(octree, cells, 0, cells.count(), [&](const Face& face) { copies.links.push_back({face.first, face.second, face.face}); });
  return copies;
}

Copies split_cells(const Octree& octree, const Cells& cells, const SoftBody& body, const WindingNumber& winding, Executor& executor) {
  return Splitter(octree, cells, body, winding, executor).run();
}

}  // namespace knead
