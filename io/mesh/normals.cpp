// Which normals a writer puts out.
#include <cmath>
#include <map>
#include <tuple>
#include <unordered_map>

#include "graph/hash.h"
#include "io/mesh/raw_mesh.h"
#include "io/mesh/triangulate.h"

namespace knead::mesh {

namespace {

// The same normal may stand in the pool many times (programs that write one per corner); only its value tells smooth from sharp.
std::vector<int32_t> first_of_equal(const std::vector<Vec3f>& pool) {
  std::map<std::tuple<float, float, float>, int32_t> first;
  std::vector<int32_t> result(pool.size());
  for (size_t i = 0; i < pool.size(); ++i) result[i] = first.try_emplace({pool[i].x, pool[i].y, pool[i].z}, static_cast<int32_t>(i)).first->second;
  return result;
}

// Area-weighted over the faces that share both the vertex and the file's normal there: smooth where it was smooth, sharp where it was sharp.
CornerNormals recomputed(const Surface& surface) {
  const MeshTopology& topology = *surface.topology;
  const MeshAttributes& attributes = *surface.attributes;
  const std::vector<int32_t> canonical = first_of_equal(attributes.normals);
  std::unordered_map<uint64_t, int32_t> pool_of;
  std::vector<Vec3d> sums;
  CornerNormals result;
  result.corner_normal.assign(topology.corners(), -1);
  pool_of.reserve(attributes.normals.size());
  for (size_t face = 0; face < topology.faces(); ++face) {
    const uint32_t first = topology.face_offsets[face], last = topology.face_offsets[face + 1];
    const Vec3d area = area_vector(surface.points.host(), std::span(topology.face_vertices).subspan(first, last - first));
    for (uint32_t c = first; c < last; ++c) {
      const int32_t was = attributes.corner_normal[c];
      if (was < 0) continue;
      const uint64_t key = uint64_t{topology.face_vertices[c]} << 32 | static_cast<uint32_t>(canonical[static_cast<size_t>(was)]);
      const auto [it, added] = pool_of.try_emplace(key, static_cast<int32_t>(sums.size()));
      if (added) sums.push_back({0, 0, 0});
      sums[static_cast<size_t>(it->second)] += area;
      result.corner_normal[c] = it->second;
    }
  }
  for (const Vec3d& sum : sums) {
    // Scaled before it is squared, so that no size of mesh over- or underflows.
    const double largest = std::max({std::abs(sum.x), std::abs(sum.y), std::abs(sum.z)});
    const Vec3d scaled = largest > 0 ? sum * (1 / largest) : Vec3d{0, 0, 0};
    result.normals.push_back(largest > 0 ? to_float(scaled * (1 / length(scaled))) : Vec3f{0, 0, 0});
  }
  return result;
}

}  // namespace

CornerNormals normals_to_write(const Surface& surface, const WriteMeshOptions& options) {
  if (!surface.attributes || surface.attributes->normals.empty() || surface.attributes->corner_normal.size() != surface.topology->corners())
    return {};
  const auto points = surface.points.host();
  const bool fresh = !options.recompute_normals && surface.attributes->normals_of == Hasher().bytes(points.data(), points.size_bytes()).key();
  CornerNormals result = fresh ? CornerNormals{surface.attributes->normals, surface.attributes->corner_normal} : recomputed(surface);
  if (surface.placement.rotation != Similarity{}.rotation)
    for (Vec3f& n : result.normals) n = to_float(surface.placement.rotate(to_double(n)));
  return result;
}

}  // namespace knead::mesh
