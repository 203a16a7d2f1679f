// Bodies of flesh as smooth blends of ellipsoids and round cones, contoured to near-uniform triangles.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "graph/error.h"
#include "kernels/shapes/implicit_mesh.h"
#include "kernels/shapes/primitives.h"

namespace knead {

namespace {

// Polynomial smooth minimum: exact where a and b differ by more than k, and k / 4 lower where they are equal.
double blend(double a, double b, double k) {
  const double h = std::max(0.0, k - std::abs(a - b)) / k;
  return std::min(a, b) - 0.25 * k * h * h;
}
double carve(double body, double tool, double k) {
  return -blend(-body, tool, k);
}
double intersect(double a, double b, double k) {
  return -blend(-a, -b, k);
}

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

// The face from its oval to its lips, joined to the skull at distance d.
double face_distance(const Vec3d& p, double d) {
  d = blend(d, ellipsoid(p, {0, -0.02, 0.17}, {0.345, 0.44, 0.34}), 0.16);            // oval
  d = blend(d, limb(p, {0.32, -0.02, 0.0}, {0.265, -0.23, 0.06}, 0.10, 0.09), 0.16);  // jaw
  d = blend(d, limb(p, {0.265, -0.23, 0.06}, {0.06, -0.405, 0.36}, 0.085, 0.085), 0.14);
  d = blend(d, ellipsoid(p, {0, -0.37, 0.425}, {0.11, 0.09, 0.10}), 0.11);                   // chin
  d = blend(d, ellipsoid(p, {0.24, 0.10, 0.345}, {0.10, 0.07, 0.095}), 0.12);                // cheekbone
  d = carve(d, ellipsoid(p, {0.195, 0.225, 0.575}, {0.115, 0.07, 0.135}), 0.10);             // eye socket
  d = carve(d, ellipsoid(p, {0.25, -0.10, 0.53}, {0.08, 0.11, 0.08}), 0.12);                 // hollow of the cheek
  d = blend(d, limb(p, {0.05, 0.325, 0.505}, {0.26, 0.345, 0.40}, 0.045, 0.035), 0.08);      // brow
  d = blend(d, ellipsoid(p, {0.182, 0.222, 0.405}, {0.088, 0.088, 0.088}), 0.02);            // eye
  d = blend(d, limb(p, {0.095, 0.265, 0.475}, {0.265, 0.26, 0.415}, 0.026, 0.022), 0.04);    // upper lid
  d = blend(d, limb(p, {0.11, 0.172, 0.460}, {0.25, 0.182, 0.415}, 0.020, 0.018), 0.04);     // lower lid
  d = blend(d, limb(p, {0, 0.31, 0.50}, {0, 0.075, 0.635}, 0.050, 0.062), 0.09);             // nose
  d = blend(d, ellipsoid(p, {0, 0.058, 0.632}, {0.070, 0.062, 0.068}), 0.05);                // its tip
  d = blend(d, ellipsoid(p, {0.078, 0.035, 0.565}, {0.052, 0.05, 0.065}), 0.04);             // its wings
  d = blend(d, ellipsoid(p, {0, -0.13, 0.42}, {0.17, 0.13, 0.10}), 0.12);                    // the mouth's mound
  d = carve(d, limb(p, {0, -0.030, 0.575}, {0, -0.075, 0.575}, 0.012, 0.014), 0.05);         // philtrum
  d = blend(d, limb(p, {0.03, -0.108, 0.525}, {0.125, -0.140, 0.455}, 0.042, 0.020), 0.03);  // upper lip
  d = blend(d, limb(p, {0, -0.205, 0.515}, {0.10, -0.172, 0.455}, 0.048, 0.026), 0.03);      // lower lip
  d = carve(d, limb(p, {0, -0.153, 0.585}, {0.175, -0.155, 0.475}, 0.022, 0.012), 0.03);     // between them
  d = carve(d, ellipsoid(p, {0, -0.29, 0.56}, {0.12, 0.035, 0.07}), 0.08);                   // above the chin
  return d;
}

// A head and neck of two units of height, centred, crown at y = 1, face towards +z. Left and right mirror each other.
double head_distance(const Vec3d& world) {
  const Vec3d p{std::sqrt(world.x * world.x + 4e-4), world.y, world.z};               // |x|, without a crease down the middle
  double d = ellipsoid(p, {0, 0.44, -0.09}, {0.485, 0.56, 0.60});                     // cranium
  d = blend(d, ellipsoid(p, {0, 0.36, 0.16}, {0.40, 0.42, 0.355}), 0.15);             // forehead
  d = blend(d, limb(p, {0, -0.30, -0.13}, {0, -1.2, -0.22}, 0.29, 0.34), 0.18);       // neck
  d = blend(d, limb(p, {0.24, -0.05, -0.22}, {0.08, -1.1, 0.08}, 0.07, 0.07), 0.16);  // the muscles from the ears to the collar
  d = face_distance({p.x / 1.07, (p.y - 0.03) / 1.07, p.z / 1.03}, d);
  const Vec3d ear = turned_about_y(p - Vec3d{0.485, 0.16, -0.07}, -24);
  double shell = ellipsoid(ear, {0.02, 0.03, -0.03}, {0.062, 0.185, 0.120});
  shell = blend(shell, ellipsoid(ear, {0.01, -0.12, 0.02}, {0.050, 0.075, 0.060}), 0.06);
  shell = carve(shell, ellipsoid(ear, {0.10, 0.035, -0.005}, {0.060, 0.115, 0.065}), 0.05);
  d = blend(d, shell, 0.04);
  return intersect(d, -1.0 - p.y, 0.10);
}

// Edges of the head relative to the mean: finer on the features of the face and on the ears, coarser on the skull and the neck.
double head_edge(const Vec3d& p) {
  const auto bump = [](double r) { return r >= 1 ? 0.0 : (1 - r * r) * (1 - r * r); };
  const double mouth = bump(length(Vec3d{p.x / 0.30, (p.y + 0.12) / 0.28, (p.z - 0.56) / 0.40}));
  const double eyes = bump(length(Vec3d{(std::abs(p.x) - 0.17) / 0.24, (p.y - 0.22) / 0.22, (p.z - 0.46) / 0.30}));
  const double ears = bump(length(Vec3d{(std::abs(p.x) - 0.52) / 0.20, (p.y - 0.15) / 0.34, (p.z + 0.08) / 0.32}));
  return 1.30 - 0.72 * std::min(1.0, 1.3 * std::max({mouth, eyes, ears}));
}

// A right fist about one unit wide: knuckles up at y = 0.5, fingers folded on the +z side, the thumb across them, the wrist down to y = -1.2.
double fist_distance(const Vec3d& p) {
  double d = ellipsoid(p, {0.0, 0.06, -0.05}, {0.45, 0.44, 0.22});                     // back of the hand
  d = blend(d, ellipsoid(p, {0.02, -0.16, 0.10}, {0.38, 0.34, 0.26}), 0.15);           // heel of the palm
  d = blend(d, ellipsoid(p, {0.0, 0.14, 0.16}, {0.37, 0.20, 0.22}), 0.10);             // fills the fist
  d = blend(d, limb(p, {0.0, -0.35, -0.02}, {0.0, -1.3, -0.03}, 0.235, 0.265), 0.22);  // wrist
  for (int finger = 0; finger < 4; ++finger) {                                         // from the index finger (-x) to the little one
    constexpr double kAcross[4] = {-0.335, -0.110, 0.115, 0.325}, kSize[4] = {1.0, 1.05, 1.0, 0.86}, kTop[4] = {0.33, 0.36, 0.325, 0.25};
    const double x = kAcross[finger], size = kSize[finger], top = kTop[finger], r = 0.122 * size;
    const Vec3d knuckle{x * 0.98, top, -0.10}, middle{x, top, 0.34 * size}, tip{x * 0.97, top - 0.32 * size, 0.35 * size},
        end{x * 0.92, top - 0.36, 0.16};
    double f = limb(p, knuckle, middle, r * 1.10, r * 1.04);
    f = blend(f, limb(p, middle, tip, r * 1.04, r * 0.98), 0.03);
    f = blend(f, limb(p, tip, end, r * 0.98, r * 0.9), 0.03);
    f = blend(f, ellipsoid(p, knuckle + Vec3d{0, 0.03, -0.01}, {r * 1.1, r * 1.15, r * 1.3}), 0.05);
    d = blend(d, f, 0.045);
  }
  double thumb = limb(p, {-0.34, -0.34, 0.08}, {-0.42, -0.10, 0.33}, 0.17, 0.135);
  thumb = blend(thumb, limb(p, {-0.42, -0.10, 0.33}, {-0.20, -0.07, 0.46}, 0.13, 0.118), 0.05);
  thumb = blend(thumb, limb(p, {-0.20, -0.07, 0.46}, {0.04, -0.04, 0.49}, 0.118, 0.10), 0.05);
  d = blend(d, thumb, 0.05);
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

double even_edge(const Vec3d&) {
  return 1;
}

Surface organic(double (*shape)(const Vec3d&), const Vec3d& lower, const Vec3d& upper, double scale, int vertices, double (*edge)(const Vec3d&)) {
  if (!(scale > 0)) throw Error(ErrorCode::kInput, "a shape needs a positive size", "in world units");
  if (vertices < 200 || vertices > 1000000)
    throw Error(ErrorCode::kInput, "asked for a shape of " + std::to_string(vertices) + " vertices", "200 to 1000000 can be made");
  const auto value = [shape](const Vec3d& p) { return shape(p); };
  TriangleMesh mesh = contour_even(value, lower, upper, vertices, [edge](const Vec3d& p) { return edge(p); });
  std::vector<Vec3f> points;
  points.reserve(mesh.points.size());
  for (const Vec3d& p : mesh.points) points.push_back(to_float(p * scale));
  return make_triangle_surface(std::move(points), std::move(mesh.triangles));
}

}  // namespace

Surface make_blob(double size, int vertices) {
  return organic(blob_distance, {-0.7, -0.7, -0.7}, {0.7, 0.7, 0.7}, size, vertices, even_edge);
}

Surface make_head(double height, int vertices) {
  return organic(head_distance, {-0.75, -1.15, -0.85}, {0.75, 1.15, 0.95}, height / 2, vertices, head_edge);
}

Surface make_fist(double size, int vertices) {
  return organic(fist_distance, {-0.75, -1.35, -0.55}, {0.75, 0.7, 0.8}, size, vertices, even_edge);
}

}  // namespace knead
