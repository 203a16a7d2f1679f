// Bodies of flesh as smooth blends of ellipsoids and round cones, contoured to near-uniform triangles.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "graph/error.h"
#include "kernels/implicit_mesh.h"
#include "kernels/primitives.h"

namespace knead {

namespace {

// Polynomial smooth minimum: exact where a and b differ by more than k, and k / 4 lower where they are equal.
double blend(double a, double b, double k) {
  const double h = std::max(0.0, k - std::abs(a - b)) / k;
  return std::min(a, b) - 0.25 * k * h * h;
}
double carve(double body, double tool, double k) { return -blend(-body, tool, k); }
double intersect(double a, double b, double k) { return -blend(-a, -b, k); }

// About the distance to an ellipsoid: exact on its surface, first order near it.
double ellipsoid(const Vec3d& p, const Vec3d& centre, const Vec3d& radii) {
  const Vec3d q{(p.x - centre.x) / radii.x, (p.y - centre.y) / radii.y, (p.z - centre.z) / radii.z};
  const Vec3d g{q.x / radii.x, q.y / radii.y, q.z / radii.z};
  const double k0 = length(q), k1 = length(g);
  return k1 < 1e-12 ? -std::min({radii.x, radii.y, radii.z}) : k0 * (k0 - 1) / k1;
}

// A capsule whose radius runs from ra at a to rb at b.
double limb(const Vec3d& p, const Vec3d& a, const Vec3d& b, double ra, double rb) {
  const Vec3d ab = b - a;
  const double t = std::clamp(dot(p - a, ab) / dot(ab, ab), 0.0, 1.0);
  return length(p - a - t * ab) - (ra + t * (rb - ra));
}

Vec3d turned_about_y(const Vec3d& p, double degrees) {
  const double c = std::cos(degrees * std::numbers::pi / 180), s = std::sin(degrees * std::numbers::pi / 180);
  return {c * p.x + s * p.z, p.y, c * p.z - s * p.x};
}

// A head and neck of two units of height, centred, crown at y = 1, face towards +z. Left and right mirror each other.
double head_distance(const Vec3d& world) {
  const Vec3d p{std::abs(world.x), world.y, world.z};
  double d = ellipsoid(p, {0, 0.44, -0.09}, {0.485, 0.56, 0.60});                      // cranium
  d = blend(d, ellipsoid(p, {0, 0.36, 0.16}, {0.41, 0.42, 0.36}), 0.15);               // forehead
  d = blend(d, ellipsoid(p, {0, -0.02, 0.17}, {0.36, 0.44, 0.345}), 0.16);             // face
  d = blend(d, limb(p, {0.33, -0.05, 0.0}, {0.29, -0.25, 0.08}, 0.10, 0.09), 0.16);    // jaw
  d = blend(d, limb(p, {0.29, -0.25, 0.08}, {0.06, -0.41, 0.37}, 0.09, 0.085), 0.14);
  d = blend(d, limb(p, {0, -0.30, -0.13}, {0, -1.2, -0.22}, 0.30, 0.335), 0.18);       // neck
  d = blend(d, limb(p, {0.24, -0.05, -0.22}, {0.08, -1.1, 0.05}, 0.07, 0.07), 0.16);   // the muscles from the ears to the collar
  d = blend(d, ellipsoid(p, {0, -0.36, 0.415}, {0.12, 0.095, 0.10}), 0.11);            // chin
  d = blend(d, ellipsoid(p, {0.255, 0.10, 0.33}, {0.12, 0.085, 0.12}), 0.12);          // cheekbone
  d = carve(d, ellipsoid(p, {0.185, 0.235, 0.575}, {0.115, 0.075, 0.11}), 0.12);       // eye socket
  d = blend(d, limb(p, {0.03, 0.335, 0.50}, {0.25, 0.36, 0.40}, 0.045, 0.04), 0.10);   // brow
  d = blend(d, ellipsoid(p, {0.185, 0.235, 0.405}, {0.105, 0.085, 0.09}), 0.03);       // eyeball under its lids
  d = blend(d, limb(p, {0, 0.33, 0.495}, {0, 0.075, 0.655}, 0.04, 0.062), 0.09);       // nose
  d = blend(d, ellipsoid(p, {0.068, 0.035, 0.57}, {0.05, 0.045, 0.06}), 0.05);
  d = blend(d, ellipsoid(p, {0, -0.13, 0.43}, {0.17, 0.13, 0.10}), 0.12);              // the mouth's mound
  d = carve(d, limb(p, {0, -0.045, 0.575}, {0, -0.075, 0.57}, 0.008, 0.01), 0.04);     // philtrum
  d = blend(d, limb(p, {0, -0.105, 0.525}, {0.11, -0.138, 0.455}, 0.036, 0.020), 0.04);  // upper lip
  d = blend(d, limb(p, {0, -0.195, 0.512}, {0.09, -0.170, 0.455}, 0.042, 0.026), 0.04);  // lower lip
  d = carve(d, limb(p, {0, -0.150, 0.585}, {0.16, -0.155, 0.475}, 0.020, 0.012), 0.035);  // between them
  d = carve(d, ellipsoid(p, {0, -0.275, 0.56}, {0.12, 0.035, 0.07}), 0.08);            // above the chin
  const Vec3d ear = turned_about_y(p - Vec3d{0.475, 0.16, -0.06}, -28);
  double shell = ellipsoid(ear, {0.02, 0.02, -0.03}, {0.050, 0.185, 0.115});
  shell = blend(shell, ellipsoid(ear, {0.0, -0.13, 0.02}, {0.045, 0.07, 0.055}), 0.06);
  shell = carve(shell, ellipsoid(ear, {0.075, 0.03, -0.01}, {0.045, 0.115, 0.065}), 0.04);
  d = blend(d, shell, 0.05);
  return intersect(d, -1.0 - p.y, 0.10);
}

// A right fist about one unit wide: knuckles up at y = 0.5, fingers folded on the +z side, the thumb across them, the wrist down to y = -1.2.
double fist_distance(const Vec3d& p) {
  double d = ellipsoid(p, {0.0, 0.08, -0.06}, {0.44, 0.42, 0.24});                      // back of the hand
  d = blend(d, ellipsoid(p, {0.02, -0.18, 0.06}, {0.36, 0.32, 0.24}), 0.15);            // heel of the palm
  d = blend(d, limb(p, {0.0, -0.35, -0.02}, {0.0, -1.3, -0.03}, 0.235, 0.26), 0.22);    // wrist
  for (int finger = 0; finger < 4; ++finger) {                                          // from the index finger (-x) to the little one
    const double x = -0.345 + 0.225 * finger, size = finger == 3 ? 0.86 : finger == 1 ? 1.04 : 1.0;
    const double top = 0.33 - 0.05 * (finger - 1.0) * (finger - 1.0) * (finger > 1 ? 1 : 0.5), r = 0.118 * size;
    const Vec3d knuckle{x * 0.97, top, -0.10}, middle{x, top + 0.02, 0.36 * size}, tip{x * 0.95, top - 0.34 * size, 0.36 * size}, end{x * 0.9, top - 0.36, 0.14};
    double f = limb(p, knuckle, middle, r * 1.12, r * 1.03);
    f = blend(f, limb(p, middle, tip, r * 1.03, r * 0.97), 0.03);
    f = blend(f, limb(p, tip, end, r * 0.97, r * 0.9), 0.03);
    f = blend(f, ellipsoid(p, knuckle + Vec3d{0, 0.02, 0}, {r * 1.1, r * 1.2, r * 1.2}), 0.05);
    d = blend(d, f, 0.055);
  }
  double thumb = limb(p, {-0.40, -0.28, 0.10}, {-0.44, -0.02, 0.38}, 0.15, 0.125);
  thumb = blend(thumb, limb(p, {-0.44, -0.02, 0.38}, {-0.16, -0.06, 0.53}, 0.12, 0.11), 0.05);
  thumb = blend(thumb, limb(p, {-0.16, -0.06, 0.53}, {0.06, -0.06, 0.52}, 0.11, 0.095), 0.05);
  d = blend(d, thumb, 0.06);
  return intersect(d, -1.2 - p.y, 0.12);
}

// Lobes of several sizes around a core, none of them mirrored.
double blob_distance(const Vec3d& p) {
  double d = ellipsoid(p, {0, 0, 0}, {0.36, 0.33, 0.34});
  d = blend(d, ellipsoid(p, {0.24, 0.10, 0.05}, {0.24, 0.22, 0.23}), 0.16);
  d = blend(d, ellipsoid(p, {-0.20, 0.16, 0.12}, {0.22, 0.23, 0.20}), 0.16);
  d = blend(d, ellipsoid(p, {-0.13, -0.17, 0.18}, {0.21, 0.19, 0.21}), 0.16);
  d = blend(d, ellipsoid(p, {0.12, -0.20, -0.12}, {0.24, 0.20, 0.22}), 0.16);
  d = blend(d, ellipsoid(p, {-0.18, 0.00, -0.22}, {0.22, 0.20, 0.20}), 0.16);
  d = blend(d, ellipsoid(p, {0.06, 0.30, -0.08}, {0.18, 0.18, 0.18}), 0.16);
  return d;
}

Surface organic(double (*shape)(const Vec3d&), const Vec3d& lower, const Vec3d& upper, double scale, int vertices) {
  if (!(scale > 0)) throw Error(ErrorCode::kInput, "a shape needs a positive size", "in world units");
  if (vertices < 200 || vertices > 1000000)
    throw Error(ErrorCode::kInput, "asked for a shape of " + std::to_string(vertices) + " vertices", "200 to 1000000 can be made");
  const auto value = [shape](const Vec3d& p) { return shape(p); };
  TriangleMesh mesh = contour_uniform(value, lower, upper, vertices);
  std::vector<Vec3f> points;
  points.reserve(mesh.points.size());
  for (const Vec3d& p : mesh.points) points.push_back(to_float(p * scale));
  return make_triangle_surface(std::move(points), std::move(mesh.triangles));
}

}  // namespace

Surface make_blob(double size, int vertices) { return organic(blob_distance, {-0.7, -0.7, -0.7}, {0.7, 0.7, 0.7}, size, vertices); }

Surface make_head(double height, int vertices) {
  return organic(head_distance, {-0.75, -1.15, -0.85}, {0.75, 1.15, 0.95}, height / 2, vertices);
}

Surface make_fist(double size, int vertices) { return organic(fist_distance, {-0.75, -1.35, -0.55}, {0.75, 0.7, 0.8}, size, vertices); }

}  // namespace knead
