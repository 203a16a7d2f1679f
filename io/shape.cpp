#include "io/shape.h"

#include <fmt/format.h>
#include <nanovdb/NanoVDB.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "kernels/port_types.h"
#include "kernels/surface/disjoint_sets.h"

namespace knead {
namespace {

std::string counted(size_t count, const char* what) {
  return fmt::format("{} {}{}", count, what, count == 1 ? "" : "s");
}

size_t pieces_of(const Surface& surface) {
  DisjointSets sets(surface.vertices());
  std::vector<char> used(surface.vertices());
  const std::vector<uint32_t>& triangles = surface.topology->triangles;
  for (size_t t = 0; t < triangles.size(); t += 3) {
    sets.join(triangles[t], triangles[t + 1]);
    sets.join(triangles[t], triangles[t + 2]);
  }
  for (const uint32_t v : triangles) used[v] = true;
  size_t pieces = 0;
  for (uint32_t v = 0; v < used.size(); ++v) pieces += used[v] && sets.find(v) == v;
  return pieces;
}

struct FieldCounts {
  size_t voxels = 0;  // with a value of their own
  size_t pieces = 0;  // of those inside, by the voxels' faces
};

FieldCounts counts_of(const Sdf& sdf) {
  const auto& tree = reinterpret_cast<const nanovdb::NanoGrid<float>*>(sdf.grid.host().data())->tree();
  constexpr uint32_t kLeafVoxels = 512;
  FieldCounts counts;
  const uint32_t leaves = tree.nodeCount(0);
  if (leaves == 0) return counts;
  const auto* first = tree.getFirstLeaf();
  DisjointSets sets(size_t{leaves} * kLeafVoxels);
  std::vector<char> inside(sets.size());
  for (uint32_t at = 0; at < inside.size(); ++at) {
    const auto& leaf = first[at / kLeafVoxels];
    const bool active = leaf.isActive(at % kLeafVoxels);
    counts.voxels += active;
    inside[at] = active && leaf.getValue(at % kLeafVoxels) < 0;
  }
  const auto reader = tree.getAccessor();
  for (uint32_t at = 0; at < inside.size(); ++at) {
    if (!inside[at]) continue;
    const nanovdb::Coord ijk = first[at / kLeafVoxels].offsetToGlobalCoord(at % kLeafVoxels);
    for (int axis = 0; axis < 3; ++axis) {
      nanovdb::Coord next = ijk;
      ++next[axis];
      const auto* leaf = reader.probeLeaf(next);
      if (!leaf) continue;
      const uint32_t other = static_cast<uint32_t>(leaf - first) * kLeafVoxels + leaf->CoordToOffset(next);
      if (inside[other]) sets.join(at, other);
    }
  }
  for (uint32_t at = 0; at < inside.size(); ++at) counts.pieces += inside[at] && sets.find(at) == at;
  return counts;
}

Box box_of(const Surface& surface, const Similarity& placement) {
  Box box;
  const auto points = surface.points.host();
  if (surface.topology)
    for (const uint32_t v : surface.topology->triangles) box.add(placement.apply(to_double(points[v])));
  return box;
}

Box box_of(const Sdf& sdf) {
  if (sdf.mesh) return box_of(*sdf.mesh, sdf.placement);
  Box box;
  const Vec3f ends[] = {sdf.lower, sdf.upper};
  for (int corner = 0; corner < 8; ++corner) box.add(sdf.placement.apply({ends[corner & 1].x, ends[corner >> 1 & 1].y, ends[corner >> 2].z}));
  return box;
}

}  // namespace

void Box::add(const Vec3d& point) {
  for (int k = 0; k < 3; ++k) {
    lower[k] = std::min(lower[k], point[k]);
    upper[k] = std::max(upper[k], point[k]);
  }
}

bool Box::holds(const Box& other) const {
  bool inside = true;
  for (int k = 0; k < 3; ++k) inside = inside && lower[k] <= other.lower[k] && other.upper[k] <= upper[k];
  return inside;
}

double Box::diagonal() const {
  return empty() ? 0 : length(upper - lower);
}

double gap_between(const Box& a, const Box& b) {
  Vec3d gap{0, 0, 0};
  for (int k = 0; k < 3; ++k) gap[k] = std::max({0.0, a.lower[k] - b.upper[k], b.lower[k] - a.upper[k]});
  return length(gap);
}

Box box_of(const Value& value) {
  if (const Surface* surface = value.get_if<Surface>()) return box_of(*surface, surface->placement);
  if (const Sdf* sdf = value.get_if<Sdf>()) return box_of(*sdf);
  return {};
}

std::string contents_of(const Value& value) {
  if (const Surface* surface = value.get_if<Surface>(); surface && surface->topology)
    return fmt::format("mesh of {} vertices, {}, {}", surface->vertices(), counted(surface->topology->faces(), "face"),
                       counted(pieces_of(*surface), "piece"));
  if (const Sdf* sdf = value.get_if<Sdf>()) {
    const FieldCounts counts = counts_of(*sdf);
    return fmt::format("field of {} voxels, {:.4g} wide, {}", counts.voxels, sdf->voxel_size * sdf->placement.scale, counted(counts.pieces, "piece"));
  }
  return {};
}

}  // namespace knead
