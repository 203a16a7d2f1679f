// What the parsers take and refuse, on small texts.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/io/mesh/mesh_test_tools.h"

namespace mesh_parse_test {

namespace tools = mesh_test_tools;
using knead::Error;
using knead::ErrorCode;
using knead::Surface;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

const char* const kTetrahedron = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";

Error refusal_of(const std::string& bytes, const std::string& name = "m.obj") {
  return tools::error_of([&] { tools::parse(bytes, name); });
}

TEST(MeshParse, ObjErrorsNameLineAndColumn) {
  const std::string head = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
  const struct {
    const char* last;
    int column;
    const char* said;
  } cases[] = {{"f 1 2 three", 7, "'three'"},
               {"f 1 2 3x", 8, "written as"},
               {"f 1 2 1x0", 8, "written as"},
               {"f 1 2 0", 8, "counts from 1"},
               {"f 1 2 -4", 9, "only 3 so far"},
               {"f 1 2 99999999999", 18, "more than a mesh can have"},
               {"f 1 2 999999999999999999999999", 7, "not a whole number"},
               {"f 1/1 2/x 3", 9, "'x'"},
               {"v 1 2", 6, "ends where a coordinate"},
               {"v 1,5 2 3", 3, "'1,5'"},
               {"v 1 2 # 3", 7, "ends where a coordinate"},
               {"v 1 2 1.#IND", 7, "'1.#IND'"},
               {"vv 1 2 3", 9, "'vv' is no OBJ statement"},
               {"1 2 3", 6, "'1' is no OBJ statement"},
               {"\x01\x02", 3, "'\?\?' is no OBJ statement"}};
  for (const auto& c : cases) {
    SCOPED_TRACE(c.last);
    const Error error = refusal_of(head + c.last + "\n");
    EXPECT_EQ(error.code(), ErrorCode::kFile);
    EXPECT_EQ(error.where().line, 4);
    EXPECT_EQ(error.where().column, c.column);
    EXPECT_THAT(error.message(), HasSubstr(c.said));
    EXPECT_THAT(error.what(), HasSubstr("m.obj:4"));
  }
}

TEST(MeshParse, ObjReadsWhatProgramsWrite) {
  const Surface plain = tools::parse(kTetrahedron, "m.obj");
  const char* const variants[] = {
      "\xef\xbb\xbf# mark\r\nv 0 0 0\r\nv 1 0 0\r\nv 0 1 0\r\nv 0 0 1\r\nf 1 3 2\r\nf 1 2 4\r\nf 2 3 4\r\nf 3 1 4",
      "v 0 0 0\rv 1 0 0\rv 0 1 0\rv 0 0 1\rf 1 3 2\rf 1 2 4\rf 2 3 4\rf 3 1 4\r",
      "v +0.0 0e5 .0\nv 1. 0 0 1.0\nv\t0 1 \\\n 0\nv 0 0 1e0\ns off\nf 1 \\\r\n3 2\nf -4 -3 -1\nf 2 3 4\nf 3 1 4\n# the end \\",
      "f 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n",
      "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0\nvt 0 1 0\nf 1/1 3/1/ 2\nf 1 2/2 4\nf 2 3 4\nf 3 1 4\ncstype bezier\n"};
  for (const char* variant : variants) {
    SCOPED_TRACE(variant);
    const Surface s = tools::parse(variant, "M.OBJ");
    EXPECT_TRUE(tools::same_bits(plain, s));
    EXPECT_EQ(plain.topology->face_vertices, s.topology->face_vertices);
  }
}

TEST(MeshParse, PointsAreTheFloatsNearestToTheText) {
  // The second lies so close above the middle of two floats that its double is the middle itself, which would round to even, down.
  const Surface s = tools::parse("v 0.1 16777217.0000000001 1e-46\nv 5 5 0\nv 1e7 0 1e-44\nf 1 2 3\n", "m.obj");
  ASSERT_TRUE(s.placement.is_identity());
  const auto p = s.points.host();
  EXPECT_EQ(p[0].x, 0.1f);
  EXPECT_EQ(p[0].y, 16777218.0f);
  EXPECT_EQ(p[0].z, 0.0f);
  EXPECT_EQ(p[2].z, 1e-44f);
}

TEST(MeshParse, NumbersThatFitNoFloatAreRefusedByVertex) {
  for (const char* number : {"nan", "-nan", "inf", "-Infinity", "1e39", "-1e400", "1e99999"}) {
    SCOPED_TRACE(number);
    const Error error = refusal_of(std::string(kTetrahedron) + "v 1 2 " + number + "\nf 1 2 5\n");
    EXPECT_EQ(error.code(), ErrorCode::kInput);
    EXPECT_THAT(error.message(), HasSubstr("no finite number"));
  }
  EXPECT_EQ(refusal_of("ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
                       "property list uchar int vertex_index\nend_header\n0 0 0\n1 nan 0\n0 1 0\n3 0 1 2\n",
                       "m.ply")
                .where()
                .line,
            11);
}

TEST(MeshParse, NormalsThatAreNoNumbersAreZeroWithAWarning) {
  std::vector<std::string> warnings;
  const Surface s = knead::parse_surface("v 0 0 0\nv 1 0 0\nv 0 1 0\nvn nan 0 1\nf 1//1 2//1 3//1\n", "m.obj", {}, warnings);
  EXPECT_EQ(s.attributes->normals[0].x, 0);
  EXPECT_TRUE(tools::mentions(warnings, "1 values in the normals"));
}

TEST(MeshParse, NothingToDeformIsRefused) {
  EXPECT_THAT(refusal_of("v 0 0 0\nv 0 0 0\nv 0 0 0\nf 1 2 3\n").message(), HasSubstr("none of its 1 face has any area"));
  EXPECT_EQ(refusal_of("v 0 0 0\nv 1 1 1\nv 2 2 2\nf 1 2 3\n").code(), ErrorCode::kInput);
  for (const char* name : {"m.obj", "m.ply", "m.stl", "m.off"}) EXPECT_NO_FATAL_FAILURE(refusal_of("", name));
  EXPECT_THAT(refusal_of("", "m.xyz").hint(), HasSubstr(".obj"));
  EXPECT_THAT(refusal_of("", "folder.obj/m").hint(), HasSubstr(".obj"));
}

TEST(MeshParse, PlyHeadersAreChecked) {
  const std::string good =
      "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
      "property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
  EXPECT_EQ(tools::parse(good, "m.ply").vertices(), 3u);
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string changed = good;
    changed.replace(changed.find(from), from.size(), to);
    return refusal_of(changed, "m.ply").message();
  };
  EXPECT_THAT(with("ascii", "ascci"), HasSubstr("no PLY format"));
  EXPECT_THAT(with("float x", "real x"), HasSubstr("no PLY type"));
  EXPECT_THAT(with("property float y", "proprety float y"), HasSubstr("no PLY header statement"));
  EXPECT_THAT(with("float x", "float w"), HasSubstr("no x, y and z"));
  EXPECT_THAT(with("int vertex_indices", "float corners"), HasSubstr("vertex_indices"));
  EXPECT_THAT(with("uchar int", "float int"), HasSubstr("fractional length"));
  EXPECT_THAT(with("vertex 3", "vertex 4000000000"), HasSubstr("cannot hold them"));
  EXPECT_THAT(with("vertex 3", "vertex -3"), HasSubstr("negative"));
  EXPECT_THAT(with("3 0 1 2", "3 0 1 3"), HasSubstr("vertex 3, but the file has only 3"));
  EXPECT_THAT(with("3 0 1 2", "3 0 1 -1"), HasSubstr("vertex -1"));
  EXPECT_THAT(with("3 0 1 2", "2 0 1"), HasSubstr("no faces"));
  EXPECT_THAT(with("1 0 0", "1 0 0 7"), HasSubstr("more values"));
  EXPECT_THAT(with("1 0 0", "1 0"), HasSubstr("the line ends where a value should stand"));
  EXPECT_THAT(with("3 0 1 2", "3 0 1 2 5"), HasSubstr("more values"));
  EXPECT_THAT(with("3 0 1 2\n", ""), HasSubstr("face 0 of 1"));
  EXPECT_THAT(with("element face 1", "element vertex 0\nproperty int x\nelement face 1"), ::testing::Not(IsEmpty()));
}

TEST(MeshParse, PlyStepsOverWhatItDoesNotKnow) {
  std::vector<std::string> warnings;
  const Surface s = knead::parse_surface(
      "ply\nformat ascii 1.0\ncomment c\nobj_info i\nelement camera 1\nproperty list uchar float view\nelement face 1\nproperty uchar "
      "flags\nproperty list uchar int vertex_index\n"
      "element vertex 3\nproperty double quality\nproperty double x\nproperty double y\nproperty double z\nproperty uchar red\nproperty uchar "
      "green\nproperty uchar blue\n"
      "property list int int rings\nend_header\n2 0.5 0.25\n7 3 0 1 2\n9 0 0 0 255 0 51 0\n9 1 0 0 0 0 0 2 5 6\n9 0 1 0 1 2 3 0\n",
      "m.ply", {}, warnings);
  EXPECT_EQ(s.vertices(), 3u);
  EXPECT_EQ(s.attributes->vertex_colours[0], (std::array<float, 4>{1, 0, 0.2f, 1}));
  EXPECT_THAT(warnings, ::testing::ElementsAre("the element 'camera' and the list 'rings' of 'vertex' left out"));
}

TEST(MeshParse, AsciiStlErrorsNameTheLine) {
  const std::string good = "solid a b\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid a b\n";
  EXPECT_EQ(tools::parse(good, "m.stl").vertices(), 3u);
  EXPECT_EQ(tools::parse(good + good, "m.stl").vertices(), 3u);  // several solids in a file are one surface
  std::string wrong = good;
  wrong.replace(wrong.find("1 0 0"), 5, "1 O 0");
  EXPECT_EQ(refusal_of(wrong, "m.stl").where().line, 5);
  EXPECT_THAT(refusal_of(good.substr(0, good.find("endloop")), "m.stl").message(), HasSubstr("'endloop' should stand"));
  EXPECT_THAT(refusal_of("no stl", "m.stl").message(), HasSubstr("no STL file"));
}

TEST(MeshParse, BinaryStlMayBeginWithSolid) {
  std::string bytes = tools::format("m.stl", tools::parse(kTetrahedron, "m.obj"));
  bytes.replace(0, 5, "solid");
  EXPECT_EQ(tools::parse(bytes, "m.stl").vertices(), 4u);
}

TEST(MeshParse, OffReadsColoursAndRefusesWrongIndices) {
  const std::string good = "COFF # comment\n3 1 0\n0 0 0 255 0 0 255\n1 0 0 0 255 0 255\n\n0 1 0 0 0 51 255\n3 0 1 2 9 9 9\n";
  const Surface s = tools::parse("COFF\n" + good.substr(good.find('\n') + 1), "m.off");
  EXPECT_EQ(s.attributes->vertex_colours[2], (std::array<float, 4>{0, 0, 0.2f, 1}));
  EXPECT_THAT(refusal_of("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", "m.off").message(), HasSubstr("vertex 3"));
  EXPECT_THAT(refusal_of("OFF\n3 1 0\n0 0 0\n1 0 0\n", "m.off").message(), HasSubstr("vertex 2 of 3"));
  EXPECT_THAT(refusal_of("OFF\n999999999 1 0\n", "m.off").message(), HasSubstr("larger than the file"));
}

TEST(MeshParse, WeldingJoinsEqualPlacesAndKeepsTheOrder) {
  const std::string text = "v 5 0 0 1 0 0\nv 0 0 0 0 1 0\nv 0 1 0 0 0 1\nv -0 0 0 1 1 1\nv 0 0 7 0.5 0.5 0.5\nf 1 2 3\nf 4 5 3\n";
  EXPECT_EQ(tools::parse(text, "m.obj").vertices(), 5u);
  const Surface s = tools::parse(text, "m.obj", {.weld = true});
  EXPECT_EQ(s.vertices(), 4u);
  EXPECT_EQ(s.topology->face_vertices, (std::vector<uint32_t>{0, 1, 2, 1, 3, 2}));
  EXPECT_EQ(s.attributes->vertex_colours[1], (std::array<float, 4>{0, 1, 0, 1}));
  EXPECT_EQ(s.attributes->vertex_colours[3][0], 0.5f);
}

TEST(MeshParse, ProblemsOfACleanMeshAreNone) {
  EXPECT_THAT(knead::describe_problems(tools::parse(kTetrahedron, "m.obj")), IsEmpty());
}

TEST(MeshParse, MakeSurfaceRefusesWrongIndices) {
  knead::MeshTopology polygons;
  polygons.face_offsets = {0, 3};
  polygons.face_vertices = {0, 1, 3};
  const std::vector<knead::Vec3d> points{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  std::vector<std::string> warnings;
  EXPECT_EQ(tools::error_of([&] { knead::make_surface(points, polygons, {}, {}, "made", warnings); }).code(), ErrorCode::kInput);
}

}  // namespace mesh_parse_test
