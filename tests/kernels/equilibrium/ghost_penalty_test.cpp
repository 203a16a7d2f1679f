#include "kernels/equilibrium/ghost_penalty.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "graph/executor.h"
#include "io/vdb/vdb.h"
#include "kernels/build_tets/build_tets.h"
#include "kernels/equilibrium/equilibrium.h"
#include "kernels/loop/lattice_map.h"
#include "kernels/shapes/primitives.h"

namespace knead {
namespace ghost_penalty_test {

struct Body {
  BuiltTets build;
  std::vector<std::array<uint32_t, 4>> corners;
  std::vector<Vec3d> rest;
  std::vector<float> inside, stiffness;

  Body() {
    std::vector<std::string> warnings;
    build = build_tets(make_torus(0.6, 0.25, 32), {.max_depth = 4}, *make_serial_executor(), warnings);
    corners.assign(build.tets.tets.host().begin(), build.tets.tets.host().end());
    inside.assign(build.inside.host().begin(), build.inside.host().end());
    stiffness.assign(corners.size(), 1);
    for (const Vec3f& x : build.tets.rest.host()) rest.push_back(to_double(x));
  }
};

double energy(const SparseRows& rows, const std::vector<Vec3d>& u) {
  double sum = 0;
  for (uint32_t p = 0; p < rows.rows(); ++p)
    for (uint32_t e = rows.offsets[p]; e < rows.offsets[p + 1]; ++e) {
      const Vec3d apart = u[rows.index[e]] - u[p];
      sum -= 0.25 * static_cast<double>(rows.value[e]) * dot(apart, apart);
    }
  return sum;
}

TEST(GhostPenalty, CostsAnAffineDisplacementNothingAndAnyOtherSomething) {
  const Body body;
  const SparseRows rows = ghost_penalty(body.corners, body.rest, body.inside, body.stiffness, 1);
  ASSERT_EQ(rows.rows(), body.rest.size());
  std::vector<Vec3d> affine, jagged;
  std::mt19937 random(3);
  std::uniform_real_distribution<double> part(-1, 1);
  for (const Vec3d& x : body.rest) {
    affine.push_back({0.3 * x.x - 0.2 * x.y + 4, 0.1 * x.y + 0.5 * x.z, x.x - 0.4 * x.z - 7});
    jagged.push_back({part(random), part(random), part(random)});
  }
  EXPECT_GT(energy(rows, jagged), 100);
  EXPECT_NEAR(energy(rows, affine), 0, 1e-4 * energy(rows, jagged));
}

TEST(GhostPenalty, LeavesWhatIsFleshThroughoutAlone) {
  const Body body;
  const std::vector<float> whole(body.corners.size(), 1);
  EXPECT_TRUE(ghost_penalty(body.corners, body.rest, whole, body.stiffness, 1).index.empty());
}

// Everything beyond `height`, away from the middle.
Sdf plate(Executor& executor, double height) {
  SdfPlan plan;
  plan.voxel_size = 0.02;
  plan.lower = {-1.3, std::min(height, 2 * height), -1.3};
  plan.upper = {1.3, std::max(height, 2 * height), 1.3};
  return build_sdf(executor, plan, [&](const Vec3d& p, uint32_t&) { return height > 0 ? height - p.y : p.y - height; });
}

// The reference is CalculiX's, of docs/study/torus.py: a torus squeezed to 60 % of its height between plates, at Poisson's ratio 0.499 and 0.45.
TEST(EquilibriumShape, OfATorusBetweenPlatesIsThatOfFiniteElements) {
  const auto executor = make_cpu_executor(2);
  const double ring = 0.6, tube = 0.25, half = 0.15;
  const Sdf up = plate(*executor, half), down = plate(*executor, -half);
  const Surface torus = make_torus(ring, tube, 67);  // 28 quads across: two rows on the middle plane
  std::vector<std::string> warnings;
  const BuiltTets build = build_tets(torus, {}, *executor, warnings);
  struct Case {
    bool keep_volume, weighted;
    double inner, outer, most;
  };
  // 0.0110 and 0.0041 were measured.
  for (const Case& c : {Case{true, true, 0.4199, 1.0178, 0.012}, Case{false, true, 0.4087, 1.0003, 0.01}, Case{true, false, 0.4199, 1.0178, 1}}) {
    EquilibriumMaterial material;
    material.hold = 1;
    material.keep_volume = c.keep_volume;
    if (c.weighted) material.inside = &build.inside;
    const auto rest = prepare_equilibrium(*executor, build.tets, build.lattice, material);
    EquilibriumFigures figures;
    const Buffer<Vec3f> moved = solve_equilibrium(*executor, *rest, torus.placement, {std::vector<const Sdf*>{&up, &down}}, {}, figures);
    const auto map = torus.points.host();
    double inner = 0, outer = 0, inner_count = 0, outer_count = 0;
    const Buffer<Vec3f> points = map_to_surface(*executor, moved, build.lattice);
    for (size_t v = 0; v < map.size(); ++v) {
      const Vec3d x = torus.placement.apply(to_double(map[v])), y = torus.placement.apply(to_double(points.host()[v]));
      if (std::abs(x.y) > 1e-6) continue;
      const bool in = std::hypot(x.x, x.z) < ring;
      (in ? inner : outer) += std::hypot(y.x, y.z);
      (in ? inner_count : outer_count) += 1;
    }
    ASSERT_GT(inner_count, 0);
    const double off = std::max(std::abs(inner / inner_count - c.inner), std::abs(outer / outer_count - c.outer));
    EXPECT_GT(figures.least_volume, 0);
    if (c.most < 1)
      EXPECT_LT(off, c.most) << "keep_volume " << c.keep_volume;
    else
      EXPECT_GT(off, 0.03) << "H is flesh throughout: the shape that weights are for";
  }
}

}  // namespace ghost_penalty_test
}  // namespace knead
