#include "kernels/build_tets/tet_rules.h"

#include <algorithm>

#include "graph/error.h"
#include "kernels/surface/disjoint_sets.h"

namespace knead {
namespace {

constexpr uint32_t kNone = Octree::kNone;
constexpr int kRing[8][2] = {{0, 0}, {1, 0}, {2, 0}, {2, 1}, {2, 2}, {1, 2}, {0, 2}, {0, 1}};

uint8_t face_slot(int face, int a, int b) {
  std::array<int, 3> at;
  const int axis = face >> 1;
  at[static_cast<size_t>(axis)] = 2 * (face & 1);
  at[static_cast<size_t>((axis + 1) % 3)] = a;
  at[static_cast<size_t>((axis + 2) % 3)] = b;
  return static_cast<uint8_t>(slot_at(at[0], at[1], at[2]));
}

bool is_active(uint32_t active, uint8_t slot) {
  return (active >> slot & 1) != 0;
}

uint32_t coordinate(const OctreeNode& node, int axis) {
  return axis == 0 ? node.x : axis == 1 ? node.y : node.z;
}

// Which quadrant of the larger neighbour's face a cell lies on.
uint32_t quadrant_of(const OctreeNode& small, int face) {
  const int axis = face >> 1;
  return (coordinate(small, (axis + 1) % 3) & 1) | (coordinate(small, (axis + 2) % 3) & 1) << 1;
}

class Builder {
 public:
  Builder(const Octree& octree, const Cells& cells, const Copies& copies, Executor& executor)
      : octree_(octree), cells_(cells), copies_(copies), executor_(executor), slots_(27 * copies.count()), partner_(24 * copies.count(), kNone) {}

  RawTets run(bool by_place) {
    for (const CopyLink& link : copies_.links) {
      unite_slots(link);
      join_if_free(link);
    }
    if (by_place) unite_places();
    number_vertices();
    emit_all();
    return std::move(raw_);
  }

 private:
  const OctreeNode& node(uint32_t copy) const { return octree_.node(cells_.nodes[copies_.cell[copy]]); }

  std::array<int32_t, 3> place(uint32_t copy, int slot) const {
    const OctreeNode& at = node(copy);
    const int32_t half = (kPlaceUnit / 2) << (octree_.depth() - at.level);
    return {half * (2 * static_cast<int32_t>(at.x) + slot % 3), half * (2 * static_cast<int32_t>(at.y) + slot / 3 % 3),
            half * (2 * static_cast<int32_t>(at.z) + slot / 9)};
  }

  void unite_slots(const CopyLink& link) {
    const OctreeNode &small = node(link.first), &other = node(link.second);
    const bool equal = small.level == other.level;
    const uint32_t quadrant = quadrant_of(small, link.face);
    for (int b = 0; b < 3; ++b)
      for (int a = 0; a < 3; ++a) {
        if (!equal && (a == 1 || b == 1)) continue;  // the middles of the small face are too fine for the larger cell
        const int c = equal ? a : static_cast<int>(quadrant & 1) + a / 2, d = equal ? b : static_cast<int>(quadrant >> 1) + b / 2;
        slots_.join(27 * link.first + face_slot(link.face, a, b), 27 * link.second + face_slot(link.face ^ 1, c, d));
      }
  }

  // Of the copies that hold together over a face, one pair shares tets across it; others share its vertices only, so that no triangle gets a third
  // tet.
  void join_if_free(const CopyLink& link) {
    const OctreeNode &small = node(link.first), &other = node(link.second);
    const uint32_t quadrant = small.level == other.level ? 0 : quadrant_of(small, link.face);
    uint32_t& mine = partner_[24 * size_t{link.first} + 4 * size_t{link.face}];
    uint32_t& theirs = partner_[24 * size_t{link.second} + 4 * size_t{link.face ^ 1u} + quadrant];
    if (mine != kNone || theirs != kNone) return;
    mine = link.second;
    theirs = link.first;
  }

  void unite_places() {
    std::vector<std::pair<uint64_t, uint32_t>> keyed;
    keyed.reserve(26 * copies_.count());
    for (uint32_t copy = 0; copy < copies_.count(); ++copy)
      for (int slot = 0; slot < 27; ++slot) {
        if (slot == kCentreSlot) continue;
        const auto at = place(copy, slot);
        keyed.emplace_back(static_cast<uint64_t>(at[0]) | static_cast<uint64_t>(at[1]) << 21 | static_cast<uint64_t>(at[2]) << 42,
                           27 * copy + static_cast<uint32_t>(slot));
      }
    std::sort(keyed.begin(), keyed.end());
    for (size_t i = 1; i < keyed.size(); ++i)
      if (keyed[i].first == keyed[i - 1].first) slots_.join(keyed[i].second, keyed[i - 1].second);
  }

  void number_vertices() {
    std::vector<uint32_t> vertex(slots_.size(), kNone);  // by root
    for (uint32_t copy = 0; copy < copies_.count(); ++copy)
      for (int corner = 0; corner < 9; ++corner) {
        const int slot = corner < 8 ? corner_slot(corner) : kCentreSlot;
        uint32_t& id = vertex[slots_.find(27 * copy + static_cast<uint32_t>(slot))];
        if (id != kNone) continue;
        id = static_cast<uint32_t>(raw_.places.size());
        raw_.places.push_back(place(copy, slot));
      }
    raw_.slot_vertices.resize(slots_.size());
    for (uint32_t s = 0; s < slots_.size(); ++s) raw_.slot_vertices[s] = vertex[slots_.find(s)];
  }

  struct Base {  // the triangle that a pyramid lays on a face
    std::array<uint32_t, 3> vertices;
    uint8_t side;
    uint32_t tet;
    bool same_as(const Base& b) const { return vertices == b.vertices && side == b.side; }
  };
  struct Emitted {
    std::vector<std::array<uint32_t, 4>> tets;
    std::vector<Base> bases;
  };

  void emit(Emitted& out, uint32_t a, uint32_t b, uint32_t c, uint32_t d) const {
    const auto& p = raw_.places;
    const int64_t volume = six_volumes(p[a], p[b], p[c], p[d]);
    if (volume == 0) throw Error(ErrorCode::kInternal, "build_tets made a flat tet");
    if (volume < 0) std::swap(c, d);
    out.tets.push_back({a, b, c, d});
  }

  void emit_copy(uint32_t copy, Emitted& out) const {
    const uint32_t* vertex = &raw_.slot_vertices[27 * size_t{copy}];
    const uint32_t active = raw_.active(copy), centre = vertex[kCentreSlot];
    const int level = node(copy).level;
    for (int face = 0; face < 6; ++face) {
      const uint32_t* partner = &partner_[24 * size_t{copy} + 4 * static_cast<size_t>(face)];
      if (partner[0] != kNone && node(partner[0]).level <= level) {
        if (node(partner[0]).level == level && (face & 1) == 0) continue;  // the other one's turn
        const uint32_t other = raw_.slot_vertices[27 * size_t{partner[0]} + kCentreSlot];
        const FaceRing ring = face_ring(active, face);
        for (size_t i = 0; i < ring.count; ++i) emit(out, centre, other, vertex[ring.slots[i]], vertex[ring.slots[(i + 1) % ring.count]]);
        continue;
      }
      uint32_t skipped = 0;
      for (uint32_t q = 0; q < 4; ++q) skipped |= (partner[q] != kNone ? 1u : 0u) << q;
      const FaceTriangles over = face_triangles(active, octant_of(node(copy)), face, skipped);
      for (size_t i = 0; i < over.count; ++i) {
        std::array<uint32_t, 3> base{vertex[over.slots[i][0]], vertex[over.slots[i][1]], vertex[over.slots[i][2]]};
        emit(out, centre, base[0], base[1], base[2]);
        std::sort(base.begin(), base.end());
        out.bases.push_back({base, static_cast<uint8_t>(face & 1), static_cast<uint32_t>(out.tets.size() - 1)});
      }
    }
  }

  void emit_all() {
    constexpr size_t kPiece = 512;
    std::vector<Emitted> emitted((copies_.count() + kPiece - 1) / kPiece);
    executor_.parallel_ranges(copies_.count(), kPiece, [&](size_t begin, size_t end) {
      for (size_t copy = begin; copy < end; ++copy) emit_copy(static_cast<uint32_t>(copy), emitted[begin / kPiece]);
    });
    std::vector<Base> bases;
    for (Emitted& piece : emitted) {
      for (Base& base : piece.bases) base.tet += static_cast<uint32_t>(raw_.tets.size());
      raw_.tets.insert(raw_.tets.end(), piece.tets.begin(), piece.tets.end());
      if (copies_.count() > cells_.count()) bases.insert(bases.end(), piece.bases.begin(), piece.bases.end());
    }
    part_bases(std::move(bases));
  }

  // Copies of one cell whose vertices have all come together in a face would lay the same triangle there from the same side. All but the first get a
  // vertex of their own in the triangle's inside.
  void part_bases(std::vector<Base> bases) {
    std::sort(bases.begin(), bases.end(), [](const Base& a, const Base& b) {
      return a.vertices != b.vertices ? a.vertices < b.vertices : a.side != b.side ? a.side < b.side : a.tet < b.tet;
    });
    for (size_t i = 1; i < bases.size(); ++i) {
      if (!bases[i].same_as(bases[i - 1])) continue;
      const auto [a, b, c] = bases[i].vertices;
      const std::array<uint32_t, 4> tet = raw_.tets[bases[i].tet];
      const uint32_t apex = *std::find_if(tet.begin(), tet.end(), [&](uint32_t v) { return v != a && v != b && v != c; });
      const uint32_t own = static_cast<uint32_t>(raw_.places.size());
      std::array<int32_t, 3> at;
      for (size_t k = 0; k < 3; ++k) at[k] = (2 * raw_.places[a][k] + raw_.places[b][k] + raw_.places[c][k]) / 4;
      raw_.places.push_back(at);
      Emitted three;
      emit(three, apex, own, a, b);
      emit(three, apex, own, b, c);
      emit(three, apex, own, c, a);
      raw_.tets[bases[i].tet] = three.tets[0];
      raw_.tets.insert(raw_.tets.end(), three.tets.begin() + 1, three.tets.end());
    }
  }

  const Octree& octree_;
  const Cells& cells_;
  const Copies& copies_;
  Executor& executor_;
  DisjointSets slots_;
  std::vector<uint32_t> partner_;  // [copy][face][quadrant]: the copy it shares tets with; one that is not smaller stands at quadrant 0
  RawTets raw_;
};

}  // namespace

FaceRing face_ring(uint32_t active, int face) {
  FaceRing ring;
  for (const auto& at : kRing) {
    const uint8_t slot = face_slot(face, at[0], at[1]);
    if (is_active(active, slot)) ring.slots[ring.count++] = slot;
  }
  return ring;
}

FaceTriangles face_triangles(uint32_t active, uint32_t octant, int face, uint32_t skipped) {
  std::array<std::array<int, 2>, 8> at;  // active places round the face
  size_t n = 0;
  for (const auto& p : kRing)
    if (is_active(active, face_slot(face, p[0], p[1]))) at[n++] = {p[0], p[1]};
  const auto slot = [&](size_t i) { return face_slot(face, at[i % n][0], at[i % n][1]); };
  const auto is_middle = [&](size_t i) { return at[i % n][0] == 1 || at[i % n][1] == 1; };
  FaceTriangles out;
  const uint8_t middle = face_slot(face, 1, 1);
  if (is_active(active, middle)) {
    for (size_t i = 0; i < n; ++i) {
      const auto &p = at[i], &q = at[(i + 1) % n];
      const uint32_t quadrant = (std::max(p[0], q[0]) == 2 ? 1u : 0u) | (std::max(p[1], q[1]) == 2 ? 2u : 0u);
      if ((is_middle(i) || is_middle(i + 1)) && (skipped >> quadrant & 1) != 0) continue;
      out.slots[out.count++] = {middle, slot(i), slot(i + 1)};
    }
    return out;
  }
  const int axis = face >> 1;
  const bool straight = (octant >> (axis + 1) % 3 & 1) == (octant >> (axis + 2) % 3 & 1);  // the diagonal from (0, 0) to (2, 2)
  size_t apex = straight ? 0 : 1;
  if (n > 4) {
    apex = n;
    for (size_t i = 0; i < n; ++i)
      if (is_middle(i) && (apex == n || at[i] < at[apex])) apex = i;
  }
  for (size_t i = 1; i + 1 < n; ++i) out.slots[out.count++] = {slot(apex), slot(apex + i), slot(apex + i + 1)};
  return out;
}

int64_t six_volumes(const std::array<int32_t, 3>& a, const std::array<int32_t, 3>& b, const std::array<int32_t, 3>& c,
                    const std::array<int32_t, 3>& d) {
  int64_t u[3], v[3], w[3];
  for (size_t k = 0; k < 3; ++k) {
    u[k] = int64_t{b[k]} - a[k];
    v[k] = int64_t{c[k]} - a[k];
    w[k] = int64_t{d[k]} - a[k];
  }
  return w[0] * (u[1] * v[2] - u[2] * v[1]) + w[1] * (u[2] * v[0] - u[0] * v[2]) + w[2] * (u[0] * v[1] - u[1] * v[0]);
}

uint32_t octant_of(const OctreeNode& node) {
  return (node.x & 1) | (node.y & 1) << 1 | (node.z & 1) << 2;
}

RawTets make_raw_tets(const Octree& octree, const Cells& cells, const Copies& copies, bool by_place, Executor& executor) {
  return Builder(octree, cells, copies, executor).run(by_place);
}

}  // namespace knead
