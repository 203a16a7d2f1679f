// Internal: what a MeshDistance holds. mesh_distance_build.cpp makes it, mesh_distance.cpp asks it.
#pragma once
#include <array>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "graph/executor.h"
#include "kernels/surface/mesh_distance.h"
#include "kernels/surface/winding_number.h"

struct RTCSceneTy;

namespace knead {

struct MeshDistance::Impl {
  std::vector<Vec3d> points;
  std::vector<uint32_t> triangles;    // the surface: what distances are measured to
  std::vector<uint32_t> source;       // per triangle, its number in the mesh given
  std::vector<Vec3d> face_normals;    // unit, per triangle
  std::vector<Vec3d> corner_normals;  // unit pseudonormals, 3 per triangle
  std::vector<Vec3d> edge_normals;    // unit pseudonormals, 3 per triangle, edge k from corner k
  std::vector<uint8_t> doubtful;      // per triangle: bit k < 3 corner k, bit 3 + k edge k, bit 6 the face: the sign there needs the winding number
  std::unique_ptr<WindingNumber> solid;
  Vec3d lower, upper, centre;
  double diagonal = 0;
  bool closed = true, overlapping = false;
  RTCSceneTy* scene = nullptr;  // Embree's: the points about the centre, over the diagonal

  struct Piece {  // of a triangle
    std::array<Vec3d, 3> corners;
    uint32_t triangle;
    bool clean;  // on the surface all over
  };
  struct Nearest {
    const Impl* mesh;
    Vec3d p;
    double slack;  // in units of the diagonal
    double squared;
    TrianglePoint at{};
    uint32_t triangle = std::numeric_limits<uint32_t>::max();
  };

  struct Hit {
    uint32_t triangle;
    float distance;  // over the diagonal
  };

  ~Impl();
  void build(std::span<const Vec3d> all_points, std::span<const uint32_t> all_triangles, Executor& executor);
  void keep_finite(std::span<const uint32_t> all_triangles, std::vector<uint32_t>& whole, std::vector<uint32_t>& number);
  void find_normals(const std::vector<uint32_t>& welded, Executor& executor);
  void drop_overlaps(const std::vector<uint32_t>& welded, Executor& executor);
  bool quarter(const Piece& piece, int level, std::vector<Piece>& out) const;
  void make_scene();
  static bool improve(Nearest& best, uint32_t triangle);
  Nearest search(const Vec3d& p, double radius, uint32_t hint) const;
  SignedDistance with_sign(const Nearest& nearest) const;
  std::optional<Hit> hit_after(float near, const Vec3d& origin, const Vec3d& direction) const;  // origin: in the scene
  int ray_winding(const Vec3d& origin, const Vec3d& direction) const;
  const Vec3d& corner(size_t triangle, int k) const { return points[triangles[3 * triangle + k]]; }
  double test_offset(const Vec3d& at, const Vec3d& direction, double size) const;
  bool on_surface(const std::array<Vec3d, 3>& corners, const Vec3d& at) const;
};

inline Vec3d unit_or_zero(const Vec3d& v) {
  const double size = length(v);
  return size > 0 ? v * (1 / size) : Vec3d{0, 0, 0};
}

}  // namespace knead
