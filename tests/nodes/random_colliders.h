// Random closed solids in front of a ball, for what must hold of any collider: there is contact if and only if the two overlap, the dent is as deep as the overlap,
// and how many triangles a face is made of does not matter.
#pragma once
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <map>
#include <random>
#include <string>

#include "kernels/port_types.h"
#include "kernels/shapes/primitives.h"
#include "kernels/surface/exact_distance.h"
#include "tests/nodes/sdf_node_context.h"

namespace knead::random_colliders {

// A solid about its own origin, with a place on its surface and the normal there, which is that of a supporting plane.
struct Solid {
  std::string name;
  Surface few, many;  // the same solid of few and of many triangles; of a ball both the same
  Vec3d at, normal;
};

inline Vec3d random_unit(std::mt19937& random) {
  std::normal_distribution<double> normal;
  const Vec3d v{normal(random), normal(random), normal(random)};
  return v * (1 / length(v));
}

// A box of these sides; a wedge is as high only at one end. Each face is of 2 * 4^levels triangles.
inline Surface box(const Vec3d& size, int levels, bool wedge) {
  const Surface made = make_box({1, 1, 1}, 1);
  std::vector<Vec3f> points;
  for (const uint32_t v : made.topology->triangles) points.push_back(made.points.host()[v]);
  for (int level = 0; level < levels; ++level) {
    std::vector<Vec3f> finer;
    for (size_t t = 0; t < points.size(); t += 3) {
      const Vec3f a = points[t], b = points[t + 1], c = points[t + 2], ab = (a + b) * 0.5f, bc = (b + c) * 0.5f, ca = (c + a) * 0.5f;
      finer.insert(finer.end(), {a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca});
    }
    points = finer;
  }
  std::vector<uint32_t> triangles(points.size());
  for (uint32_t k = 0; k < triangles.size(); ++k) triangles[k] = k;
  for (Vec3f& p : points) {
    if (wedge) p.y = -0.5f + (p.y + 0.5f) * (0.55f - p.x);
    p = to_float(Vec3d{p.x * size.x, p.y * size.y, p.z * size.z});
  }
  return make_triangle_surface(points, triangles);
}

inline Solid random_solid(std::mt19937& random) {
  std::uniform_real_distribution<double> u(0, 1);
  const auto power = [&](double low, double high) { return low * std::pow(high / low, u(random)); };
  const size_t kind = random() % 4;
  Solid solid;
  if (kind == 0) {
    const double radius = power(0.3, 1e4);
    solid.name = "ball of " + std::to_string(radius);
    solid.few = solid.many = make_sphere(radius, 4);
    const auto points = solid.few.points.host();
    solid.at = to_double(points[random() % points.size()]);
    solid.normal = solid.at * (1 / length(solid.at));
    return solid;
  }
  const double width = power(2, kind == 2 ? 300 : 1e4);
  const Vec3d size{width, kind == 1 ? width * power(1e-4, 0.1) : width * power(0.2, 1), width * power(std::max(0.05, 2 / width), 1)};
  solid.name = std::string(kind == 1   ? "slab of "
                           : kind == 2 ? "wedge of "
                                       : "box of ") +
               std::to_string(size.x) + " x " + std::to_string(size.y) + " x " + std::to_string(size.z);
  solid.few = box(size, 0, kind == 2);
  solid.many = box(size, 4, kind == 2);
  // On its lower face, not near the edge.
  const auto inner = [&](double side) { return (u(random) - 0.5) * std::max(0.0, side - 1.9); };
  solid.at = {inner(size.x), -0.5 * size.y, inner(size.z)};
  solid.normal = {0, -1, 0};
  return solid;
}

// Turned at random, and moved so that it comes within `distance` of the origin, at its place, and no nearer.
inline Similarity placed(const Solid& solid, double distance, std::mt19937& random) {
  const Vec3d x = random_unit(random), other = cross(x, random_unit(random)), z = other * (1 / length(other)), y = cross(z, x);
  Similarity place;
  place.rotation = {x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z};
  place.translation = -distance * place.rotate(solid.normal) - place.rotate(solid.at);
  return place;
}

// A ball of radius 1 about the origin, and what becomes of it.
class Press {
 public:
  Press() : tets_("build_tets", 2) { tets_.set("max_depth", 4).connect("surface", body_).run(); }

  struct Result {
    std::vector<Vec3d> points;
    double nearest = 1e300;  // of a vertex to the collider, exactly
    double contacts = 0;
    std::string ended, warnings;
    bool untouched = false;
  };
  Result by(Surface collider, const Similarity& place) {
    collider.placement = place;
    sdf_node_test::OneNode solid("mesh_to_sdf", 2), press("equilibrium", 2), exact("collide_sdf", 2);
    solid.set("resolution", 24).connect("mesh", collider).run();
    const Sdf& sdf = solid.out<Sdf>("sdf");
    press.connect("surface", body_).connect("sdf", sdf).connect("tets", tets_.out<TetMesh>("tets")).connect("lattice", tets_.out<Lattice>("lattice"));
    press.connect("inside", tets_.out<Weights>("inside")).run();
    exact.set("mode", "project").connect("surface", press.out<Surface>("surface")).connect("sdf", sdf).run();
    Result result;
    const Surface& surface = exact.out<Surface>("surface");
    result.untouched = std::memcmp(surface.points.host().data(), body_.points.host().data(), body_.points.bytes()) == 0;
    const Similarity to_collider = sdf.placement.inverse();
    for (const Vec3f& p : surface.points.host()) {
      result.points.push_back(to_double(p));
      result.nearest = std::min(result.nearest, sdf.distance->signed_distance(to_collider.apply(to_double(p))).distance);
    }
    result.contacts = press.out<Report>("report").number("contacts");
    result.ended = press.out<Report>("report").word("ended");
    result.warnings = press.all_warnings() + exact.all_warnings();
    return result;
  }

 private:
  Surface body_ = make_sphere(1, 3);
  sdf_node_test::OneNode tets_;
};

// At most `most_wrong` of the scenes are not as they should be.
inline void expect_contact_as_they_overlap(int scenes, uint32_t seed, size_t most_wrong = 0) {
  constexpr double kDepth = 0.15, kPart = 0.02, kDiagonal = 3.4641;
  // A contact's force begins 2e-3 of the diagonal outside and may hold what is pressed lightly there.
  constexpr double kGap = 2e-3 * kDiagonal;
  std::mt19937 random(seed);
  Press press;
  std::map<int, std::string> wrong;
  for (int n = 0; n < scenes; ++n) {
    const Solid solid = random_solid(random);
    const auto expect = [&](bool so, const std::string& what) {
      if (!so) wrong[n] += "scene " + std::to_string(n) + ", a " + solid.name + ": " + what + "\n";
    };
    expect(press.by(solid.few, placed(solid, 1 + 1.5 * kGap, random)).untouched, "does not touch, and is felt");
    const Similarity place = placed(solid, 1 - kDepth, random);
    const Press::Result few = press.by(solid.few, place), many = press.by(solid.many, place);
    for (const Press::Result* result : {&few, &many}) {
      expect(result->contacts > 0, "no contact");
      expect(result->ended == "at rest", "ended: " + result->ended);
      expect(result->warnings.empty(), result->warnings);
      expect(result->nearest > -1e-6 * kDiagonal, "a vertex is inside");
      expect(result->nearest < kGap, "the dent is deeper than the overlap");
    }
    double apart = 0;
    for (size_t i = 0; i < few.points.size(); ++i) apart = std::max(apart, length(few.points[i] - many.points[i]));
    expect(apart < kPart * kDepth, "few and many triangles are apart by " + std::to_string(apart));
  }
  std::string all;
  for (const auto& [n, what] : wrong) all += what;
  EXPECT_LE(wrong.size(), most_wrong) << all;
}

}  // namespace knead::random_colliders
