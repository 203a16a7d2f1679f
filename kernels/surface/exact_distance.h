// Exact signed distances to colliders, as their fields are sampled from and vertices are projected by: to a triangle mesh (mesh_distance.h), to a shell around
// one that bounds nothing (shell_distance.h), to a plane.
#pragma once
#include <cstdint>
#include <limits>

#include "graph/api.h"
#include "kernels/vec.h"

namespace knead {

class ShellDistance;

struct SignedDistance {
  double distance = std::numeric_limits<double>::infinity();  // negative inside; infinite when nothing lies within the search radius
  Vec3d point{0, 0, 0};                                       // nearest point of the surface
  Vec3d normal{0, 0, 0};                                      // unit gradient of the distance: away from the solid; on the surface its pseudonormal
  uint32_t triangle = std::numeric_limits<uint32_t>::max();   // that holds `point`, as numbered in the mesh given; of a plane 0

  bool found() const { return triangle != std::numeric_limits<uint32_t>::max(); }
};

// All queries are thread-safe; p must be finite.
class KNEAD_API ExactDistance {
 public:
  virtual ~ExactDistance() = default;

  // `radius` bounds the search and makes it faster.
  virtual SignedDistance signed_distance(const Vec3d& p, double radius = std::numeric_limits<double>::infinity()) const = 0;

  // The same value, found faster from a good guess: `hint` is an opaque number that an earlier query near p left behind (kNoHint at first).
  static constexpr uint32_t kNoHint = std::numeric_limits<uint32_t>::max();
  virtual SignedDistance signed_distance_near(const Vec3d& p, uint32_t& hint) const = 0;

  virtual const ShellDistance* shell() const { return nullptr; }  // this, of a surface that bounds nothing
};

// The half space below z = 0.
class KNEAD_API HalfSpaceDistance final : public ExactDistance {
 public:
  SignedDistance signed_distance(const Vec3d& p, double radius = std::numeric_limits<double>::infinity()) const override;
  SignedDistance signed_distance_near(const Vec3d& p, uint32_t& hint) const override;
};

}  // namespace knead
