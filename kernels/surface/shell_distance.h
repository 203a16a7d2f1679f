// The distance to a surface that bounds nothing: a sheet for a floor, a bowl. With a thickness it is all that is nearer than half of that. Which side of it is out
// cannot be told from it alone; who knows a body that is on one side of it asks for `from_side`.
#pragma once
#include <array>
#include <memory>
#include <span>
#include <vector>

#include "kernels/surface/exact_distance.h"
#include "kernels/surface/mesh_distance.h"

namespace knead {

class KNEAD_API ShellDistance final : public ExactDistance {
 public:
  // Triangles that are neighbours face the same way. Throws as MeshDistance does.
  ShellDistance(std::span<const Vec3f> points, std::span<const uint32_t> triangles, double thickness, Executor* executor = nullptr);

  SignedDistance signed_distance(const Vec3d& p, double radius = std::numeric_limits<double>::infinity()) const override;
  SignedDistance signed_distance_near(const Vec3d& p, uint32_t& hint) const override;
  const ShellDistance* shell() const override { return this; }
  double thickness() const { return 2 * half_; }
  const MeshDistance& surface() const { return surface_; }

  // 1: p is on the side that the triangles face; -1: on the other; 0: beside the surface, nearest to its rim.
  int side_of(const Vec3d& p) const;

  // The same where all that is behind the surface, seen from `side`, 1 or -1, is inside. What is nearest to the rim is outside.
  double from_side(const Vec3d& p, int side, uint32_t& hint) const;

  // The edges of one triangle only: their ends and middles.
  std::span<const Vec3d> rim() const { return rim_; }

 private:
  SignedDistance around(SignedDistance nearest, const Vec3d& p) const;
  int side_at(const SignedDistance& nearest, const Vec3d& p) const;

  MeshDistance surface_;
  std::vector<Vec3d> points_;
  std::vector<uint32_t> triangles_;
  std::vector<uint8_t> rim_edges_;  // per triangle: bit k: its edge from corner k; bit 3 + k: corner k
  std::vector<Vec3d> rim_;
  double half_;
};

}  // namespace knead
