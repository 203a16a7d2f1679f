// Fields that know the body they will meet. A field with as many voxels along its collider wherever that is can be far too coarse for a body that is much smaller:
// a floor's voxels are then as large as the body. So those who press a body ask for fields near it: voxels as fine as the body's own edges, where collider and
// body can meet, sampled from what is known exactly, in a space whose origin is near the body, so that float32 holds small places beside a large collider.
#pragma once
#include <optional>
#include <span>
#include <vector>

#include "graph/node.h"
#include "kernels/port_types.h"

namespace knead {

struct NearBody {
  Similarity placement;  // of M
  Vec3d lower, upper;    // M's box at rest, local space
  double edge = 0;       // about as long as M's edges, local units
  double reach = 0;      // how far outside a collider forces begin, local units
  double diagonal() const { return length(upper - lower); }
};

// `reach`: local units of M.
NearBody near_body(const Surface& body, double reach);

// Whether all of the field that the body can meet is there, with voxels that are fine enough.
bool knows(const Sdf& field, const NearBody& body);

// Where a field near the body has to know its collider, in the collider's local space, and by what voxels. `distance` and `mesh` as Sdf has them.
struct NearRegion {
  Vec3d lower, upper;
  double voxel_size;    // no coarser than this, and
  double finest_voxel;  // no finer is of use
  // The collider is thinner than such voxels can hold, and goes right across where the body is: what is behind it, seen from the body, is taken for inside.
  bool is_plate = false;
};
NearRegion region_near(const Similarity& placement, const ExactDistance& distance, const Surface* mesh, const NearBody& body);

// The field of a collider with a `distance` where the body can meet it, in a space of its own: its placement is to the collider's local space. Without distance and
// mesh, which are in the collider's.
Sdf field_near(Executor& executor, const Sdf& collider, const NearBody& body);

// What presses a body, for a node that runs on any device: the colliders as they are given, or fields near the body in their stead, made once for as long as
// the two keep their places.
class NearFields {
 public:
  // Warns of fields that are too coarse and of which nothing exact is known; not where `warn` is false.
  NearFields(Context& context, std::span<const Sdf* const> colliders, const NearBody& body, bool warn = true);
  NearFields(const NearFields&) = delete;
  NearFields& operator=(const NearFields&) = delete;

  bool any_made() const { return !made_.empty(); }
  std::span<const Sdf* const> colliders() const { return colliders_; }  // grids on the executor's device
  std::vector<Sdf> copies() const;
  const std::optional<Sdf>& on_host(size_t k) const { return on_host_[k]; }  // none: it is as it is given

 private:
  Sdf near(Context& context, const Sdf& collider, const NearBody& body);

  std::vector<Value> kept_;  // what lives in the cache
  std::vector<Sdf> made_;
  std::vector<const Sdf*> colliders_;
  std::vector<std::optional<Sdf>> on_host_;
};

}  // namespace knead
