#include <gtest/gtest.h>

#include <numbers>

#include "kernels/shapes/primitives.h"
#include "tests/nodes/direct_run.h"

namespace knead {
void register_build_tets(Registry&);

namespace build_tets_test {

direct::DirectRun node(const Literal::Map& parameters = {}) {
  return direct::DirectRun(register_build_tets, "build_tets", parameters);
}

TEST(BuildTets, GivesTetsLatticePointsAndFigures) {
  auto run = node();
  const Surface sphere = make_sphere(1, 3);
  run.give("surface", sphere).at(1);
  const TetMesh& tets = run.result<TetMesh>(0);
  EXPECT_GT(tets.vertices(), 100u);
  EXPECT_TRUE(std::ranges::equal(run.result<Lattice>(1).tet_rest.host(), tets.rest.host(),
                                 [](const Vec3f& a, const Vec3f& b) { return a.x == b.x && a.y == b.y && a.z == b.z; }));
  EXPECT_EQ(run.result<Points>(2).values.id(), tets.rest.id());
  const Report& report = run.result<Report>(4);
  EXPECT_EQ(report.number("vertices"), static_cast<double>(tets.vertices()));
  EXPECT_EQ(report.number("tets"), static_cast<double>(tets.tets.size()));
  EXPECT_NEAR(report.number("surface_volume"), 4.0 / 3 * std::numbers::pi, 0.05);
  EXPECT_GT(report.number("tet_volume"), report.number("surface_volume"));
  EXPECT_EQ(report.number("pieces_split"), 0);
  EXPECT_GT(report.number("build_milliseconds"), 0);
  EXPECT_TRUE(run.warnings.empty());
}

// Two frames that share what is computed once, as the evaluator's cache does.
class SharedFrames final : public Context {
 public:
  explicit SharedFrames(const Node& node) : executor_(make_serial_executor()), outputs_(node.outputs().size()) {}
  void run(const Node& node, const Surface& surface) {
    surface_ = Value::of(surface);
    node.evaluate(*this);
  }
  template <class T>
  const T& result(size_t output) const {
    return outputs_[output].as<T>();
  }
  int made = 0;

  int frame() const override { return 1; }
  Executor& executor() const override { return *executor_; }
  bool cancelled() const override { return false; }
  void warn(const std::string&) override {}
  void add_time(const std::string&, double) override {}
  Value once(const Key& key, FunctionRef<Value()> make) override {
    if (!once_.contains(key)) {
      ++made;
      once_[key] = make();
    }
    return once_[key];
  }
  const Value& input(int, size_t) const override { return surface_; }
  size_t input_count(int) const override { return 1; }
  void set_output(int port, Value value) override { outputs_[static_cast<size_t>(port)] = std::move(value); }

 private:
  std::unique_ptr<Executor> executor_;
  Value surface_;
  std::vector<Value> outputs_;
  std::map<Key, Value> once_;
};

TEST(BuildTets, BuildsOnceForARigidMotionAndPlacesTheLattice) {
  Registry registry;
  register_build_tets(registry);
  const auto built = registry.find("build_tets")->make();
  SharedFrames frames(*built);
  Surface sphere = make_sphere(1, 2);
  frames.run(*built, sphere);
  const uint64_t tets = frames.result<TetMesh>(0).tets.id();
  const double volume = frames.result<Report>(4).number("surface_volume");
  sphere.placement.translation = {5, 0, 0};
  sphere.placement.scale = 2;
  frames.run(*built, sphere);
  EXPECT_EQ(frames.made, 1);
  EXPECT_EQ(frames.result<TetMesh>(0).tets.id(), tets);
  EXPECT_EQ(frames.result<Lattice>(1).rest.placement, sphere.placement);
  EXPECT_NEAR(frames.result<Report>(4).number("surface_volume"), 8 * volume, 1e-6);
  frames.run(*built, make_sphere(1, 2));  // other points, though equal ones
  EXPECT_EQ(frames.made, 2);
}

TEST(BuildTets, ParametersReachTheKernel) {
  const Surface sphere = make_sphere(1, 3);
  const auto vertices = [&](const Literal::Map& parameters) {
    auto run = node(parameters);
    run.give("surface", sphere).at(1);
    return run.result<Report>(4).number("vertices");
  };
  EXPECT_LT(vertices({{"max_depth", 3}}), vertices({{"max_depth", 5}, {"max_vertices", 1}}));
  EXPECT_LT(vertices({{"max_depth", 2}}), vertices({{"max_depth", 3}, {"min_depth", 3}}));
  EXPECT_LT(vertices({{"max_vertices", 100}}), vertices({{"max_vertices", 1}}));
  const auto row_length = [&](const char* kind) {
    auto run = node({{"lattice", kind}});
    run.give("surface", sphere).at(1);
    return run.result<Lattice>(1).map.largest;
  };
  EXPECT_EQ(row_length("barycentric"), 4u);
  EXPECT_EQ(row_length("trilinear"), 8u);
  EXPECT_GE(row_length("mean_value"), 8u);
}

TEST(BuildTets, SaysWhereTheDepthThatWasAskedForIsNotReached) {
  const Surface sphere = make_sphere(1, 3);
  const auto warnings = [&](const Literal::Map& parameters, double depth) {
    auto run = node(parameters);
    run.give("surface", sphere).at(1);
    EXPECT_EQ(run.result<Report>(4).number("depth"), depth);
    return run.warnings;
  };
  const std::vector<std::string> said = warnings({{"max_depth", 7}}, 4);
  ASSERT_EQ(said.size(), 1u);
  for (const char* part : {"depth 4", "max_depth 7", "max_vertices = 4", "surface_depth"}) EXPECT_NE(said[0].find(part), std::string::npos) << part;
  EXPECT_TRUE(warnings({{"max_depth", 7}, {"surface_depth", 7}}, 7).empty());
  EXPECT_TRUE(warnings({{"max_depth", 7}, {"min_depth", 7}}, 7).empty());
  EXPECT_TRUE(warnings({}, 4).empty()) << "nobody asked";
}

TEST(BuildTets, PassesWarningsOnAndRefusesAMinDepthAboveTheMaxDepth) {
  Surface open = make_sphere(1, 2);
  std::vector<uint32_t> triangles = open.topology->triangles;
  triangles.resize(triangles.size() - 9);
  auto run = node();
  run.give("surface", make_triangle_surface({open.points.host().begin(), open.points.host().end()}, triangles)).at(1);
  EXPECT_EQ(run.warnings.size(), 1u);
  EXPECT_THROW(node({{"max_depth", 4}, {"min_depth", 5}}), Error);
  EXPECT_NO_THROW(node({{"max_depth", 2}}));
  auto empty = node();
  empty.give("surface", Surface{});
  EXPECT_THROW(empty.at(1), Error);
}

}  // namespace build_tets_test
}  // namespace knead
