// Pushes a body's vertices out of colliders. The colliders stay separate grids: at each vertex the one that it is deepest in decides.
#pragma once
#include <cstdint>
#include <span>

#include "graph/executor.h"
#include "kernels/port_types.h"

namespace knead {

class ExactDistance;
struct ColliderView;

// A collider as kernel bodies see it from a body whose local space is placed so; valid while the Sdf's grid lives.
ColliderView view_collider(const Sdf& sdf, Device device, const Similarity& body);

// Throws Error(kInput) when the margin (local units of the body) is beyond the collider's band; `which` counts from 0.
void check_margin(const Sdf& sdf, const Similarity& body, double margin, size_t which);

struct CollideInput {
  std::span<const Vec3f> points;            // M's local space, on the executor's device
  std::span<const float> memory;            // lambda per vertex, or empty
  Similarity placement;                     // of M
  std::span<const Sdf* const> colliders;    // their grids on the executor's device
  double margin = 0;                        // M's local units
  double rate = 1;                          // of the contact memory
  double most = 0;                          // upper bound of the contact memory, M's local units
  double diagonal = 0;                      // of M at rest, local units
  const ContactProgress* before = nullptr;  // of the push before, on the executor's device; null: this is the first
  std::span<const Vec3f> stand_back;        // per collider: where it begins, away from its place, M's local space, on the executor's device; or empty
  Buffer<std::byte> prepared;               // of prepare_colliders for these colliders and this placement; empty: not prepared
};

// The colliders in the executor's memory, for many pushes of one body. Empty where no push would read them: on the host, which looks each time which of them
// the body can meet, and for few colliders.
Buffer<std::byte> prepare_colliders(Executor& executor, const CollideInput& input);

// d_i and the new memory for every vertex, and how it went; all on the executor's device. Throws Error(kInput) for a margin beyond a collider's band.
void collide_push(Executor& executor, const CollideInput& input, Vec3f* displacement, float* memory_out, ContactProgress* after);

// moved_i = points_i + displacement_i
void add_displacement(Executor& executor, std::span<const Vec3f> points, const Vec3f* displacement, Vec3f* moved);

struct ProjectInput {
  std::span<const Vec3f> points;  // M's local space, host
  Similarity placement;
  std::span<const Sdf* const> colliders;
  std::span<const ExactDistance* const> meshes;  // per collider, in its local space, or null: then its grid's interpolant is the collider
  double margin = 0;                             // M's local units
  double clearance = 0;                          // how far outside a moved vertex is put, M's local units; above the rounding of its coordinates
  int rounds = 32;                               // for vertices between several colliders
  std::span<const uint32_t> triangles;           // of M; for samples
  int samples = 0;                               // subdivisions of a triangle's sides whose points are kept outside too; below 2: none
};

struct ProjectFigures {
  double deepest_before = 0, deepest_left = 0;  // vertices, M's local units
  size_t inside = 0;                            // vertices that were inside
  size_t left = 0;                              // vertices that still are: squeezed between colliders
  size_t moved = 0;
  double deepest_sample = 0;  // samples, after the last round
};

// The nearest place outside all colliders for every vertex, exact against the meshes. Vertices that are outside keep their bits.
ProjectFigures project_outside(Executor& executor, const ProjectInput& input, Vec3f* moved);

}  // namespace knead
