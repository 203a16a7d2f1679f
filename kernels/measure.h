// Figures about a deformed body: how good it is, as numbers.
#pragma once
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "graph/executor.h"
#include "kernels/port_types.h"

namespace knead {

class ExactDistance;

// Signed distances to the union of colliders, in world units. Exact against a collider's triangles where it has them, else trilinear samples of its
// grid. The colliders must outlive it.
class ColliderDistance {
 public:
  void add(const Sdf& sdf);                                              // sampled
  void add(const Sdf& sdf, std::shared_ptr<const ExactDistance> exact);  // null: sampled
  bool empty() const { return colliders_.empty(); }
  double operator()(const Vec3d& world) const;  // outside a collider's box the distance to the box stands for it; infinite without colliders
  size_t nearest(const Vec3d& world) const;     // the collider whose distance that is, in the order in which they were added

 private:
  struct Collider {
    const Sdf* sdf;
    std::shared_ptr<const ExactDistance> exact;
    Similarity to_local;
    double distance(const Vec3d& world) const;
  };
  std::vector<Collider> colliders_;
};

// World units.
struct Penetration {
  double vertices_max = 0, vertices_rms = 0, faces_max = 0;
  size_t vertices_inside = 0;
  Vec3d deepest_at{0, 0, 0};  // the place of the deepest of all points looked at; meaningless where nothing is inside
};

// Over M's vertices, and over a barycentric grid of at most `face_samples` points on every triangle, its corners among them (1: the centroid; 0:
// none).
Penetration measure_penetration(Executor& executor, const Surface& surface, const ColliderDistance& colliders, int face_samples);

// Enclosed by the triangles, positive when they face outwards; local units cubed, in double about the first vertex.
double signed_volume(Executor& executor, std::span<const Vec3f> points, std::span<const uint32_t> triangles);

// Largest distance of a vertex from where it was, world units. Both surfaces as they stand in the world.
double largest_displacement(Executor& executor, const Surface& before, const Surface& after);

struct TetFigures {
  double rest_volume = 0, volume = 0;        // cells^3
  size_t inverted = 0;                       // tets whose volume is not positive
  double stretch_mean = 0, stretch_max = 0;  // |L / L_rest - 1| over the edges
};
TetFigures measure_tets(Executor& executor, const Buffer<Vec3f>& points, const TetMesh& tets);

// Per vertex of M: the volume of H's tets about it over their rest volume, minus 1, interpolated through the lattice.
Buffer<float> volume_change(Executor& executor, const Buffer<Vec3f>& points, const TetMesh& tets, const Lattice& lattice);

}  // namespace knead
