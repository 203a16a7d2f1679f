// Does a triangle touch a box? Separating axes in double (Akenine-Moeller 2001): three box axes, the triangle's normal, nine cross products.
#pragma once
#include <algorithm>
#include <cmath>

#include "kernels/vec.h"

namespace knead {

// The box is centre +- half, closed. Degenerate triangles (a segment, a point) are tested as what they are. Rounding may err to either side by about
// 1e-15 of the coordinates: enlarge `half` by a slack above that for a conservative answer.
inline bool triangle_touches_box(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& centre, const Vec3d& half) {
  const Vec3d v[3] = {a - centre, b - centre, c - centre};
  for (int k = 0; k < 3; ++k) {
    if (std::min({v[0][k], v[1][k], v[2][k]}) > half[k] || std::max({v[0][k], v[1][k], v[2][k]}) < -half[k]) return false;
  }
  const Vec3d edges[3] = {v[1] - v[0], v[2] - v[1], v[0] - v[2]};
  const Vec3d normal = cross(edges[0], edges[1]);
  if (std::abs(dot(normal, v[0])) > half.x * std::abs(normal.x) + half.y * std::abs(normal.y) + half.z * std::abs(normal.z)) return false;
  for (const Vec3d& e : edges) {
    for (int k = 0; k < 3; ++k) {
      const int i = (k + 1) % 3, j = (k + 2) % 3;  // axis = unit_k x e has components i: -e_j, j: e_i
      const double p0 = v[0][j] * e[i] - v[0][i] * e[j], p1 = v[1][j] * e[i] - v[1][i] * e[j], p2 = v[2][j] * e[i] - v[2][i] * e[j];
      const double reach = half[i] * std::abs(e[j]) + half[j] * std::abs(e[i]);
      if (std::min({p0, p1, p2}) > reach || std::max({p0, p1, p2}) < -reach) return false;
    }
  }
  return true;
}

}  // namespace knead
