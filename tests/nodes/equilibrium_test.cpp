#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

#include "graph/evaluator.h"
#include "graph/report.h"
#include "kernels/port_types.h"

namespace knead {
namespace equilibrium_test {

// A ball with a smaller one over it, which touches it from frame 2 on. Everything is `size` times as large.
GraphSpec pressed(Literal::Map more = {}, double size = 1, Literal::List at = {0.0, 0.0, 0.0}) {
  const auto up = [&](double y) { return Literal::Map{{"translate", Literal::List{at[0].number(), at[1].number() + size * y, at[2].number()}}}; };
  GraphSpec graph;
  graph.add("shape", "primitive", {{"shape", "sphere"}, {"radius", size}, {"resolution", 3}})
      .add("body", "transform", {{"mesh", "shape"}, {"keys", Literal::Map{{1, Literal::Map{{"translate", at}}}}}})
      .add("ball", "primitive", {{"shape", "sphere"}, {"radius", 0.5 * size}, {"resolution", 3}})
      .add("motion", "transform", {{"mesh", "ball"}, {"keys", Literal::Map{{1, up(3)}, {2, up(1.2)}, {3, up(1.0)}}}})
      .add("solid", "mesh_to_sdf", {{"mesh", "motion"}, {"voxel_size", 0.04 * size}})
      .add("tets", "build_tets", {{"surface", "body"}, {"max_depth", 4}});
  Literal::Map arguments{{"surface", "body"}, {"sdf", "solid"}, {"tets", "tets"}, {"lattice", "tets.lattice"}};
  arguments.insert(arguments.end(), more.begin(), more.end());
  graph.add("press", "equilibrium", std::move(arguments));
  return graph.add(
      "figures", "measure",
      {{"surface", "press"}, {"rest", "body"}, {"sdf", "solid"}, {"tets", "tets"}, {"points", "press.points"}, {"report", "press.report"}});
}

double largest_difference(const Surface& a, const Surface& b, double scale = 1, Vec3d offset = {0, 0, 0}) {
  double most = 0;
  for (size_t i = 0; i < a.points.size(); ++i) {
    const Vec3d p = a.placement.apply(to_double(a.points.host()[i])), q = b.placement.apply(to_double(b.points.host()[i]));
    most = std::max(most, length((1 / scale) * (q - offset) - p));
  }
  return most;
}

TEST(Equilibrium, LeavesASurfaceWithoutContactUntouched) {
  Evaluator evaluator(compile(pressed()));
  const auto body = evaluator.get<Surface>("body", 1), result = evaluator.get<Surface>("press.surface", 1);
  EXPECT_EQ(std::memcmp(body.points.host().data(), result.points.host().data(), body.points.bytes()), 0);
  EXPECT_EQ(evaluator.get<Report>("press.report", 1).word("ended"), "no contact");
}

TEST(Equilibrium, ComesToRestOutsideTheColliderWithItsVolumeKept) {
  for (const char* material : {"stable_neo_hookean", "corotated", "edges"}) {
    Evaluator evaluator(compile(pressed({{"material", material}})));
    const Report report = evaluator.get<Report>("figures", 2);
    EXPECT_EQ(report.word("ended"), "at rest") << material;
    EXPECT_LE(report.number("iterations"), 80) << material;
    EXPECT_LT(report.number("penetration_max_relative"), 6e-4) << material << ": of the mesh; the field's interpolant is a little smaller";
    EXPECT_LT(std::abs(report.number("volume_error")), 3e-4) << material;
    EXPECT_EQ(report.number("inverted_tets"), 0) << material;
    EXPECT_GT(report.number("displacement_max"), 0.2) << material << ": a dent, not a body moved aside";
    EXPECT_LT(report.number("displacement_max"), 0.35) << material;
  }
}

TEST(Equilibrium, IsTheSameBitsForAnyNumberOfThreadsAndOrderOfFrames) {
  std::vector<Surface> results;
  for (const int threads : {1, 2}) {
    const auto executor = make_cpu_executor(threads);
    EvaluatorOptions options;
    options.executor = executor.get();
    Evaluator evaluator(compile(pressed()), options);
    if (threads == 2) evaluator.get<Surface>("press.surface", 3);
    results.push_back(evaluator.get<Surface>("press.surface", 2));
  }
  EXPECT_EQ(std::memcmp(results[0].points.host().data(), results[1].points.host().data(), results[0].points.bytes()), 0);
}

TEST(Equilibrium, DoesNotDependOnScaleAndPlace) {
  const Surface plain = Evaluator(compile(pressed())).get<Surface>("press.surface", 2);
  for (const double size : {1e-4, 1e4}) {
    const Surface scaled = Evaluator(compile(pressed({}, size))).get<Surface>("press.surface", 2);
    EXPECT_LT(largest_difference(plain, scaled, size), 2e-4) << size;
  }
  const Surface moved = Evaluator(compile(pressed({}, 1, {5.0, -7.0, 3.0}))).get<Surface>("press.surface", 2);
  EXPECT_LT(largest_difference(plain, moved, 1, {5, -7, 3}), 2e-4);
}

TEST(Equilibrium, KeepsPinnedVerticesInPlace) {
  GraphSpec graph = pressed({{"pins", "low"}, {"hold", 0.0}});
  graph.add("low", "weights",
            {{"surface", "body"}, {"region", "plane"}, {"normal", Literal::List{0, 1, 0}}, {"point", Literal::List{0.0, -0.5, 0.0}}});
  Evaluator evaluator(compile(graph));
  const auto body = evaluator.get<Surface>("body", 2), result = evaluator.get<Surface>("press.surface", 2);
  for (size_t i = 0; i < body.points.size(); ++i)
    if (to_double(body.points.host()[i]).y < -0.5) EXPECT_EQ(length(result.points.host()[i] - body.points.host()[i]), 0) << i;
  EXPECT_EQ(evaluator.get<Report>("press.report", 2).word("ended"), "at rest");
}

TEST(Equilibrium, GoesTheWayInWhenABallIsHalfSunk) {
  // At frame 3 the small ball's centre is on the body's surface: the nearest way out of it is sideways there.
  Evaluator evaluator(compile(pressed()));
  const Report report = evaluator.get<Report>("figures", 3);
  EXPECT_EQ(report.word("ended"), "at rest");
  EXPECT_EQ(report.number("inverted_tets"), 0);
  EXPECT_LT(std::abs(report.number("volume_error")), 3e-4);
  double above = 0;  // no vertex is left on the far side of the ball
  const Surface result = evaluator.get<Surface>("press.surface", 3);
  for (const Vec3f& p : result.points.host())
    if (std::hypot(p.x, p.z) < 0.25f) above = std::max(above, static_cast<double>(p.y));
  EXPECT_LT(above, 0.62);
}

TEST(Equilibrium, IsHeldWhereHoldIsPainted) {
  GraphSpec graph = pressed({{"hold", 20.0}, {"hold_weights", "left"}});
  graph.add("left", "weights", {{"surface", "body"}, {"region", "plane"}, {"normal", Literal::List{1, 0, 0}}, {"inside", 10.0}, {"outside", 0.1}});
  Evaluator evaluator(compile(graph));
  const auto body = evaluator.get<Surface>("body", 2), result = evaluator.get<Surface>("press.surface", 2);
  double left = 0, right = 0;
  for (size_t i = 0; i < body.points.size(); ++i) {
    const Vec3f p = body.points.host()[i];
    (p.x < 0 ? left : right) += static_cast<double>(length(result.points.host()[i] - p));
  }
  EXPECT_GT(right, 1.3 * left);
}

TEST(Equilibrium, StretchesMoreWhereStiffnessIsPaintedLow) {
  GraphSpec graph = pressed({{"stiffness_weights", "left"}});
  graph.add("left", "weights", {{"surface", "body"}, {"region", "plane"}, {"normal", Literal::List{1, 0, 0}}, {"inside", 1.0}, {"outside", 0.1}});
  Evaluator evaluator(compile(graph));
  const auto body = evaluator.get<Surface>("body", 2), result = evaluator.get<Surface>("press.surface", 2);
  double left = 0, right = 0;
  const auto& triangles = body.topology->triangles;
  const auto before = body.points.host(), after = result.points.host();
  for (size_t c = 0; c + 1 < triangles.size(); c += 3) {
    const uint32_t a = triangles[c], b = triangles[c + 1];
    const double stretch = std::abs(static_cast<double>(length(after[b] - after[a]) / length(before[b] - before[a])) - 1);
    (before[a].x < 0 ? left : right) += stretch;
  }
  EXPECT_GT(right, 1.5 * left);
}

TEST(Equilibrium, NamesASurfaceThatTheLatticeDoesNotBind) {
  GraphSpec graph = pressed();
  for (auto& node : graph.nodes)
    if (node.name == "press")
      for (auto& [name, value] : node.arguments)
        if (name.text() == Literal("surface").text()) value = "ball";
  Evaluator evaluator(compile(graph));
  EXPECT_THROW(evaluator.get<Surface>("press.surface", 2), Error);
}

// The same press on a finer H, `direct` and from where a coarse one came to rest.
GraphSpec cascade(Literal::Map more = {}) {
  GraphSpec graph = pressed(more);
  graph.add("fine", "build_tets", {{"surface", "body"}, {"max_depth", 6}, {"max_vertices", 1}});
  Literal::Map direct{{"surface", "body"}, {"sdf", "solid"}, {"tets", "fine"}, {"lattice", "fine.lattice"}};
  direct.insert(direct.end(), more.begin(), more.end());
  Literal::Map from_coarse = direct;
  from_coarse.push_back({"start", "press.state"});
  return graph.add("direct", "equilibrium", std::move(direct)).add("cascade", "equilibrium", std::move(from_coarse));
}

TEST(EquilibriumCascade, EndsAtTheSameShapeInFewerIterations) {
  for (const int frame : {2, 3})
    for (const double friction : {0.0, 0.3}) {
      Evaluator evaluator(compile(cascade({{"friction", friction}})));
      const Report direct = evaluator.get<Report>("direct.report", frame), from_coarse = evaluator.get<Report>("cascade.report", frame);
      EXPECT_EQ(direct.word("started"), "rest");
      EXPECT_EQ(from_coarse.word("started"), "state");
      EXPECT_EQ(from_coarse.word("ended"), "at rest");
      EXPECT_EQ(from_coarse.number("way_in_iterations"), 0);
      EXPECT_LT(from_coarse.number("iterations"), direct.number("iterations")) << "frame " << frame << ", friction " << friction;
      const double off = largest_difference(evaluator.get<Surface>("direct.surface", frame), evaluator.get<Surface>("cascade.surface", frame));
      EXPECT_LT(off, friction > 0 ? 2e-2 : 1e-3) << "frame " << frame << ": the dent is 0.3 deep; what skin clings to depends on the way there";
    }
}

TEST(EquilibriumCascade, LeavesASurfaceWithoutContactUntouched) {
  Evaluator evaluator(compile(cascade()));
  EXPECT_EQ(evaluator.get<Report>("cascade.report", 1).word("ended"), "no contact");
  const auto body = evaluator.get<Surface>("body", 1), result = evaluator.get<Surface>("cascade.surface", 1);
  EXPECT_EQ(std::memcmp(body.points.host().data(), result.points.host().data(), body.points.bytes()), 0);
}

TEST(EquilibriumCascade, IsTheSameBitsForAnyNumberOfThreadsAndOrderOfFrames) {
  std::vector<Surface> results;
  for (const int threads : {1, 2, 3}) {
    const auto executor = make_cpu_executor(threads);
    EvaluatorOptions options;
    options.executor = executor.get();
    Evaluator evaluator(compile(cascade()), options);
    if (threads != 1) evaluator.get<Surface>("cascade.surface", threads == 2 ? 3 : 1);
    results.push_back(evaluator.get<Surface>("cascade.surface", 2));
  }
  for (const Surface& result : results)
    EXPECT_EQ(std::memcmp(results[0].points.host().data(), result.points.host().data(), result.points.bytes()), 0);
}

TEST(EquilibriumCascade, StartsFromAStateWithOtherContactSamples) {
  GraphSpec graph = cascade();
  graph.add("sampled", "equilibrium",
            {{"surface", "body"}, {"sdf", "solid"}, {"tets", "fine"}, {"lattice", "fine.lattice"}, {"start", "press.state"}, {"contact_samples", 2}});
  const Report report = Evaluator(compile(graph)).get<Report>("sampled.report", 2);
  EXPECT_EQ(report.word("started"), "state");
  EXPECT_EQ(report.word("ended"), "at rest");
}

TEST(EquilibriumCascade, RefusesTheStateOfAnotherSurface) {
  GraphSpec graph = cascade();
  graph.add("other_shape", "primitive", {{"shape", "sphere"}, {"radius", 0.9}, {"resolution", 3}})
      .add("other_tets", "build_tets", {{"surface", "other_shape"}, {"max_depth", 3}})
      .add("other", "equilibrium",
           {{"surface", "other_shape"}, {"sdf", "solid"}, {"tets", "other_tets"}, {"lattice", "other_tets.lattice"}, {"start", "press.state"}});
  Evaluator evaluator(compile(graph));
  try {
    evaluator.get<Surface>("other.surface", 2);
    FAIL() << "it started from the state of another surface";
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::kInput);
    EXPECT_THAT(error.what(), testing::HasSubstr("another surface"));
  }
}

// What does not fit into the cache is made again, and then is another buffer with the same contents.
TEST(EquilibriumCascade, TakesACacheThatIsTooSmall) {
  const Surface whole = Evaluator(compile(cascade())).get<Surface>("cascade.surface", 2);
  for (const size_t bytes : {size_t{0}, size_t{1} << 16, size_t{1} << 18, size_t{1} << 20, size_t{1} << 22, size_t{1} << 23}) {
    EvaluatorOptions options;
    options.cache = std::make_shared<Cache>(bytes);
    Evaluator evaluator(compile(cascade()), options);
    for (const int frame : {3, 2}) {
      evaluator.get<Surface>("cascade.surface", frame);
      evaluator.get<Surface>("press.surface", frame);
      evaluator.get<Surface>("direct.surface", frame);
    }
    const Surface part = evaluator.get<Surface>("cascade.surface", 2);
    EXPECT_EQ(std::memcmp(whole.points.host().data(), part.points.host().data(), whole.points.bytes()), 0) << bytes;
  }
}

// The one-node form is the same as its parts by hand.
TEST(Equilibrium, IsOneNodeToo) {
  GraphSpec graph = pressed();
  graph
      .add("by_hand", "equilibrium",
           {{"surface", "body"}, {"sdf", "solid"}, {"tets", "tets"}, {"lattice", "tets.lattice"}, {"inside", "tets.inside"}})
      .add("exact", "collide_sdf", {{"mode", "project"}, {"surface", "by_hand"}, {"sdf", "solid"}, {"samples", 8}})
      .add("whole", "deform_equilibrium", {{"surface", "body"}, {"sdf", "solid"}, {"max_depth", 4}});
  Evaluator evaluator(compile(graph));
  const auto parts = evaluator.get<Surface>("exact.surface", 2), whole = evaluator.get<Surface>("whole.surface", 2);
  EXPECT_EQ(std::memcmp(parts.points.host().data(), whole.points.host().data(), parts.points.bytes()), 0);
  EXPECT_EQ(evaluator.get<Report>("whole.report", 2).word("ended"), "at rest");
  EXPECT_EQ(evaluator.get<Report>("whole.report", 2).number("vertices_inside"), 0);
}

TEST(EquilibriumCascade, IsTwoOfTheOneNodeFormToo) {
  GraphSpec graph = pressed();
  graph
      .add("first", "deform_equilibrium",
           {{"surface", "body"}, {"sdf", "solid"}, {"max_depth", 3}, {"threshold", 1e-2}, {"displacement", 1e-2}, {"penetration", 2e-2}})
      .add("whole", "deform_equilibrium", {{"surface", "body"}, {"sdf", "solid"}, {"max_depth", 4}, {"start", "first.state"}})
      .add(
          "second", "equilibrium",
          {{"surface", "body"}, {"sdf", "solid"}, {"tets", "tets"}, {"lattice", "tets.lattice"}, {"inside", "tets.inside"}, {"start", "first.state"}})
      .add("exact", "collide_sdf", {{"mode", "project"}, {"surface", "second"}, {"sdf", "solid"}, {"samples", 8}});
  Evaluator evaluator(compile(graph));
  EXPECT_EQ(evaluator.get<Report>("first.report", 2).word("started"), "rest");
  EXPECT_GT(evaluator.get<Report>("first.report", 2).number("last_step"), 2e-5);  // it may end there
  EXPECT_EQ(evaluator.get<Report>("whole.report", 2).word("started"), "state");
  const auto parts = evaluator.get<Surface>("exact.surface", 2), whole = evaluator.get<Surface>("whole.surface", 2);
  EXPECT_EQ(std::memcmp(parts.points.host().data(), whole.points.host().data(), parts.points.bytes()), 0);
}

}  // namespace equilibrium_test
}  // namespace knead
