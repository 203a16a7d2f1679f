// Poses over frames: what a keyed transform does between its keys. All in double.
#pragma once
#include <vector>

#include "kernels/port_types.h"

namespace knead {

// A rotation as a unit quaternion.
struct Quaternion {
  double w = 1, x = 0, y = 0, z = 0;
  friend Quaternion operator*(const Quaternion& a, const Quaternion& b);  // b first, then a
  std::array<double, 9> matrix() const;                                   // row-major, orthonormal to rounding
};
Quaternion rotation_about(const Vec3d& axis, double degrees);          // axis of any length; the identity when it is zero
Quaternion rotation_xyz(const Vec3d& degrees);                         // about x first, then y, then z, all axes fixed in the world
Quaternion slerp(const Quaternion& a, const Quaternion& b, double t);  // the shorter way

// x_world = translate + pivot + rotate(scale * (x - pivot)), scale per axis and before the rotation.
struct Pose {
  Vec3d translate{0, 0, 0};
  Quaternion rotate{};
  Vec3d scale{1, 1, 1};
  Vec3d pivot{0, 0, 0};
  bool uniform() const { return scale.x == scale.y && scale.y == scale.z; }
};

struct PoseKey {
  double frame = 0;
  Pose pose;
};

enum class Interpolation { kLinear, kSmooth };

// The pose at `frame`; the first and last keys hold beyond their frames, and at a key its own pose comes back bit for bit. kLinear: straight lines,
// and slerp at constant speed. kSmooth: monotone cubics (Fritsch and Carlson 1980) that start and stop gently and never go beyond the keys on either
// side, so that a keyed press is never deeper than its keys; rotations follow the same slerps at a speed that is continuous over the keys. `keys`
// rise strictly by frame.
Pose pose_at(const std::vector<PoseKey>& keys, double frame, Interpolation interpolation);

// `surface` under the pose. A uniform scale changes the placement alone (the point buffer is shared); otherwise new points are made and the file's
// normals are turned with them. The rest box follows.
Surface posed(const Surface& surface, const Pose& pose);

}  // namespace knead
