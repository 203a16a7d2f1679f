#include "io/mesh/assimp.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/io/mesh/mesh_test_tools.h"

namespace mesh_assimp_test {

namespace tools = mesh_test_tools;
using knead::Surface;
using knead::Vec3d;
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

constexpr float kPlaces[] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1};
constexpr uint16_t kCorners[] = {0, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, 3};

template <class T>
std::string raw(const T& value) {  // formats and machines that run these tests are little-endian
  return {reinterpret_cast<const char*>(&value), sizeof value};
}

// glTF's buffer: places, then corners; with `seams` each triangle has vertices of its own.
std::string gltf_buffer(bool seams) {
  std::string places = raw(kPlaces), corners = raw(kCorners);
  if (seams) {
    places.clear(), corners.clear();
    for (uint16_t c = 0; c < 12; ++c) places += raw(kPlaces).substr(size_t{12} * kCorners[c], 12), corners += raw(c);
  }
  return places + corners;
}

std::string gltf_json(bool seams, const std::string& uri) {
  const std::string vertices = seams ? "12" : "4", bytes = seams ? "144" : "48";
  return "{\"asset\":{\"version\":\"2.0\"},\"scene\":0,\"scenes\":[{\"nodes\":[0]}],"
         "\"nodes\":[{\"mesh\":0,\"translation\":[5,0,0],\"scale\":[2,2,2]}],"
         "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":1}]}],"
         "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":" +
         vertices +
         ",\"type\":\"VEC3\",\"min\":[0,0,0],\"max\":[1,1,1]},{\"bufferView\":1,\"componentType\":5123,\"count\":12,\"type\":\"SCALAR\"}],"
         "\"bufferViews\":[{\"buffer\":0,\"byteLength\":" +
         bytes + "},{\"buffer\":0,\"byteOffset\":" + bytes + ",\"byteLength\":24}],\"buffers\":[{" + uri +
         "\"byteLength\":" + std::to_string(gltf_buffer(seams).size()) + "}]}";
}

std::string glb(bool seams) {
  std::string json = gltf_json(seams, ""), buffer = gltf_buffer(seams);
  json.resize((json.size() + 3) / 4 * 4, ' ');
  const auto size = [](size_t n) { return raw(static_cast<uint32_t>(n)); };
  return "glTF" + size(2) + size(28 + json.size() + buffer.size()) + size(json.size()) + "JSON" + json + size(buffer.size()) +
         std::string("BIN\0", 4) + buffer;
}

std::string base64(const std::string& bytes) {
  static const char* const kDigits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  for (size_t i = 0; i < bytes.size(); i += 3) {
    uint32_t three = 0;
    for (size_t k = 0; k < 3; ++k) three = three << 8 | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0u);
    for (size_t k = 0; k < 4; ++k) text += i + k <= bytes.size() ? kDigits[three >> (18 - 6 * k) & 63] : '=';
  }
  return text;
}

std::string gltf(bool seams) {
  return gltf_json(seams, "\"uri\":\"data:application/octet-stream;base64," + base64(gltf_buffer(seams)) + "\",");
}

// 3DS: chunks inside of chunks.
std::string chunk(uint16_t kind, const std::string& contents) {
  return raw(kind) + raw(static_cast<uint32_t>(6 + contents.size())) + contents;
}
std::string three_ds() {
  std::string faces = raw(uint16_t{4});
  for (size_t c = 0; c < 12; c += 3) faces += raw(kCorners[c]) + raw(kCorners[c + 1]) + raw(kCorners[c + 2]) + raw(uint16_t{7});
  std::string places = raw(uint16_t{4});
  for (size_t k = 0; k < 12; ++k) places += raw(2 * kPlaces[k] + (k % 3 == 0 ? 5.0f : 0.0f));
  const std::string mesh = chunk(0x4100, chunk(0x4110, places) + chunk(0x4120, faces));
  return chunk(0x4d4d, chunk(0x0002, raw(uint32_t{3})) + chunk(0x3d3d, chunk(0x4000, std::string("tet\0", 4) + mesh)));
}

// FBX as text. A polygon's last corner is written as its complement.
std::string fbx() {
  std::string places, corners;
  for (const float v : kPlaces) places += (places.empty() ? "" : ",") + std::to_string(v);
  for (size_t c = 0; c < 12; ++c) corners += (c ? "," : "") + std::to_string(c % 3 == 2 ? -kCorners[c] - 1 : int{kCorners[c]});
  return "; FBX 7.4.0 project file\nFBXHeaderExtension: {\n FBXHeaderVersion: 1003\n FBXVersion: 7400\n}\n"
         "GlobalSettings: {\n Version: 1000\n Properties70: {\n  P: \"UnitScaleFactor\", \"double\", \"Number\", \"\",1\n }\n}\n"
         "Objects: {\n Geometry: 1, \"Geometry::tet\", \"Mesh\" {\n  Vertices: *12 {\n   a: " +
         places + "\n  }\n  PolygonVertexIndex: *12 {\n   a: " + corners +
         "\n  }\n }\n Model: 2, \"Model::tet\", \"Mesh\" {\n  Version: 232\n  Properties70: {\n   P: \"Lcl Translation\", \"Lcl Translation\", \"\", "
         "\"A\",5,0,0\n"
         "   P: \"Lcl Scaling\", \"Lcl Scaling\", \"\", \"A\",2,2,2\n  }\n }\n}\nConnections: {\n C: \"OO\",2,0\n C: \"OO\",1,2\n}\n";
}

// The tetrahedron's corners in the world, in the order of the file.
std::vector<Vec3d> places_of(const Surface& s) {
  std::vector<Vec3d> places;
  for (const knead::Vec3f& p : s.points.host()) places.push_back(s.placement.apply(to_double(p)));
  return places;
}

TEST(MeshAssimp, ReadsEachFormatWhereItsNodesPlaceIt) {
  if (!knead::mesh::assimp_is_built_in()) GTEST_SKIP() << "built without Assimp";
  struct File {
    const char* name;
    std::string bytes;
    bool keeps_vertices;  // Assimp gives them as they are in the file
  };
  for (const File& file :
       {File{"m.glb", glb(false), true}, File{"m.gltf", gltf(false), true}, File{"seams.glb", glb(true), false},
        File{"seams.gltf", gltf(true), false}, File{"m.fbx", fbx(), false}, File{"m.3ds", three_ds(), false}, File{"m.dae", collada(false), false}}) {
    SCOPED_TRACE(file.name);
    std::vector<std::string> warnings;
    const Surface s = knead::parse_surface(file.bytes, file.name, {}, warnings);
    ASSERT_EQ(s.vertices(), 4u);
    ASSERT_EQ(s.topology->faces(), 4u);
    EXPECT_NEAR(tools::volume_of(s), 8.0 / 6, 1e-6);
    EXPECT_THAT(knead::describe_problems(s), IsEmpty());
    // Two units long from (5, 0, 0) along each axis; which way is up is the format's.
    Vec3d lower{1e9, 1e9, 1e9}, upper{-1e9, -1e9, -1e9};
    for (const Vec3d& p : places_of(s))
      for (int k = 0; k < 3; ++k) lower[k] = std::min(lower[k], p[k]), upper[k] = std::max(upper[k], p[k]);
    EXPECT_NEAR(lower.x, 5, 1e-5);
    for (int k = 0; k < 3; ++k) EXPECT_NEAR(upper[k] - lower[k], 2, 1e-5);
    // As a soft body only where vertices are the file's own: else a warning says that they are not.
    EXPECT_EQ(tools::mentions(warnings, "their order and count are not the file's"), !file.keeps_vertices) << ::testing::PrintToString(warnings);
    if (!file.keeps_vertices) continue;
    EXPECT_THAT(warnings, IsEmpty());
    for (size_t v = 0; v < 4; ++v)
      for (int k = 0; k < 3; ++k) EXPECT_NEAR(places_of(s)[v][k], 2 * kPlaces[3 * v + static_cast<size_t>(k)] + (k == 0 ? 5 : 0), 1e-6) << v;
    EXPECT_EQ(s.topology->face_vertices, std::vector<uint32_t>(std::begin(kCorners), std::end(kCorners)));
  }
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
