#include "io/mesh/assimp.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/io/mesh/mesh_test_tools.h"

namespace mesh_assimp_test {

namespace tools = mesh_test_tools;
using knead::Surface;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

// COLLADA: a tetrahedron, twice the size and shifted by its node, with one normal a face where `split`.
std::string collada(bool split) {
  const std::string places = "0 0 0 1 0 0 0 1 0 0 0 1", normals = "0 0 -1 0 -1 0 1 1 1 -1 0 0";
  const std::string plain = "0 2 1 0 1 3 1 2 3 2 0 3", with_normals = "0 0 2 0 1 0 0 1 1 1 3 1 1 2 2 2 3 2 2 3 0 3 3 3";
  std::string text =
      "<?xml version=\"1.0\"?><COLLADA xmlns=\"http://www.collada.org/2005/11/COLLADASchema\" "
      "version=\"1.4.1\"><asset><up_axis>Y_UP</up_axis></asset>"
      "<library_geometries><geometry id=\"g\"><mesh><source id=\"p\"><float_array id=\"pa\" count=\"12\">" +
      places +
      "</float_array><technique_common><accessor source=\"#pa\" count=\"4\" stride=\"3\"><param name=\"X\" type=\"float\"/><param name=\"Y\" "
      "type=\"float\"/>"
      "<param name=\"Z\" type=\"float\"/></accessor></technique_common></source><source id=\"n\"><float_array id=\"na\" count=\"12\">" +
      normals +
      "</float_array><technique_common><accessor source=\"#na\" count=\"4\" stride=\"3\"><param name=\"X\" type=\"float\"/><param name=\"Y\" "
      "type=\"float\"/>"
      "<param name=\"Z\" type=\"float\"/></accessor></technique_common></source><vertices id=\"v\"><input semantic=\"POSITION\" "
      "source=\"#p\"/></vertices>"
      "<triangles count=\"4\"><input semantic=\"VERTEX\" source=\"#v\" offset=\"0\"/>";
  if (split) text += "<input semantic=\"NORMAL\" source=\"#n\" offset=\"1\"/>";
  return text + "<p>" + (split ? with_normals : plain) +
         "</p></triangles></mesh></geometry></library_geometries><library_visual_scenes><visual_scene id=\"s\"><node id=\"a\"><matrix>2 0 0 5 0 2 0 "
         "0 0 0 2 0 0 0 "
         "0 1</matrix><instance_geometry url=\"#g\"/></node></visual_scene></library_visual_scenes><scene><instance_visual_scene "
         "url=\"#s\"/></scene></COLLADA>";
}

TEST(MeshAssimp, ReadsASceneWhereItsNodesPlaceIt) {
  if (!knead::mesh::assimp_is_built_in()) GTEST_SKIP() << "built without Assimp";
  std::vector<std::string> warnings;
  const Surface s = knead::parse_surface(collada(true), "m.DAE", {}, warnings);
  EXPECT_EQ(s.vertices(), 4u);
  EXPECT_NEAR(tools::volume_of(s), 8.0 / 6, 1e-6);
  EXPECT_NEAR(s.placement.apply(to_double(s.lower)).x, 5, 1e-6);
  EXPECT_THAT(knead::describe_problems(s), IsEmpty());
  EXPECT_THAT(warnings, ElementsAre(HasSubstr("12 of them are joined to 4")));
}

TEST(MeshAssimp, RefusesWhatAssimpCannotRead) {
  if (!knead::mesh::assimp_is_built_in()) GTEST_SKIP() << "built without Assimp";
  for (const char* name : {"m.gltf", "m.glb", "m.fbx", "m.dae", "m.3ds"}) {
    const knead::Error error = tools::error_of([&] { tools::parse("no scene", name); });
    EXPECT_EQ(error.where().file, name);
    EXPECT_FALSE(error.hint().empty());
  }
  EXPECT_EQ(
      tools::error_of([&] { tools::parse("{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"uri\":\"a.bin\",\"byteLength\":4}]}", "m.gltf"); }).code(),
      knead::ErrorCode::kFile);
}

TEST(MeshAssimp, WithoutAssimpTheNameIsRefusedWithWhatToDo) {
  if (knead::mesh::assimp_is_built_in()) GTEST_SKIP() << "built with Assimp";
  EXPECT_THAT(tools::error_of([&] { knead::check_readable_mesh_name("m.glb"); }).hint(), HasSubstr("libassimp-dev"));
}

TEST(MeshAssimp, IsForReadingAlone) {
  EXPECT_THAT(tools::error_of([&] { knead::check_writable_mesh_name("m.glb"); }).hint(), HasSubstr(".obj"));
}

}  // namespace mesh_assimp_test
