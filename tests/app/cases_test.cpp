// Every case of the shared folder `cases` that is about files, through the program: each vertex and each face of what it writes, and what it warns of.
#include <array>
#include <cmath>
#include <map>
#include <set>

#include "io/mesh/mesh_io.h"
#include "tests/app/program.h"

namespace cases_test {

using namespace program_test;
using knead::Surface;
using knead::Vec3d;

using Place = std::array<double, 3>;
using Polygon = std::vector<Place>;

Place place_of(const Surface& surface, uint32_t vertex) {
  const Vec3d p = surface.placement.apply(to_double(surface.points.host()[vertex]));
  return {p.x, p.y, p.z};
}

// Turned so that the least corner comes first.
Polygon turned(Polygon polygon) {
  std::rotate(polygon.begin(), std::min_element(polygon.begin(), polygon.end()), polygon.end());
  return polygon;
}

std::multiset<Polygon> polygons_of(const Surface& surface) {
  const knead::MeshTopology& topology = *surface.topology;
  std::multiset<Polygon> polygons;
  for (size_t face = 0; face < topology.faces(); ++face) {
    Polygon polygon;
    for (uint32_t c = topology.face_offsets[face]; c < topology.face_offsets[face + 1]; ++c)
      polygon.push_back(place_of(surface, topology.face_vertices[c]));
    polygons.insert(turned(polygon));
  }
  return polygons;
}

const std::vector<Place> kCube = {{-.5, -.5, -.5}, {.5, -.5, -.5}, {.5, .5, -.5}, {-.5, .5, -.5},
                                  {-.5, -.5, .5},  {.5, -.5, .5},  {.5, .5, .5},  {-.5, .5, .5}};
const std::vector<std::vector<size_t>> kSides = {{0, 3, 2, 1}, {4, 5, 6, 7}, {0, 1, 5, 4}, {1, 2, 6, 5}, {2, 3, 7, 6}, {3, 0, 4, 7}};

Polygon side(size_t n) {
  Polygon polygon;
  for (const size_t corner : kSides[n]) polygon.push_back(kCube[corner]);
  return polygon;
}

// The sides as they are, or each as two triangles by either diagonal.
void expect_cube(const Surface& surface, bool triangles) {
  ASSERT_EQ(surface.vertices(), 8u);
  std::set<Place> places;
  for (uint32_t v = 0; v < 8; ++v) places.insert(place_of(surface, v));
  EXPECT_EQ(places, std::set<Place>(kCube.begin(), kCube.end()));
  std::multiset<Polygon> found = polygons_of(surface);
  const auto take = [&](const Polygon& polygon) {
    const auto at = found.find(turned(polygon));
    if (at == found.end()) return false;
    found.erase(at);
    return true;
  };
  for (size_t n = 0; n < kSides.size(); ++n) {
    const Polygon p = side(n);
    if (triangles)
      EXPECT_TRUE((take({p[0], p[1], p[2]}) && take({p[0], p[2], p[3]})) || (take({p[1], p[2], p[3]}) && take({p[1], p[3], p[0]}))) << "side " << n;
    else
      EXPECT_TRUE(take(p)) << "side " << n;
  }
  EXPECT_TRUE(found.empty()) << found.size() << " faces more";
}

class ProgramCases : public Program {
 protected:
  void SetUp() override {
    cases_ = fs::path(shared_data()).parent_path() / "cases";
    if (!fs::exists(cases_)) GTEST_SKIP() << "no shared cases";
    Program::SetUp();
  }
  // Runs the case's graph on a copy of the case.
  Ended run_case(const std::string& name) {
    fs::remove_all(folder_);
    fs::copy(cases_ / name, folder_);
    fs::permissions(folder_, fs::perms::owner_all);
    return knead({"run", "graph.yaml"});
  }
  Surface written(const std::string& file) const {
    std::vector<std::string> warnings;
    return knead::read_surface((folder_ / file).string(), warnings);
  }

  fs::path cases_;
};

struct MeshCase {
  const char* warning = "";  // part of the one warning; empty: there is none
  bool triangles = false;
};

TEST_F(ProgramCases, MeshesAreTheCubeThatTheyWere) {
  const std::map<std::string, MeshCase> cases = {{"obj_comment_after_values", {}},
                                                 {"obj_missing_attributes", {"texture coordinates and normals that are not in the file"}},
                                                 {"obj_trailing_slash", {}},
                                                 {"obj_two_corner_face", {"1 face of two corners left out"}},
                                                 {"obj_unknown_lines", {"2 lines that are no OBJ statements left out (first: line 1)"}},
                                                 {"off_glued_header", {}},
                                                 {"off_wrapped_faces", {}},
                                                 {"ply_tristrips", {"", true}},
                                                 {"ply_two_corner_face", {"1 face of two corners left out"}},
                                                 {"ply_unknown_header_line", {"header line that is no PLY statement left out (first: line "}},
                                                 {"ply_values_over_lines", {}},
                                                 {"stl_byte_order_mark", {"", true}},
                                                 {"stl_count_zero", {"the count says 0, the file holds 12 whole facets", true}},
                                                 {"stl_no_endsolid", {"no 'endsolid'", true}},
                                                 {"stl_upper_case", {"", true}}};
  size_t tried = 0;
  for (const auto& entry : fs::directory_iterator(cases_)) {
    const std::string name = entry.path().filename().string();
    const std::string kind = name.substr(0, 4);
    if ((kind != "obj_" && kind != "off_" && kind != "ply_" && kind != "stl_") || name == "ply_own_properties") continue;
    SCOPED_TRACE(name);
    const auto expected = cases.find(name);
    ASSERT_NE(expected, cases.end()) << "a case that nothing is known of";
    const Ended ended = run_case(name);
    ASSERT_EQ(ended.status, 0) << ended.err;
    ASSERT_NO_FATAL_FAILURE(expect_cube(written("out.obj"), expected->second.triangles));
    const std::vector<std::string> warned = warnings(stats().at(0));
    const std::string warning = expected->second.warning;
    EXPECT_EQ(warned.size(), warning.empty() ? 0u : 1u) << testing::PrintToString(warned);
    if (!warning.empty()) EXPECT_THAT(warned, ElementsAre(HasSubstr(warning)));
    ++tried;
  }
  EXPECT_EQ(tried, cases.size());
}

TEST_F(ProgramCases, OwnPropertiesOfPlyAreWrittenAgain) {
  const Ended ended = run_case("ply_own_properties");
  ASSERT_EQ(ended.status, 0) << ended.err;
  const std::string out = text_of(folder_ / "out.ply");
  const std::string body = out.substr(out.find("end_header"));
  EXPECT_THAT(out, AllOf(HasSubstr("property float quality\nproperty int id\n"), HasSubstr("property uchar flags\n")));
  EXPECT_EQ(body, "end_header\n0 0 0 0 10\n2 0 0 0.5 11\n0 2 0 1 12\n0 0 3 1.5 13\n3 0 2 1 0\n3 0 1 3 1\n3 1 2 3 2\n3 2 0 3 3\n");
}

TEST_F(ProgramCases, LevelSetsDentTheBodyAsTheyShould) {
  struct FieldCase {
    Place centre;
    const char* warning;
  };
  const std::map<std::string, FieldCase> cases = {
      {"nvdb_of_openvdb_13", {{1, 1, 1.85}, ""}},
      {"vdb_dense_sdf_background_0", {{0, 0, 0.85}, "dense distances with background 0"}},
      {"vdb_foreign_grid_beside", {{0, 0, 0.85}, "stepped over"}},
      {"vdb_two_level_sets", {{}, "the file holds 2 level sets, 'small' and 'tool'; 'small' is taken, name one with grid"}}};
  size_t tried = 0;
  for (const auto& entry : fs::directory_iterator(cases_)) {
    const std::string name = entry.path().filename().string();
    if (name.substr(0, 4) != "vdb_" && name.substr(0, 5) != "nvdb_") continue;
    SCOPED_TRACE(name);
    const auto expected = cases.find(name);
    ASSERT_NE(expected, cases.end()) << "a case that nothing is known of";
    const Ended ended = run_case(name);
    ASSERT_EQ(ended.status, 0) << ended.err;
    if (*expected->second.warning) EXPECT_THAT(warnings(stats().at(0)), testing::Contains(HasSubstr(expected->second.warning)));
    EXPECT_THAT(ended.err, Not(HasSubstr("openvdb"))) << "OpenVDB's own lines do not belong among ours";
    ++tried;
    if (name == "vdb_two_level_sets") continue;
    const double displacement = figure(stats().at(0), "displacement_max");
    EXPECT_GT(displacement, 0.13);
    EXPECT_LT(displacement, 0.17);
    const Surface pressed = written("out.obj");
    double nearest = HUGE_VAL;
    for (uint32_t v = 0; v < pressed.vertices(); ++v) {
      const Place p = place_of(pressed, v), c = expected->second.centre;
      nearest = std::min(nearest, std::hypot(p[0] - c[0], p[1] - c[1], p[2] - c[2]));
    }
    EXPECT_GT(nearest, 0.48);
  }
  EXPECT_EQ(tried, cases.size());
}

}  // namespace cases_test
