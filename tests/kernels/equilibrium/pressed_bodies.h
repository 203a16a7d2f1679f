// A surface pressed by colliders on an H of its own, for the tests of the equilibrium.
#pragma once
#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "io/vdb/vdb.h"
#include "kernels/build_tets/build_tets.h"
#include "kernels/equilibrium/equilibrium.h"
#include "kernels/loop/lattice_map.h"
#include "kernels/shapes/primitives.h"

namespace knead::pressed_bodies {

inline Sdf ball(double radius, const Vec3d& at, double scale = 1) {
  const auto executor = make_serial_executor();
  SdfPlan plan;
  plan.voxel_size = radius / 10;
  plan.lower = {-radius, -radius, -radius};
  plan.upper = {radius, radius, radius};
  Sdf sdf = build_sdf(*executor, plan, [&](const Vec3d& p, uint32_t&) { return length(p) - radius; });
  sdf.placement.translation = at;
  sdf.placement.scale = scale;
  return sdf;
}

struct Pressed {
  std::unique_ptr<Executor> executor = make_cpu_executor(2);
  BuiltTets built;
  std::shared_ptr<const EquilibriumRest> rest;
  EquilibriumFigures figures;
  Buffer<Vec3f> tets, points;
  EquilibriumSettings settings;

  explicit Pressed(const Surface& surface, const EquilibriumMaterial& material = {}, int depth = 3) {
    std::vector<std::string> warnings;
    BuildTetsOptions options;
    options.max_depth = depth;
    options.min_depth = options.surface_depth = 2;  // A finer H than M has vertices for would give way between them.
    built = build_tets(surface, options, *executor, warnings);
    rest = prepare_equilibrium(*executor, built.tets, built.lattice, material);
  }

  // Every place is a number, not far from rest, and `ended` says what it should.
  void by(const std::vector<const Sdf*>& colliders, const std::string& what, double most = 1) {
    tets = solve_equilibrium(*executor, *rest, built.lattice.rest.placement, colliders, settings, figures);
    points = map_to_surface(*executor, tets, built.lattice);
    const double diagonal = built.lattice.rest.diagonal();
    for (size_t i = 0; i < points.size(); ++i) {
      const double moved = static_cast<double>(length(points.host()[i] - built.lattice.rest.points.host()[i]));
      ASSERT_TRUE(moved <= most * diagonal) << what << ": vertex " << i << " went " << moved / diagonal << " diagonals";
    }
    EXPECT_TRUE(std::isfinite(figures.energy) && std::isfinite(figures.gradient) && std::isfinite(figures.penetration)) << what;
    EXPECT_LE(figures.iterations - figures.way_in, settings.max_iterations) << what;
    const bool quiet = figures.gradient <= settings.threshold && figures.penetration <= 1.01 * settings.penetration;
    EXPECT_TRUE(figures.ended != Ended::kAtRest || quiet)
        << what << " says rest at gradient " << figures.gradient << ", contact " << figures.penetration;
    EXPECT_TRUE(figures.ended != Ended::kIterationLimit || figures.iterations == settings.max_iterations) << what;
  }
};

using Triangles = std::vector<uint32_t>;

inline Surface mended(const Surface& from, const std::function<void(std::vector<Vec3f>&, Triangles&)>& change) {
  std::vector<Vec3f> points(from.points.host().begin(), from.points.host().end());
  Triangles triangles = from.topology->triangles;
  change(points, triangles);
  return make_triangle_surface(points, triangles);
}

}  // namespace knead::pressed_bodies
