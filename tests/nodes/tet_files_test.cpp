// write_tets and read_tets: H out to a file and in again, and an H from elsewhere under both solvers.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "graph/evaluator.h"
#include "io/graph_file.h"
#include "io/tets/tet_file.h"
#include "kernels/build_tets/bind_tets.h"
#include "kernels/shapes/primitives.h"

namespace knead {
namespace tet_files_test {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

std::string at(const std::string& name) {
  const std::filesystem::path folder = std::filesystem::temp_directory_path() / "knead_tet_files_test";
  std::filesystem::create_directories(folder);
  return (folder / name).string();
}

// A block of cubes of six tets each, jittered: no grid of build_tets'.
GivenTets block(double half, int cells) {
  GivenTets made;
  const int n = cells + 1;
  uint32_t noise = 1;
  const auto jitter = [&](int i) {
    noise = noise * 1664525u + 1013904223u;
    return i == 0 || i == cells ? 0 : 0.3 * (static_cast<double>(noise >> 8) / (1 << 24) - 0.5);
  };
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j)
      for (int k = 0; k < n; ++k) {
        const double side = 2 * half / cells;
        made.points.push_back({-half + side * (i + jitter(i)), -half + side * (j + jitter(j)), -half + side * (k + jitter(k))});
      }
  const auto number = [&](int i, int j, int k) { return static_cast<uint32_t>((i * n + j) * n + k); };
  constexpr int kWays[6][3] = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}};
  for (int i = 0; i < cells; ++i)
    for (int j = 0; j < cells; ++j)
      for (int k = 0; k < cells; ++k)
        for (const auto& way : kWays) {
          std::array<int, 3> corner{i, j, k};
          std::array<uint32_t, 4> tet;
          tet[0] = number(i, j, k);
          for (size_t step = 0; step < 3; ++step) {
            ++corner[static_cast<size_t>(way[step])];
            tet[step + 1] = number(corner[0], corner[1], corner[2]);
          }
          made.tets.push_back(tet);  // half of them inside out
        }
  return made;
}

std::string refusal(const Surface& surface, GivenTets given, double tolerance = 0.01) {
  std::vector<std::string> warnings;
  try {
    bind_tets(surface, std::move(given), tolerance, *make_serial_executor(), warnings);
  } catch (const Error& e) {
    return e.what();
  }
  return "";
}

TEST(BindTets, TiesEveryVertexToItsOwnPlace) {
  const Surface ball = make_sphere(1, 3);
  std::vector<std::string> warnings;
  const BoundTets bound = bind_tets(ball, block(1.1, 5), 0, *make_serial_executor(), warnings);
  EXPECT_THAT(warnings, ElementsAre(HasSubstr("tets were inside out and turned")));
  const auto& [tets, lattice] = std::tie(bound.build.tets, bound.build.lattice);
  for (const float volume : tets.rest_volumes.host()) EXPECT_GT(volume, 0);
  EXPECT_NEAR(bound.build.tet_volume, 2.2 * 2.2 * 2.2, 1e-9);
  const NeighbourTable& map = lattice.map;
  for (uint32_t lane = 0; lane < ball.vertices(); ++lane) {
    Vec3d sum{0, 0, 0};
    const uint32_t begin = map.block_offsets.host()[lane / 16] + lane % 16;
    for (uint32_t k = 0; k < map.valence.host()[lane]; ++k)
      sum += static_cast<double>(map.values.host()[begin + 16 * k]) * to_double(tets.rest.host()[map.indices.host()[begin + 16 * k]]);
    EXPECT_LT(length(tets.to_local.apply(sum) - to_double(ball.points.host()[map.order.host()[lane]])), 1e-5);
  }
}

TEST(BindTets, LeavesOutWhatIsNoTetAndSaysSo) {
  GivenTets given = block(1.1, 3);
  given.tets.push_back({0, 1, 2, 2});
  given.points.push_back({9, 9, 9});
  std::vector<std::string> warnings;
  bind_tets(make_sphere(1, 2), given, 0, *make_serial_executor(), warnings);
  EXPECT_THAT(warnings,
              ElementsAre(HasSubstr("1 tet has no volume and is left out"), HasSubstr("inside out"), HasSubstr("1 vertex of the tet mesh")));
}

TEST(BindTets, TakesVerticesJustOutsideAndRefusesOthers) {
  const Surface ball = make_sphere(1, 3);
  std::vector<std::string> warnings;
  const BoundTets bound = bind_tets(ball, block(0.99, 4), 0.02, *make_serial_executor(), warnings);
  EXPECT_GT(bound.outside, 0u);
  EXPECT_NEAR(bound.furthest, 0.01, 1e-6);
  EXPECT_THAT(warnings.back(), HasSubstr("of the surface outside the tet mesh"));
  EXPECT_THAT(refusal(ball, block(0.9, 4)), HasSubstr("lie outside the tet mesh"));
  GivenTets bad = block(1.1, 2);
  bad.points[3].x = NAN;
  EXPECT_THAT(refusal(ball, bad), HasSubstr("not finite"));
  EXPECT_THAT(refusal(ball, {{{0, 0, 0}}, {{0, 0, 0, 0}}}), HasSubstr("no tet with a volume"));
}

FrameResult run(const std::string& text, const std::vector<std::string>& outputs = {}) {
  return Evaluator(compile(read_graph_text(text.c_str(), "tets.yaml"), graph_file_options())).evaluate(1, outputs, true);
}

std::string scene(const std::string& middle) {
  return R"(knead: 1
frames: 1
nodes:
  body: {type: primitive, shape: sphere, radius: 1, resolution: 3}
  tool: {type: primitive, shape: sphere, radius: 0.5, resolution: 3, centre: [0, 0, 1.3]}
  solid: {type: mesh_to_sdf, mesh: tool, voxel_size: 0.05}
)" + middle;
}

TEST(WriteTets, WritesWhatReadTetsReads) {
  for (const char* extension : {"vtu", "vtk", "msh"}) {
    const std::string path = at(std::string("own.") + extension);
    FrameResult out = run(scene(
        "  h: {type: build_tets, surface: body, max_depth: 4}\n  o: {type: write_tets, tets: h.tets, points: h.points, lattice: h.lattice, path: '" +
        path + "'}\n"));
    ASSERT_FALSE(out.error) << out.error->what();
    std::vector<std::string> warnings;
    const TetFile file = read_tet_file(path, warnings);
    FrameResult in = run(scene("  h: {type: read_tets, surface: body, path: '" + path +
                               "'}\n  o: {type: write_tets, tets: h.tets, lattice: h.lattice, path: '" + at("again.vtu") + "'}\n"));
    ASSERT_FALSE(in.error) << in.error->what();
    const TetFile again = read_tet_file(at("again.vtu"), warnings);
    EXPECT_THAT(warnings, IsEmpty());
    EXPECT_EQ(again.points.size(), file.points.size());
    EXPECT_EQ(again.tets.size(), file.tets.size());
  }
}

TEST(ReadTets, GivesBothSolversAnHFromElsewhere) {
  GivenTets given = block(1.1, 6);
  write_tet_file(at("block.msh"), {given.points, given.tets}, {});
  const std::string h = "  h: {type: read_tets, surface: body, path: '" + at("block.msh") + "'}\n";
  FrameResult energy = run(scene(h + R"(  press: {type: equilibrium, surface: body, tets: h.tets, lattice: h.lattice, sdf: solid, hold: 20}
  m: {type: measure, surface: press.surface, rest: body, sdf: solid}
  o: {type: write_tets, tets: h.tets, points: press.points, lattice: h.lattice, path: ')" +
                                 at("pressed.vtu") + "'}\n"),
                           {"m.report"});
  ASSERT_FALSE(energy.error) << energy.error->what();
  FrameResult loop = run(scene(h + R"(  press:
    type: iterate
    max_iterations: 100
    threshold: 1e-4
    state: {points: h.points, surface: body, memory: none}
    body:
      push:   {type: collide_sdf, surface: state.surface, sdf: solid, memory: state.memory}
      lift:   {type: map_to_tets, displacement: push.displacement, points: state.points, lattice: h.lattice}
      volume: {type: restore_volume, points: lift, tets: h.tets}
      stiff:  {type: enforce_stiffness, points: volume, tets: h.tets, stiffness: 0.5}
      keep:   {type: hold, points: stiff, tets: h.tets}
      map:    {type: map_to_surface, points: keep, lattice: h.lattice}
    next: {points: keep, surface: map, memory: push.memory}
  m: {type: measure, surface: press.surface, rest: body, sdf: solid}
)"),
                         {"m.report"});
  ASSERT_FALSE(loop.error) << loop.error->what();
  for (const FrameResult* result : {&energy, &loop}) {
    const Report& report = result->values.at("m.report").as<Report>();
    EXPECT_GT(report.number("displacement_max"), 0.1);
    EXPECT_LT(report.number("penetration_max"), 0.02);
  }
  std::vector<std::string> warnings;
  EXPECT_EQ(read_tet_file(at("pressed.vtu"), warnings).tets.size(), given.tets.size());
}

}  // namespace tet_files_test
}  // namespace knead
