// What is unusual about a surface as the border of a solid.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include "graph/cancel.h"
#include "io/mesh/crossings.h"
#include "io/mesh/raw_mesh.h"
#include "kernels/surface/disjoint_sets.h"
#include "kernels/surface/edges.h"
#include "kernels/surface/volume.h"
#include "kernels/surface/weld.h"

namespace knead {

using mesh::counted;

namespace {

struct Findings {
  size_t boundary_edges = 0, crowded_edges = 0, disagreeing_edges = 0, pinched_vertices = 0, pieces = 0, inverted_pieces = 0, duplicates = 0;
  double volume = 0, box_volume = 0;
};

// Faces with fewer than three different corners have no edges that mean anything.
bool is_collapsed(const MeshTopology& topology, size_t face) {
  const uint32_t first = topology.face_offsets[face], count = topology.face_offsets[face + 1] - first;
  if (count != 3) return count < 3;
  const uint32_t* v = &topology.face_vertices[first];
  return v[0] == v[1] || v[1] == v[2] || v[2] == v[0];
}

EdgeUses edge_uses(const MeshTopology& topology, size_t vertices) {
  return EdgeUses(
      vertices,
      [&](auto&& walk) {
        for (size_t face = 0; face < topology.faces(); ++face) {
          if (is_collapsed(topology, face)) continue;
          const uint32_t first = topology.face_offsets[face], last = topology.face_offsets[face + 1];
          for (uint32_t c = first; c < last; ++c) {
            const uint32_t next = c + 1 == last ? first : c + 1;
            walk(topology.face_vertices[c], topology.face_vertices[next], c, next);
          }
        }
      },
      nullptr);
}

void examine_edges(const MeshTopology& topology, size_t vertices, Findings& found) {
  DisjointSets fans(topology.corners());
  edge_uses(topology, vertices).each_edge([&](uint32_t, std::span<const EdgeUse> uses) {
    const auto low = [](const EdgeUse& use) { return use.forward ? use.corner : use.next; };
    const auto high = [](const EdgeUse& use) { return use.forward ? use.next : use.corner; };
    for (const EdgeUse& use : uses) {
      fans.join(low(uses[0]), low(use));
      fans.join(high(uses[0]), high(use));
    }
    found.boundary_edges += uses.size() == 1;
    found.crowded_edges += uses.size() > 2;
    found.disagreeing_edges += uses.size() == 2 && net_use(uses) != 0;
  });
  std::vector<uint8_t> fans_at(vertices, 0);
  for (size_t face = 0; face < topology.faces(); ++face) {
    if (is_collapsed(topology, face)) continue;
    for (uint32_t c = topology.face_offsets[face]; c < topology.face_offsets[face + 1]; ++c)
      if (uint8_t& count = fans_at[topology.face_vertices[c]]; fans.find(c) == c && count < 2) found.pinched_vertices += ++count == 2;
  }
}

void examine_pieces(const Surface& surface, Findings& found) {
  const MeshTopology& topology = *surface.topology;
  const auto points = surface.points.host();
  DisjointSets pieces(points.size());
  for (size_t face = 0; face < topology.faces(); ++face)
    for (uint32_t c = topology.face_offsets[face] + 1; c < topology.face_offsets[face + 1]; ++c)
      pieces.join(topology.face_vertices[c - 1], topology.face_vertices[c]);
  const Vec3d centre = 0.5 * (to_double(surface.lower) + to_double(surface.upper));
  std::vector<double> volumes(points.size(), 0);
  for (size_t t = 0; t < topology.triangle_count(); ++t) {
    const uint32_t* v = &topology.triangles[3 * t];
    const double volume = volume_part(points, v, centre);
    volumes[pieces.find(v[0])] += volume;
    found.volume += volume;
  }
  std::vector<uint8_t> counted_already(points.size(), 0);
  for (uint32_t v : topology.face_vertices) {
    const uint32_t root = pieces.find(v);
    if (std::exchange(counted_already[root], uint8_t{1})) continue;
    ++found.pieces;
    found.inverted_pieces += volumes[root] < 0;
  }
  const Vec3d size = to_double(surface.upper) - to_double(surface.lower);
  found.box_volume = size.x * size.y * size.z;
}

size_t count_duplicates(std::span<const Vec3f> points) {
  const std::vector<uint32_t> first = first_at_same_place(points);
  size_t duplicates = 0;
  for (size_t i = 0; i < first.size(); ++i) duplicates += first[i] != i;
  return duplicates;
}

std::string rounded(double v) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", v);
  return text;
}

}  // namespace

std::vector<std::string> describe_problems(const Surface& surface) {
  std::vector<std::string> problems;
  if (!surface.topology || surface.topology->faces() == 0) return {"empty: there are no faces"};
  Findings found;
  examine_edges(*surface.topology, surface.vertices(), found);
  check_cancelled();
  examine_pieces(surface, found);
  check_cancelled();
  found.duplicates = count_duplicates(surface.points.host());

  if (found.duplicates > 0)
    problems.push_back(counted(found.duplicates, "vertex lies", "vertices lie") + " exactly where another does" +
                       (found.boundary_edges > 0 ? "; faces that only touch there are taken as not joined (weld: true joins them)" : ""));
  if (found.boundary_edges > 0)
    problems.push_back("open: " + counted(found.boundary_edges, "boundary edge", "boundary edges") +
                       "; the inside is taken from the generalised winding number");
  if (found.crowded_edges > 0)
    problems.push_back("non-manifold: " + counted(found.crowded_edges, "edge has", "edges have") +
                       " more than two faces; the inside is taken from the generalised winding number");
  if (found.pinched_vertices > 0)
    problems.push_back("non-manifold: " + counted(found.pinched_vertices, "vertex joins", "vertices join") +
                       " parts of the surface that share no edge; they move as one there");
  const double cube = std::pow(surface.placement.scale, 3);
  const bool oriented = found.disagreeing_edges == 0 && found.crowded_edges == 0;
  const bool inside_out = oriented && found.volume < (found.boundary_edges == 0 ? 0 : -1e-3 * found.box_volume);
  if (found.disagreeing_edges > 0)
    problems.push_back(
        "inconsistent orientation: " + counted(found.disagreeing_edges, "edge has", "edges have") +
        " faces that disagree about which side is out; the inside is a guess there, so make the normals consistent where the mesh was made");
  if (inside_out)
    problems.push_back("inside-out: the signed volume is " + rounded(found.volume * cube) +
                       "; the enclosed side is taken as the inside all the same");
  if (const mesh::Crossings crossings = mesh::count_crossings(surface); crossings.pairs > 0)
    problems.push_back("self-intersecting: " + std::string(crossings.complete ? "" : "at least ") +
                       counted(crossings.pairs, "pair of triangles passes through one another", "pairs of triangles pass through one another") +
                       "; parts that overlap share tets and move as one");
  if (found.pieces > 1) {
    const bool cavities = oriented && !inside_out && found.boundary_edges == 0 && found.inverted_pieces > 0;
    problems.push_back(std::to_string(found.pieces) + " separate pieces" +
                       (cavities ? ", " + counted(found.inverted_pieces, "of them turned inwards and taken as a cavity",
                                                  "of them turned inwards and taken as cavities")
                                 : "") +
                       "; each deforms with the tets it lies in");
  }
  return problems;
}

}  // namespace knead
