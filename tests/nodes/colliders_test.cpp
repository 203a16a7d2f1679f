// Colliders that are not fat solids of the body's own size: much larger ones, slabs, planes, sheets, bowls, and very many. The whole job, by both methods.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "graph/evaluator.h"
#include "io/graph_file.h"
#include "kernels/port_types.h"
#include "tests/graph/fake_device.h"
#include "tests/paths.h"

namespace knead {
namespace colliders_test {

using testing::HasSubstr;
namespace fs = std::filesystem;

struct Result {
  std::vector<Vec3d> points;  // world
  Report report;
  std::string warnings;
  double lowest = 1e300, highest = -1e300, widest = 0;
};

// `nodes` makes `body` and what `sdf` names; both methods see the same.
std::string graph_of(const std::string& nodes, const std::string& sdf, const std::string& press) {
  return "knead: 1\nframes: 1-4\nnodes:\n" + nodes + "  press: {type: " + press + ", surface: body, sdf: " + sdf + "}\n";
}

Result run(const std::string& graph, int frame = 1, Executor* executor = nullptr) {
  EvaluatorOptions options;
  options.executor = executor;
  Evaluator evaluator(compile(read_graph_text(graph, "scene.yaml"), graph_file_options()), options);
  const FrameResult frame_result = evaluator.evaluate(frame, {"press.surface", "press.report"});
  EXPECT_FALSE(frame_result.error) << frame_result.error->what();
  Result result;
  if (frame_result.error) return result;
  const Surface& surface = frame_result.values.at("press.surface").as<Surface>();
  for (const Vec3f& p : surface.points.host()) {
    result.points.push_back(surface.placement.apply(to_double(p)));
    result.lowest = std::min(result.lowest, result.points.back().y);
    result.highest = std::max(result.highest, result.points.back().y);
    result.widest = std::max(result.widest, std::abs(result.points.back().x));
  }
  result.report = frame_result.values.at("press.report").as<Report>();
  for (const std::string& warning : frame_result.warnings) result.warnings += warning + "\n";
  return result;
}

double apart(const Result& a, const Result& b) {
  EXPECT_EQ(a.points.size(), b.points.size());
  double most = 0;
  for (size_t i = 0; i < std::min(a.points.size(), b.points.size()); ++i) most = std::max(most, length(a.points[i] - b.points[i]));
  return most;
}

const char* const kBody = "  body: {type: primitive, shape: sphere, radius: 1, resolution: 4}\n";
const char* const kEquilibrium = "deform_equilibrium, max_depth: 5";
constexpr double kDiagonal = 3.4641;

// A ball of 1 that something flat presses 0.2 deep from above or below.
void expect_flat_dent(const Result& result, double depth_error, const std::string& what) {
  EXPECT_NEAR(result.highest - result.lowest, 1.8, depth_error + 0.06) << what;  // the other side gives way a little
  EXPECT_GT(result.widest, 1.005) << what << ": it bulges";
  EXPECT_LT(std::abs(result.report.number("volume_error")), 1e-3) << what;
  EXPECT_EQ(result.report.number("inverted_tets"), 0) << what;
  EXPECT_EQ(result.report.word("ended"), "at rest") << what;
}

TEST(Colliders, MuchLargerThanTheBodyDentItAsAPlaneDoes) {
  const Result flat = run(graph_of(std::string(kBody) + "  solid: {type: plane, point: [0, 0.8, 0], normal: [0, -1, 0]}\n", "solid", kEquilibrium));
  EXPECT_NEAR(flat.highest, 0.8, 2e-3);  // what is pressed lightly keeps some of the gap
  expect_flat_dent(flat, 0.01, "plane");
  EXPECT_EQ(flat.warnings, "");
  for (const int radius : {50, 500, 5000}) {
    std::ostringstream wall;
    // A facet's middle is nearer to the ball's centre than its corners: 20 * 4^5 facets sag by 4e-4 of the radius. So the ball stands by its corner.
    wall << "  wall: {type: primitive, shape: sphere, radius: " << radius << ", resolution: 6, centre: [0, " << radius + 0.8 << ", 0]}\n"
         << "  solid: {type: mesh_to_sdf, mesh: wall}\n";
    const Result result = run(graph_of(kBody + wall.str(), "solid", kEquilibrium));
    expect_flat_dent(result, 0.2, "radius " + std::to_string(radius));
    EXPECT_EQ(result.report.number("vertices_inside"), 0) << radius;
  }
}

TEST(Colliders, ThatAreSlabsOfFewTrianglesDentAsAPlaneDoes) {
  const std::string slab =
      "  wall: {type: primitive, shape: box, size: [100, 0.1, 100], resolution: 1, centre: [0, -0.85, 0]}\n  solid: {type: mesh_to_sdf, mesh: "
      "wall}\n";
  const std::string floor = "  solid: {type: plane, point: [0, -0.8, 0]}\n";
  for (const std::string press : {kEquilibrium, "deform, max_depth: 5, hold: 0.01"}) {
    const Result by_slab = run(graph_of(kBody + slab, "solid", press)), by_plane = run(graph_of(kBody + floor, "solid", press));
    EXPECT_GT(by_slab.lowest, -0.8001) << press;
    EXPECT_EQ(by_slab.report.number("penetration_max"), 0) << press;
    EXPECT_GT(by_slab.widest, 1.005) << press;
    EXPECT_LT(apart(by_slab, by_plane), 0.02 * 0.2) << press;
    EXPECT_THAT(by_slab.warnings, testing::Not(HasSubstr("inside others"))) << press;
  }
}

TEST(Colliders, ThatAreSheetsHoldTheBodyOnItsSide) {
  const fs::path folder = fs::temp_directory_path() / "knead_colliders_test";
  fs::create_directories(folder);
  // Facing up, facing down, and in many pieces; above it and below it is where most of the body is.
  const auto sheet = [&](const std::string& name, int pieces, bool down) {
    std::ofstream file(folder / name);
    for (int i = 0; i <= pieces; ++i)
      for (int k = 0; k <= pieces; ++k) file << "v " << -4 + 8.0 * i / pieces << " -0.8 " << -4 + 8.0 * k / pieces << "\n";
    for (int i = 0; i < pieces; ++i)
      for (int k = 0; k < pieces; ++k) {
        const int a = i * (pieces + 1) + k + 1, b = a + 1, c = b + pieces + 1, d = a + pieces + 1;
        file << "f " << a << ' ' << (down ? d : b) << ' ' << c << ' ' << (down ? b : d) << "\n";
      }
    return (folder / name).string();
  };
  const Result by_plane = run(graph_of(std::string(kBody) + "  solid: {type: plane, point: [0, -0.8, 0]}\n", "solid", kEquilibrium));
  for (const std::string& path : {sheet("up.obj", 1, false), sheet("down.obj", 1, true), sheet("many.obj", 20, false)}) {
    const Result result = run(graph_of(
        std::string(kBody) + "  floor: {type: read_mesh, path: " + path + "}\n  solid: {type: mesh_to_sdf, mesh: floor}\n", "solid", kEquilibrium));
    EXPECT_GT(result.lowest, -0.801) << path;
    EXPECT_LT(apart(result, by_plane), 0.02 * 0.2) << path;
    EXPECT_THAT(result.warnings, HasSubstr("thickness")) << path;
    EXPECT_THAT(result.warnings, HasSubstr("solid: solid")) << path;
  }
}

// A hemisphere of radius `radius`, open at the top, around the body.
std::string bowl(double radius, const std::string& name) {
  const fs::path folder = fs::temp_directory_path() / "knead_colliders_test";
  fs::create_directories(folder);
  const fs::path path = folder / name;
  std::ofstream file(path);
  constexpr int kRows = 12, kColumns = 36;
  file << "v 0 " << -radius << " 0\n";
  for (int i = 1; i <= kRows; ++i)
    for (int j = 0; j < kColumns; ++j) {
      const double down = M_PI_2 * i / kRows, turn = 2 * M_PI * j / kColumns;
      file << "v " << radius * std::sin(down) * std::cos(turn) << ' ' << -radius * std::cos(down) << ' ' << radius * std::sin(down) * std::sin(turn)
           << "\n";
    }
  const auto at = [&](int i, int j) { return 2 + (i - 1) * kColumns + j % kColumns; };
  for (int j = 0; j < kColumns; ++j) {
    file << "f 1 " << at(1, j) << ' ' << at(1, j + 1) << "\n";
    for (int i = 1; i < kRows; ++i) file << "f " << at(i, j) << ' ' << at(i + 1, j) << ' ' << at(i + 1, j + 1) << ' ' << at(i, j + 1) << "\n";
  }
  return path.string();
}

TEST(Colliders, ThatAreBowlsHoldWhatIsInThem) {
  const auto press_into = [&](double radius, const std::string& solid) {
    return run(graph_of(std::string(kBody) + "  dish: {type: read_mesh, path: " + bowl(radius, "bowl.obj") +
                            "}\n  solid: {type: mesh_to_sdf, mesh: dish" + solid + "}\n",
                        "solid", kEquilibrium));
  };
  const Result loose = press_into(1.2, "");
  double moved = 0;
  for (const Vec3d& p : loose.points) moved = std::max(moved, std::abs(length(p) - 1));
  EXPECT_LT(moved, 1e-6) << "nothing touches";
  const Result tight = press_into(0.97, "");
  double lower_half = 0;
  for (const Vec3d& p : tight.points)
    if (p.y < -0.1) lower_half = std::max(lower_half, length(p));
  EXPECT_LT(lower_half, 0.972);
  EXPECT_GT(lower_half, 0.94);
  EXPECT_LT(std::abs(tight.report.number("volume_error")), 1e-3);
  EXPECT_LT(tight.highest, 1.2) << "not squeezed out";
}

TEST(Colliders, ThatMoveWithTheBodyKeepTheirFields) {
  // In every frame both are in another place, turned alike: the same shape.
  const std::string nodes =
      "  ball: {type: primitive, shape: sphere, radius: 1, resolution: 3}\n"
      "  slab: {type: primitive, shape: box, size: [100, 1, 100], resolution: 1, centre: [0, -1.3, 0]}\n"
      "  floor: {type: transform, mesh: slab, keys: {1: {}, 4: {translate: [30, 2, 1], rotate: [20, 0, 50]}}}\n"
      "  body: {type: transform, mesh: ball, keys: {1: {}, 4: {translate: [30, 2, 1], rotate: [20, 0, 50]}}}\n"
      "  solid: {type: mesh_to_sdf, mesh: floor}\n";
  const std::string graph = graph_of(nodes, "solid", "deform_equilibrium, max_depth: 4");
  Evaluator evaluator(compile(read_graph_text(graph, "scene.yaml"), graph_file_options()));
  const Surface first = evaluator.get<Surface>("press.surface", 1), last = evaluator.get<Surface>("press.surface", 4);
  double apart = 0, dent = 0;
  const Surface rest = evaluator.get<Surface>("ball", 1);
  for (size_t i = 0; i < first.points.size(); ++i) {
    apart = std::max(apart, static_cast<double>(length(first.points.host()[i] - last.points.host()[i])));
    dent = std::max(dent, static_cast<double>(length(first.points.host()[i] - rest.points.host()[i])));
  }
  EXPECT_GT(dent, 0.1);
  EXPECT_LT(apart, 0.01 * dent);
}

TEST(Colliders, ThatAreTooCoarseAndNotKnownExactlyAreSaidToBe) {
  const fs::path folder = fs::temp_directory_path() / "knead_colliders_test";
  fs::create_directories(folder);
  const std::string path = (folder / "wall.vdb").string();
  const std::string write =
      "knead: 1\nframes: 1\nnodes:\n  wall: {type: primitive, shape: sphere, radius: 30, resolution: 4, centre: [0, 30.8, 0]}\n"
      "  solid: {type: mesh_to_sdf, mesh: wall, resolution: 40}\n  file: {type: write_vdb, sdf: solid, path: " +
      path + "}\n";
  const FrameResult written = Evaluator(compile(read_graph_text(write, "write.yaml"), graph_file_options())).evaluate(1, {}, true);
  ASSERT_FALSE(written.error) << written.error->what();
  for (const std::string press : {"deform_equilibrium, max_depth: 4", "deform, max_depth: 4"}) {
    const Result result = run(graph_of(std::string(kBody) + "  solid: {type: read_vdb, path: " + path + "}\n", "solid", press));
    EXPECT_THAT(result.warnings, HasSubstr("coarser than the edges of the body")) << press;
    EXPECT_THAT(result.warnings, HasSubstr("1.5")) << press << ": the voxels";
  }
}

// 30 balls in a ring around the body, some of which touch it.
std::string ring(int count) {
  std::ostringstream nodes;
  nodes << "  ball: {type: primitive, shape: sphere, radius: 0.1, resolution: 2}\n";
  for (int k = 0; k < count; ++k) {
    const double turn = 2 * M_PI * k / count, away = k % 3 == 0 ? 1.05 : 1.4;
    nodes << "  b" << k << ": {type: transform, mesh: ball, keys: {1: {translate: [" << away * std::cos(turn) << ", " << away * std::sin(turn)
          << ", 0]}}}\n  s" << k << ": {type: mesh_to_sdf, mesh: b" << k << ", resolution: 16}\n";
  }
  return nodes.str();
}
std::string all_of(int count) {
  std::string list = "[";
  for (int k = 0; k < count; ++k) list += (k ? ", s" : "s") + std::to_string(k);
  return list + "]";
}

TEST(Colliders, AreAsManyAsOneLikes) {
  for (const std::string press : {"deform_equilibrium, max_depth: 4", "deform, max_depth: 4, max_iterations: 60"}) {
    const Result result = run(graph_of(std::string(kBody) + ring(60), all_of(60), press));
    EXPECT_EQ(result.report.number("vertices_inside"), 0) << press;
    EXPECT_GT(result.report.number("displacement_max"), 0.03) << press;
  }
}

TEST(Colliders, AreAsManyAsOneLikesInALoopOnADevice) {
  const std::string graph = graph_of("  body: {type: primitive, shape: sphere, radius: 1, resolution: 3}\n" + ring(30), all_of(30),
                                     "deform, max_depth: 3, max_iterations: 20");
  const auto serial = make_serial_executor();
  fake_device::FakeDevice fake;
  const Result here = run(graph, 1, serial.get()), there = run(graph, 1, &fake.executor);
  ASSERT_EQ(here.points.size(), there.points.size());
  EXPECT_EQ(std::memcmp(here.points.data(), there.points.data(), here.points.size() * sizeof(Vec3d)), 0);
  EXPECT_EQ(fake.executor.figures().loops, 1u) << "it stays there";
}

TEST(Colliders, MuchLargerThanTheBodyAreTheSameInALoopOnADevice) {
  const std::string graph = graph_of(
      "  body: {type: primitive, shape: sphere, radius: 1, resolution: 3}\n"
      "  slab: {type: primitive, shape: box, size: [100, 0.1, 100], resolution: 1, centre: [0, -0.85, 0]}\n  solid: {type: mesh_to_sdf, mesh: "
      "slab}\n",
      "solid", "deform, max_depth: 3, max_iterations: 20");
  const auto serial = make_serial_executor();
  fake_device::FakeDevice fake;
  const Result here = run(graph, 1, serial.get()), there = run(graph, 1, &fake.executor);
  ASSERT_EQ(here.points.size(), there.points.size());
  EXPECT_EQ(std::memcmp(here.points.data(), there.points.data(), here.points.size() * sizeof(Vec3d)), 0);
  EXPECT_EQ(fake.executor.figures().loops, 1u) << "it stays there";
  EXPECT_GT(here.report.number("displacement_max"), 0.1);
}

// The graphs that were seen to fail.
class CollidersOfCases : public testing::TestWithParam<const char*> {};

TEST_P(CollidersOfCases, DentTheBody) {
  const fs::path graph = fs::path(shared_data()) / ".." / "cases" / GetParam() / "graph.yaml";
  if (!fs::exists(graph)) GTEST_SKIP() << "no " << graph;
  Evaluator evaluator(compile(read_graph_file(graph.string()), graph_file_options()));
  const FrameResult result = evaluator.evaluate(1, {"press.surface", "press.report"});
  ASSERT_FALSE(result.error) << result.error->what();
  const Surface& surface = result.values.at("press.surface").as<Surface>();
  double lowest = 1e300, widest = 0;
  for (const Vec3f& p : surface.points.host()) {
    const Vec3d at = surface.placement.apply(to_double(p));
    lowest = std::min(lowest, at.y);
    widest = std::max(widest, std::abs(at.x));
  }
  const Report& report = result.values.at("press.report").as<Report>();
  EXPECT_EQ(report.number("penetration_max"), 0);
  EXPECT_LT(std::abs(report.number("volume_error")), 1e-3);
  EXPECT_EQ(report.number("inverted_tets"), 0);
  const std::string name = GetParam();
  if (name == "collider_much_larger_than_body") EXPECT_GT(widest, 1.005);
  if (name == "thin_slab_large_faces") EXPECT_GT(lowest, -0.8001);
  if (name == "sheet_as_floor") EXPECT_GT(lowest, -0.801);
}

INSTANTIATE_TEST_SUITE_P(Shared, CollidersOfCases,
                         testing::Values("collider_much_larger_than_body", "thin_slab_large_faces", "sheet_as_floor", "more_than_24_colliders"));

}  // namespace colliders_test
}  // namespace knead
