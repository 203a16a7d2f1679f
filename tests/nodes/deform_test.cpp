#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>

#include "graph/evaluator.h"
#include "graph/report.h"
#include "kernels/port_types.h"

namespace knead {
namespace deform_test {

// A ball over a blob, touching it in frame 2 only.
GraphSpec scene(Literal::Map more = {}) {
  GraphSpec graph;
  graph.add("body", "primitive", {{"shape", "sphere"}, {"radius", 1.0}, {"resolution", 3}})
      .add("ball", "primitive", {{"shape", "sphere"}, {"radius", 0.5}, {"resolution", 3}})
      .add("motion", "transform",
           {{"mesh", "ball"},
            {"keys",
             Literal::Map{{1, Literal::Map{{"translate", Literal::List{0, 3, 0}}}}, {2, Literal::Map{{"translate", Literal::List{0.0, 1.2, 0.0}}}}}}})
      .add("solid", "mesh_to_sdf", {{"mesh", "motion"}, {"voxel_size", 0.05}});
  Literal::Map arguments{{"surface", "body"}, {"sdf", "solid"}, {"max_depth", 4}, {"max_iterations", 40}};
  arguments.insert(arguments.end(), more.begin(), more.end());
  return graph.add("press", "deform", std::move(arguments));
}

TEST(Deform, LeavesASurfaceWithoutContactUntouched) {
  Evaluator evaluator(compile(scene()));
  const auto body = evaluator.get<Surface>("body", 1), result = evaluator.get<Surface>("press.surface", 1);
  ASSERT_EQ(body.points.size(), result.points.size());
  EXPECT_EQ(std::memcmp(body.points.host().data(), result.points.host().data(), body.points.bytes()), 0);
}

TEST(Deform, LeavesNothingInsideTheCollider) {
  Evaluator evaluator(compile(scene()));
  const auto result = evaluator.get<Surface>("press.surface", 2);
  double nearest = 1e9;
  for (const Vec3f& point : result.points.host()) nearest = std::min(nearest, length(result.placement.apply(to_double(point)) - Vec3d{0, 1.2, 0}));
  EXPECT_GT(nearest, 0.49) << "the ball is a polyhedron, a little smaller than its sphere";
  EXPECT_LT(nearest, 0.52) << "and in contact";
  const Report report = evaluator.get<Report>("press.report", 2);
  EXPECT_EQ(report.number("vertices_inside"), 0);
  EXPECT_EQ(report.number("inverted_tets"), 0);
  EXPECT_GT(report.number("iterations"), 1);
  EXPECT_FALSE(report.word("ended").empty());
}

// The ball is in beyond its middle, so that the nearest way out for the body's top is up, through the ball. It has to come in from above and end in its
// place: the top goes below it.
TEST(Deform, LetsAColliderThatIsInDeepComeInFromOutside) {
  GraphSpec graph;
  graph.add("body", "primitive", {{"shape", "sphere"}, {"radius", 1.0}, {"resolution", 4}})
      .add("ball", "primitive", {{"shape", "sphere"}, {"radius", 0.3}, {"resolution", 3}, {"centre", Literal::List{0.0, 0.85, 0.0}}})
      .add("solid", "mesh_to_sdf", {{"mesh", "ball"}, {"voxel_size", 0.03}})
      .add("press", "deform", {{"surface", "body"}, {"sdf", "solid"}, {"max_depth", 5}});
  const auto above = [&](bool way_in) {
    CompileOptions options;
    options.overrides.push_back({"press.way.way_in", way_in});
    Evaluator evaluator(compile(graph, options));
    const Surface body = evaluator.get<Surface>("body", 1), result = evaluator.get<Surface>("press.surface", 1);
    EXPECT_EQ(evaluator.get<Report>("press.report", 1).number("vertices_inside"), 0);
    size_t top = 0;
    for (size_t i = 0; i < body.points.size(); ++i)
      if (body.points.host()[i].y > body.points.host()[top].y) top = i;
    const Vec3d at = result.placement.apply(to_double(result.points.host()[top]));
    return std::pair(at.y, length(at - Vec3d{0, 0.85, 0}));
  };
  const auto [height, distance] = above(true);
  EXPECT_LT(height, 0.65);
  EXPECT_LT(distance, 0.32) << "the ball is in its place, and in contact";
  EXPECT_GT(above(false).first, 1.05) << "the nearest way is the wrong one, or this test shows nothing";
}

TEST(Deform, KeepsPinnedVerticesInPlace) {
  GraphSpec graph = scene({{"pins", "low"}});
  graph.add("low", "weights",
            {{"surface", "body"}, {"region", "plane"}, {"normal", Literal::List{0, 1, 0}}, {"point", Literal::List{0.0, -0.5, 0.0}}});
  Evaluator evaluator(compile(graph));
  const auto body = evaluator.get<Surface>("body", 2), result = evaluator.get<Surface>("press.surface", 2);
  double low = 0, high = 0;
  for (size_t i = 0; i < body.points.size(); ++i) {
    const Vec3d before = to_double(body.points.host()[i]);
    double& moved = before.y < -0.5 ? low : high;
    moved = std::max(moved, length(to_double(result.points.host()[i]) - before));
  }
  EXPECT_LT(low, 1e-6);
  EXPECT_GT(high, 0.05);
}

Literal another(const Literal& value) {
  if (const bool* flag = value.as_bool()) return !*flag;
  if (const int64_t* number = value.as_int()) return *number + 1;
  if (value.is_number()) return value.number() * 0.75 + 0.01;
  return "trilinear";
}

TEST(Deform, HandsEveryParameterToAnInnerNode) {
  const auto key_of = [](const std::string& name, const Literal& value) {
    GraphSpec graph = scene();
    for (auto& [argument, was] : graph.nodes.back().arguments)
      if (argument.text() == Literal(name).text()) {
        was = value;
        return Evaluator(compile(graph)).frame_key(2, {"press.surface", "press.report"}, false);
      }
    graph.nodes.back().arguments.emplace_back(name, value);
    return Evaluator(compile(graph)).frame_key(2, {"press.surface", "press.report"}, false);
  };
  const GraphSpec group = Registry::builtin().find("deform")->group();
  ASSERT_GE(group.parameters.size(), 10u);
  for (const GroupParameterSpec& parameter : group.parameters)
    EXPECT_NE(key_of(parameter.name, another(parameter.value)), key_of(parameter.name, parameter.value)) << parameter.name;
}

TEST(Deform, TakesNoColliderAtAll) {
  GraphSpec graph;
  graph.add("body", "primitive", {{"shape", "sphere"}, {"resolution", 2}}).add("press", "deform", {{"surface", "body"}, {"max_depth", 3}});
  const auto result = Evaluator(compile(graph)).get<Surface>("press", 1);
  EXPECT_EQ(result.points.size(), 162u);
}

TEST(Deform, NamesAWrongParameterByItsOwnName) {
  try {
    compile(scene({{"stifness", 0.5}}));
    FAIL() << "expected an error";
  } catch (const GraphErrors& errors) {
    EXPECT_THAT(errors.what(), testing::HasSubstr("did you mean 'stiffness'?"));
  }
}

}  // namespace deform_test
}  // namespace knead
