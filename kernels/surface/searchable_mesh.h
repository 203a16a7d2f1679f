// The search structure over a mesh's triangles, as nodes share it between frames.
#pragma once
#include <memory>
#include <span>

#include "graph/node.h"
#include "graph/opaque_value.h"
#include "kernels/port_types.h"
#include "kernels/surface/mesh_distance.h"

namespace knead {

struct SearchableMesh {
  static constexpr const char* kOpaqueName = "SearchableMesh";
  std::shared_ptr<const MeshDistance> distance;
};

inline Value searchable_mesh(Context& context, const Surface& mesh) {
  const std::span<const uint32_t> triangles = mesh.topology->triangles;
  Hasher key;
  key.add("searchable_mesh").add(mesh.points.id()).bytes(triangles.data(), triangles.size_bytes());
  return context.once(key.key(),
                      [&] { return Value::of(SearchableMesh{std::make_shared<MeshDistance>(mesh.points.host(), triangles, &context.executor())}); });
}

// Of a collider of which more is known than its field; else null.
inline std::shared_ptr<const ExactDistance> searchable_mesh(Context& context, const Sdf& collider) {
  if (collider.distance || !collider.mesh) return collider.distance;
  return searchable_mesh(context, *collider.mesh).as<SearchableMesh>().distance;
}

}  // namespace knead
