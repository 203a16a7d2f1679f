// The meshes of the shared data: what is read, what is warned of, what is refused.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>

#include "tests/bad_meshes.h"
#include "tests/io/mesh/mesh_test_tools.h"
#include "tests/paths.h"

namespace mesh_formats_test {

namespace tools = mesh_test_tools;
using knead::Error;
using knead::ErrorCode;
using knead::Surface;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

class MeshFormats : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!std::filesystem::exists(shared_data())) GTEST_SKIP() << "no shared data";
    const std::string test = ::testing::UnitTest::GetInstance()->current_test_info()->name();
    folder_ = std::filesystem::temp_directory_path() / ("knead_formats_" + test + std::to_string(::getpid()));
    std::filesystem::remove_all(folder_);
    bad_meshes::write_all(folder_);
  }
  void TearDown() override {
    if (!folder_.empty()) std::filesystem::remove_all(folder_);
  }
  // One that the test has made, or one beside the checkout.
  std::string path_of(const std::string& name) const {
    const std::filesystem::path made = folder_ / name;
    return std::filesystem::exists(made) ? made.string() : tools::shared_mesh(name);
  }
  Surface read(const std::string& name, const knead::ReadMeshOptions& options = {}) {
    warnings.clear();
    Surface surface = knead::read_surface(path_of(name), options, warnings);
    problems = knead::describe_problems(surface);
    return surface;
  }
  Error refusal(const std::string& name) const {
    std::vector<std::string> ignored;
    const Error error = tools::error_of([&] { knead::read_surface(path_of(name), ignored); });
    EXPECT_EQ(error.where().file, path_of(name));
    return error;
  }
  std::vector<std::string> warnings, problems;
  std::filesystem::path folder_;
};

TEST_F(MeshFormats, SixContainersHoldTheSameMesh) {
  const Surface obj = read("formats/spot_829.obj");
  EXPECT_EQ(obj.vertices(), 829u);
  EXPECT_EQ(obj.topology->faces(), 1654u);
  EXPECT_NEAR(tools::volume_of(obj), 0.6797, 5e-5);
  for (const char* name : {"formats/spot_829.off", "formats/spot_829_ascii.ply", "formats/spot_829_binary_le.ply", "formats/spot_829_ascii.stl",
                           "formats/spot_829_binary.stl"}) {
    SCOPED_TRACE(name);
    const Surface other = read(name);
    EXPECT_THAT(warnings, IsEmpty());
    EXPECT_THAT(problems, IsEmpty());
    EXPECT_TRUE(tools::same_bits(obj, other));
    EXPECT_EQ(obj.topology->face_vertices, other.topology->face_vertices);
    EXPECT_EQ(obj.topology->triangles, other.topology->triangles);
  }
}

TEST_F(MeshFormats, ObjKeepsNamesNormalsAndTextureCoordinates) {
  const Surface s = read("formats/sphere_162_vt_vn.obj");
  const knead::MeshAttributes& a = *s.attributes;
  EXPECT_EQ(a.texture_coordinates.size(), 162u);
  EXPECT_EQ(a.normals.size(), 162u);
  EXPECT_EQ(a.groups, std::vector<std::string>{"surface"});
  EXPECT_EQ(a.objects, std::vector<std::string>{"ball"});
  EXPECT_EQ(a.materials, std::vector<std::string>{"skin"});
  EXPECT_EQ(a.material_library, "missing.mtl");
  ASSERT_EQ(a.corner_normal.size(), s.topology->corners());
  for (size_t c = 0; c < s.topology->corners(); ++c) EXPECT_EQ(a.corner_normal[c], static_cast<int32_t>(s.topology->face_vertices[c]));
}

TEST_F(MeshFormats, HeadsAreCleanAndHaveTheirVolume) {
  const struct {
    const char* name;
    size_t vertices, faces;
    double volume;
  } heads[] = {{"heads/head_ict_2400.obj", 2400, 4796, 5604},
               {"heads/head_makehuman_2400.obj", 2400, 4796, 4.172},
               {"heads/head_ict_20k.obj", 20000, 39996, 5607}};
  for (const auto& head : heads) {
    SCOPED_TRACE(head.name);
    const Surface s = read(head.name);
    EXPECT_EQ(s.vertices(), head.vertices);
    EXPECT_EQ(s.topology->faces(), head.faces);
    EXPECT_NEAR(tools::volume_of(s) / head.volume, 1, 2e-4);
    EXPECT_THAT(warnings, IsEmpty());
    EXPECT_THAT(problems, IsEmpty());
    EXPECT_TRUE(s.placement.is_identity());
  }
  const Surface open = read("heads/head_ict_quads_open.obj");
  EXPECT_EQ(open.vertices(), 14062u);
  EXPECT_EQ(open.topology->triangle_count(), 28068u);
  EXPECT_TRUE(tools::mentions(problems, "open: 54 boundary edges"));
}

TEST_F(MeshFormats, ProblemsAreCountedAndSaid) {
  const struct {
    const char* name;
    std::string said;
  } cases[] = {{"problem/open_boundary.obj", "open: " + std::to_string(bad_meshes::boundary_edges(bad_meshes::open_boundary())) + " boundary edges"},
               {"problem/nonmanifold_edge.obj", "7 edges have more than two faces"},
               {"problem/nonmanifold_vertex.obj", "1 vertex joins parts"},
               {"problem/duplicate_vertices_soup.obj", "4133 vertices lie exactly where another does"},
               {"problem/duplicate_vertices_soup.obj", "weld: true"},
               {"problem/multi_component.obj", "7 separate pieces, 1 of them turned inwards"},
               {"problem/multi_component.obj", "self-intersecting: 108 pairs"},
               {"problem/self_intersecting.obj", "self-intersecting: 168 pairs"},  // as CGAL counts them
               {"problem/inside_out.obj", "inside-out: the signed volume is " + tools::short_text(bad_meshes::volume_of(bad_meshes::turned(true)))},
               {"problem/mixed_orientation.obj",
                std::to_string(bad_meshes::edges_in_disagreement(bad_meshes::turned(false))) + " edges have faces that disagree"}};
  for (const auto& [name, said] : cases) {
    read(name);
    EXPECT_TRUE(tools::mentions(problems, said)) << name << ": " << ::testing::PrintToString(problems);
    EXPECT_THAT(warnings, IsEmpty()) << name;
  }
}

TEST_F(MeshFormats, DegenerateFacesStayPolygonsAndGiveNoTriangles) {
  const Surface s = read("problem/degenerate_faces.obj");
  EXPECT_EQ(s.topology->faces(), 1303u);
  EXPECT_EQ(s.topology->triangle_count(), 1303u - 54u);
  EXPECT_TRUE(tools::mentions(warnings, "54 faces have no area (3 of them with a repeated corner)")) << ::testing::PrintToString(warnings);
  EXPECT_FALSE(tools::mentions(problems, "open"));
}

TEST_F(MeshFormats, UnusedVerticesAreKeptOutOfTheBox) {
  const Surface s = read("problem/unreferenced_vertices.obj");
  EXPECT_EQ(s.vertices(), 742u);
  EXPECT_TRUE(tools::mentions(warnings, "100 vertices belong to no face"));
  EXPECT_NEAR(s.diagonal(), bad_meshes::diagonal_of(bad_meshes::egg()), 1e-6);
}

TEST_F(MeshFormats, ConcaveNgonsAreCutWithinTheirOutline) {
  EXPECT_NEAR(tools::volume_of(read("problem/ngons_concave_star_prism.obj")), 0.618034, 1e-6);
  const Surface dual = read("problem/ngons_hex_pent.obj");
  EXPECT_EQ(dual.topology->faces(), 642u);
  EXPECT_EQ(dual.topology->triangle_count(), 12u * 3 + 630u * 4);
}

TEST_F(MeshFormats, OffsetsAndScalesCostNoPrecision) {
  const bad_meshes::Mesh egg = bad_meshes::egg();
  const Surface near = tools::parse(bad_meshes::obj(egg), "egg.obj"), far = read("problem/offset_1e6.obj");
  EXPECT_NEAR(far.placement.translation.x, 1e6, 1);
  const auto p = near.points.host(), q = far.points.host();
  for (size_t i = 0; i < p.size(); ++i)
    for (int k = 0; k < 3; ++k) ASSERT_NEAR(to_double(p[i])[k] + (k == 1 ? -1e6 : 1e6), far.placement.apply(to_double(q[i]))[k], 3e-7);
  for (const auto& [name, size] : {std::pair{"problem/scale_1e-4.obj", 1e-4}, std::pair{"problem/scale_1e6.obj", 1e6}}) {
    const Surface s = read(name);
    EXPECT_NEAR(tools::volume_of(s) / std::pow(size / bad_meshes::diagonal_of(egg), 3) / bad_meshes::volume_of(egg), 1, 1e-5) << name;
    EXPECT_EQ(s.topology->triangles, near.topology->triangles) << name;
    EXPECT_THAT(problems, IsEmpty());
  }
}

TEST_F(MeshFormats, WeldingTheSoupClosesIt) {
  const Surface s = read("problem/duplicate_vertices_soup.obj", {.weld = true});
  EXPECT_EQ(s.vertices(), 829u);
  EXPECT_THAT(problems, IsEmpty());
}

TEST_F(MeshFormats, CoordinatesThatAreNoNumbersAreNamed) {
  for (const char* name : {"problem/nan_vertex.obj", "problem/inf_vertex.obj"}) {
    const Error error = refusal(name);
    EXPECT_EQ(error.code(), ErrorCode::kInput);
    EXPECT_EQ(error.where().line, 103);
    EXPECT_THAT(error.message(), HasSubstr("vertex 101 (line 103), vertex 501 (line 503)"));
    EXPECT_FALSE(error.hint().empty());
  }
}

TEST_F(MeshFormats, MalformedFilesAreRefusedWithTheirPlace) {
  const struct {
    const char* name;
    ErrorCode code;
    int line;
    const char* said;
  } cases[] = {{"malformed/truncated_binary.ply", ErrorCode::kFile, 0, "face 522 of 1280"},
               {"malformed/truncated_binary.stl", ErrorCode::kFile, 0, "the file ends in triangle 826"},
               {"malformed/index_out_of_range.obj", ErrorCode::kFile, 14, "refers to vertex 99, but the file has only 8"},
               {"malformed/index_negative_out_of_range.obj", ErrorCode::kFile, 14, "vertex -9"},
               {"malformed/index_zero.obj", ErrorCode::kFile, 14, "vertex 0"},
               {"malformed/text_garbage.obj", ErrorCode::kFile, 3, "'one' stands where a coordinate should"},
               {"malformed/empty.obj", ErrorCode::kInput, 0, "no vertices"},
               {"malformed/comments_only.obj", ErrorCode::kInput, 0, "no vertices"},
               {"malformed/zero_faces.obj", ErrorCode::kInput, 0, "8 vertices but no faces"},
               {"malformed/header_only.ply", ErrorCode::kFile, 0, "announces 3 of 'vertex'"},
               {"malformed/ply_missing_end_header.ply", ErrorCode::kFile, 4, "end_header"},
               {"malformed/not_a_mesh.ply", ErrorCode::kFile, 1, "no PLY file"}};
  size_t listed = 0;
  for (const auto& c : cases) {
    SCOPED_TRACE(c.name);
    const Error error = refusal(c.name);
    EXPECT_EQ(error.code(), c.code);
    EXPECT_EQ(error.where().line, c.line);
    EXPECT_THAT(error.message(), HasSubstr(c.said));
    ++listed;
  }
  const auto files = std::filesystem::directory_iterator(folder_ / "malformed");
  EXPECT_EQ(listed, static_cast<size_t>(std::distance(std::filesystem::begin(files), std::filesystem::end(files))));
}

// Rest shapes come back bit for bit, in every format that keeps vertices.
TEST_F(MeshFormats, EveryReadableMeshSurvivesTheRoundTrip) {
  std::vector<std::filesystem::path> files;
  for (const std::filesystem::path folder :
       {tools::shared_mesh("formats"), tools::shared_mesh("heads"), tools::shared_mesh("colliders"), (folder_ / "problem").string()})
    for (const auto& entry : std::filesystem::directory_iterator(folder)) files.push_back(entry.path());
  for (const char* name : bad_meshes::kSharedProblems) files.push_back(tools::shared_mesh("problem/") + name);
  size_t tried = 0;
  for (const std::filesystem::path& file : files) {
    const std::string ending = file.extension().string(), stem = file.stem().string();
    if (ending == ".vdb" || stem == "nan_vertex" || stem == "inf_vertex") continue;
    SCOPED_TRACE(file.string());
    std::vector<std::string> ignored;
    const Surface s = knead::read_surface(file.string(), ignored);
    for (const auto& [name, ascii] : {std::pair{"again.obj", true}, std::pair{"again.ply", true}, std::pair{"again.ply", false}}) {
      const Surface again = tools::parse(tools::format(name, s, {.ascii = ascii}), name);
      EXPECT_TRUE(tools::same_bits(s, again)) << name;
      EXPECT_EQ(s.topology->face_vertices, again.topology->face_vertices) << name;
      EXPECT_EQ(s.topology->face_offsets, again.topology->face_offsets) << name;
    }
    const Surface welded = tools::parse(tools::format("a.stl", s, {.ascii = true}), "a.stl");
    EXPECT_EQ(welded.topology->triangle_count(), s.topology->triangle_count());
    EXPECT_NEAR(tools::volume_of(welded), tools::volume_of(s), 1e-6 * std::pow(s.diagonal(), 3));
    ++tried;
  }
  EXPECT_GE(tried, 30u);
}

}  // namespace mesh_formats_test
