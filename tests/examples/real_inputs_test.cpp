// Real meshes of the shared data, in graphs as a newcomer writes them after reading README.md: dented, bulged, nothing inside, no number that is
// none.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>

#include "graph/evaluator.h"
#include "io/graph_file.h"
#include "kernels/port_types.h"
#include "tests/paths.h"

namespace knead {
namespace real_inputs_test {

struct Press {
  const char *body, *collider, *motion;
  int before, deepest;  // frames: without contact, and of the deepest press
  const char* node = "deform, stiffness: 0.3";
};

class RealInputs : public testing::Test {
 protected:
  void SetUp() override {
    if (!std::filesystem::exists(shared_data())) GTEST_SKIP() << "no shared data";
  }
};

std::shared_ptr<const Plan> plan_of(const std::string& nodes) {
  return compile(read_graph_text("knead: 1\nframes: 1-12\nnodes:\n" + nodes, "real.yaml"), graph_file_options());
}

std::shared_ptr<const Plan> press_graph(const Press& press) {
  const std::string folder = shared_data() + "/";
  return plan_of("  body: {type: read_mesh, path: " + folder + press.body + "}\n  tool: {type: read_mesh, path: " + folder + press.collider +
                 "}\n  motion: {type: transform, mesh: tool, " + press.motion +
                 "}\n  solid: {type: mesh_to_sdf, mesh: motion}\n  press: {type: " + press.node + ", surface: body, sdf: solid}\n");
}

std::vector<Vec3d> world_points(const Surface& surface) {
  std::vector<Vec3d> points;
  for (const Vec3f& point : surface.points.host()) points.push_back(surface.placement.apply(to_double(point)));
  return points;
}

double distance_to_segment(const Vec3d& p, const Vec3d& a, const Vec3d& b) {
  const double along = dot(b - a, b - a), t = along > 0 ? std::clamp(dot(p - a, b - a) / along, 0.0, 1.0) : 0;
  return length(p - (a + (b - a) * t));
}

// How deep the deepest point is inside the mesh, by brute force: solid angles say what is inside, every triangle is looked at for the distance.
double deepest_inside(const std::vector<Vec3d>& points, const std::vector<Vec3d>& corners, const std::vector<uint32_t>& triangles) {
  Vec3d lower = corners[0], upper = corners[0];
  for (const Vec3d& c : corners) {
    lower = {std::min(lower.x, c.x), std::min(lower.y, c.y), std::min(lower.z, c.z)};
    upper = {std::max(upper.x, c.x), std::max(upper.y, c.y), std::max(upper.z, c.z)};
  }
  double deepest = 0;
  for (const Vec3d& p : points) {
    if (p.x < lower.x || p.y < lower.y || p.z < lower.z || p.x > upper.x || p.y > upper.y || p.z > upper.z) continue;
    double angle = 0, nearest = 1e300;
    for (size_t t = 0; t + 2 < triangles.size(); t += 3) {
      const Vec3d a = corners[triangles[t]] - p, b = corners[triangles[t + 1]] - p, c = corners[triangles[t + 2]] - p;
      const double la = length(a), lb = length(b), lc = length(c);
      angle += 2 * std::atan2(dot(a, cross(b, c)), la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb);
      const Vec3d normal = cross(b - a, c - a), zero{0, 0, 0};
      const bool above =
          dot(cross(b - a, zero - a), normal) >= 0 && dot(cross(c - b, zero - b), normal) >= 0 && dot(cross(a - c, zero - c), normal) >= 0;
      nearest =
          std::min(nearest, above ? std::abs(dot(a, normal)) / length(normal)
                                  : std::min({distance_to_segment(zero, a, b), distance_to_segment(zero, b, c), distance_to_segment(zero, c, a)}));
    }
    if (angle > 2 * M_PI) deepest = std::max(deepest, nearest);
  }
  return deepest;
}

struct Figures {
  double volume_error, dent,
      bulge;  // the last two over the diagonal: the longest move, and the longest across the direction from the collider's middle
  Report report;
};

Figures pressed(const Press& press) {
  Evaluator evaluator(press_graph(press));
  const Surface body = evaluator.get<Surface>("body", 1), untouched = evaluator.get<Surface>("press.surface", press.before);
  EXPECT_EQ(std::memcmp(body.points.host().data(), untouched.points.host().data(), body.points.bytes()), 0);
  const std::vector<Vec3d> rest = world_points(body);
  const Surface result = evaluator.get<Surface>("press.surface", press.deepest), tool = evaluator.get<Surface>("motion", press.deepest);
  const Report report = evaluator.get<Report>("press.report", press.deepest);
  const std::vector<Vec3d> points = world_points(result);
  const double diagonal = result.diagonal() * result.placement.scale;
  EXPECT_EQ(points.size(), rest.size());
  Figures figures{report.number("volume_error"), 0, 0, report};
  const Vec3d towards = tool.placement.apply(to_double(tool.lower + tool.upper) * 0.5);  // the collider's middle
  for (size_t i = 0; i < points.size(); ++i) {
    EXPECT_TRUE(std::isfinite(points[i].x) && std::isfinite(points[i].y) && std::isfinite(points[i].z));
    const Vec3d move = points[i] - rest[i], away = rest[i] - towards;
    const double along = dot(move, away) / length(away);
    figures.dent = std::max(figures.dent, length(move) / diagonal);
    figures.bulge = std::max(figures.bulge, length(move - away * (along / length(away))) / diagonal);
  }
  const double allowed = std::max(1e-4 * diagonal, 0.1 * evaluator.get<Sdf>("solid", press.deepest).voxel_size * tool.placement.scale);
  EXPECT_LE(deepest_inside(points, world_points(tool), tool.topology->triangles), allowed);
  EXPECT_LE(report.number("penetration_max"), allowed) << "and the report says the same";
  EXPECT_EQ(evaluator.figures().evaluations.at("build_tets"), 1u);
  return figures;
}

TEST_F(RealInputs, AFistDentsTheHead) {
  const Figures figures = pressed(
      {"heads/head_ict_2400.obj", "colliders/fist_3000.obj", "scale: 8, keys: {1: {translate: [0, 2, 30]}, 12: {translate: [0, 2, 12]}}", 3, 12});
  EXPECT_LT(std::abs(figures.volume_error), 0.01);
  EXPECT_GT(figures.dent, 0.02);
  EXPECT_GT(figures.bulge, 0.001);
  EXPECT_EQ(figures.report.number("inverted_tets"), 0);
  EXPECT_EQ(figures.report.word("ended"), "at rest");
}

TEST_F(RealInputs, AFistDentsTheHand) {
  const Figures figures = pressed({"organic/hand_7993.obj", "colliders/fist_3000.obj",
                                   "scale: 0.3, keys: {1: {translate: [0, 0.3, 0.6]}, 12: {translate: [0, 0.3, 0.22]}}", 3, 12});
  EXPECT_LT(std::abs(figures.volume_error), 0.01);
  EXPECT_GT(figures.dent, 0.01);
  EXPECT_GT(figures.bulge, 0.001);
}

TEST_F(RealInputs, ATorusDentsTheKoala) {
  const Figures figures = pressed({"organic/koala_49999.obj", "colliders/torus.obj",
                                   "rotate: [90, 0, 0], keys: {1: {translate: [0, 1, 8]}, 12: {translate: [0, 1, 4.9]}}", 3, 12});
  EXPECT_LT(std::abs(figures.volume_error), 0.01);
  EXPECT_GT(figures.dent, 0.015);
}

// The node to pick first, on the same.
TEST_F(RealInputs, ComeToRestWithTheirVolume) {
  const char* const node = "deform_equilibrium";
  for (const Press& press : {Press{"heads/head_ict_2400.obj", "colliders/fist_3000.obj",
                                   "scale: 8, keys: {1: {translate: [0, 2, 30]}, 12: {translate: [0, 2, 12]}}", 3, 12, node},
                             Press{"organic/hand_7993.obj", "colliders/fist_3000.obj",
                                   "scale: 0.3, keys: {1: {translate: [0, 0.3, 0.6]}, 12: {translate: [0, 0.3, 0.22]}}", 3, 12, node},
                             Press{"organic/koala_49999.obj", "colliders/torus.obj",
                                   "rotate: [90, 0, 0], keys: {1: {translate: [0, 1, 8]}, 12: {translate: [0, 1, 4.9]}}", 3, 12, node}}) {
    SCOPED_TRACE(press.body);
    const Figures figures = pressed(press);
    EXPECT_LT(std::abs(figures.volume_error), 1e-3);
    EXPECT_GT(figures.dent, 0.01);
    EXPECT_GT(figures.bulge, 0.001);
    EXPECT_EQ(figures.report.number("inverted_tets"), 0);
    EXPECT_EQ(figures.report.word("ended"), "at rest");
  }
}

// The press of shared/data/press, against which other systems were measured.
TEST_F(RealInputs, ASphereIsPressedIntoThePinnedBlock) {
  Evaluator evaluator(plan_of("  block: {type: read_mesh, path: " + shared_data() +
                              "/press/block10.obj}\n"
                              R"(
  ball:  {type: primitive, shape: sphere, radius: 0.35, centre: [0.03, 0.02, 1.0]}
  solid: {type: mesh_to_sdf, mesh: ball}
  floor: {type: weights, surface: block, region: plane, point: [0, 0, 0.001], normal: [0, 0, 1]}
  press: {type: deform, surface: block, sdf: solid, pins: floor, stiffness: 0.2, face_samples: 45}
)"));
  const std::vector<Vec3d> rest = world_points(evaluator.get<Surface>("block", 1)), after = world_points(evaluator.get<Surface>("press.surface", 1));
  ASSERT_EQ(rest.size(), after.size());
  double lifted = 0;
  for (size_t i = 0; i < rest.size(); ++i) {
    EXPECT_TRUE(std::isfinite(length(after[i])));
    if (rest[i].z <= 0) lifted = std::max(lifted, length(after[i] - rest[i]));
  }
  EXPECT_LT(lifted, 1e-5) << "the bottom is pinned";
  const Report report = evaluator.get<Report>("press.report", 1);
  EXPECT_LT(std::abs(report.number("volume_error")), 0.02);
  EXPECT_LE(report.number("penetration_max"), 1e-4);
  EXPECT_LT(report.number("penetration_faces_max"), 0.02) << "block edges, over 45 samples of every triangle";
  EXPECT_LE(report.number("inverted_tets"), 2);
  EXPECT_GT(report.number("displacement_max"), 0.3);
}

}  // namespace real_inputs_test
}  // namespace knead
