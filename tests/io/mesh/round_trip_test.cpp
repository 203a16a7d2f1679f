#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>

#include "io/files.h"
#include "tests/io/mesh/mesh_test_tools.h"

namespace mesh_round_trip_test {

namespace tools = mesh_test_tools;
namespace fs = std::filesystem;
using knead::Error;
using knead::ErrorCode;
using knead::Surface;
using knead::Vec3f;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

Surface with_points(const Surface& surface, const std::vector<Vec3f>& points) {
  Surface moved = surface;
  moved.points = knead::Buffer<Vec3f>(points);
  return moved;
}

std::vector<Vec3f> bent(const Surface& surface) {
  std::vector<Vec3f> points;
  for (const Vec3f& p : surface.points.host()) points.push_back({p.x + 0.3f * p.z * p.z, p.y, p.z * 1.1f});
  return points;
}

// The values at each corner, whatever the pools look like.
std::vector<std::array<float, 2>> corner_textures(const Surface& s) {
  std::vector<std::array<float, 2>> values;
  for (int32_t i : s.attributes->corner_texture)
    values.push_back(i < 0 ? std::array<float, 2>{-1, -1} : s.attributes->texture_coordinates[static_cast<size_t>(i)]);
  return values;
}
std::vector<std::array<float, 3>> corner_normals(const Surface& s) {
  std::vector<std::array<float, 3>> values;
  for (int32_t i : s.attributes->corner_normal) {
    const Vec3f n = i < 0 ? Vec3f{0, 0, 0} : s.attributes->normals[static_cast<size_t>(i)];
    values.push_back({n.x, n.y, n.z});
  }
  return values;
}

// Every number's bytes turned round, as the header lays them out. Counts of lists are of one byte.
std::string big_endian(const std::string& little) {
  const std::map<std::string, size_t> bytes_of = {{"char", 1}, {"uchar", 1}, {"short", 2}, {"ushort", 2},
                                                  {"int", 4},  {"uint", 4},  {"float", 4}, {"double", 8}};
  struct Property {
    bool list;
    size_t bytes;
  };
  std::vector<std::pair<size_t, std::vector<Property>>> elements;
  const size_t body = little.find("end_header\n") + 11;
  std::istringstream header(little.substr(0, body));
  for (std::string line, word, type; std::getline(header, line);) {
    std::istringstream words(line);
    words >> word >> type;
    if (word == "element") words >> (elements.emplace_back(), elements.back().first);
    if (word != "property") continue;
    const bool list = type == "list";
    if (list) words >> type >> type;
    elements.back().second.push_back({list, bytes_of.at(type)});
  }
  std::string big = little.substr(0, body);
  big.replace(big.find("little"), 6, "big");
  size_t at = body;
  const auto turn = [&](size_t bytes) {
    big.append(little.rbegin() + static_cast<long>(little.size() - at - bytes), little.rbegin() + static_cast<long>(little.size() - at));
    at += bytes;
  };
  for (const auto& [count, properties] : elements)
    for (size_t i = 0; i < count; ++i)
      for (const Property& p : properties) {
        size_t values = 1;
        if (p.list) values = static_cast<unsigned char>(little[at]), turn(1);
        while (values-- > 0) turn(p.bytes);
      }
  EXPECT_EQ(at, little.size());
  return big;
}

TEST(MeshRoundTrip, ObjKeepsEverything) {
  for (const bool seams : {false, true}) {
    const Surface s = tools::decorated_tube(seams);
    std::vector<std::string> notes;
    const Surface again = tools::parse(knead::format_surface("m.obj", s, {}, notes), "m.obj");
    EXPECT_THAT(notes, IsEmpty());
    EXPECT_TRUE(tools::same_bits(s, again));
    EXPECT_EQ(s.topology->face_offsets, again.topology->face_offsets);
    EXPECT_EQ(s.topology->face_vertices, again.topology->face_vertices);
    EXPECT_EQ(corner_textures(s), corner_textures(again));
    EXPECT_EQ(corner_normals(s), corner_normals(again));
    EXPECT_EQ(s.attributes->vertex_colours, again.attributes->vertex_colours);
    EXPECT_EQ(s.attributes->groups, again.attributes->groups);
    EXPECT_EQ(s.attributes->face_group, again.attributes->face_group);
    EXPECT_EQ(s.attributes->objects, again.attributes->objects);
    EXPECT_EQ(s.attributes->face_object, again.attributes->face_object);
    EXPECT_EQ(s.attributes->materials, again.attributes->materials);
    EXPECT_EQ(s.attributes->face_material, again.attributes->face_material);
    EXPECT_EQ(s.attributes->material_library, again.attributes->material_library);
  }
}

TEST(MeshRoundTrip, PlyKeepsWhatItHasAPlaceForAndSaysTheRest) {
  for (const bool ascii : {false, true})
    for (const bool seams : {false, true}) {
      const Surface s = tools::decorated_tube(seams);
      std::vector<std::string> notes;
      const Surface again = tools::parse(knead::format_surface("m.ply", s, {.ascii = ascii}, notes), "m.ply");
      EXPECT_TRUE(tools::same_bits(s, again));
      EXPECT_EQ(s.topology->face_vertices, again.topology->face_vertices);
      EXPECT_EQ(corner_textures(s), corner_textures(again));
      EXPECT_EQ(s.attributes->vertex_colours, again.attributes->vertex_colours);
      if (!seams) {
        EXPECT_EQ(corner_normals(s), corner_normals(again));
      }
      EXPECT_EQ(tools::mentions(notes, "normals left out"), seams);
      EXPECT_TRUE(tools::mentions(notes, "no place for groups"));
    }
}

TEST(MeshRoundTrip, PlyKeepsColoursThatAreNoBytes) {
  Surface s = tools::decorated_tube(false);
  knead::MeshAttributes a = *s.attributes;
  a.vertex_colours[3] = {0.1234f, 0.5f, 2.5f, 0.25f};
  s.attributes = std::make_shared<const knead::MeshAttributes>(a);
  for (const bool ascii : {false, true})
    EXPECT_EQ(tools::parse(tools::format("m.ply", s, {.ascii = ascii}), "m.ply").attributes->vertex_colours, a.vertex_colours);
}

TEST(MeshRoundTrip, BigEndianPlyIsTheSameMesh) {
  for (const double offset : {0.0, 1e6}) {
    const Surface s = tools::wavy_tube(9, 6, {offset, 0, -offset});
    const std::string little = tools::format("m.ply", s);
    const Surface again = tools::parse(big_endian(little), "m.ply");
    EXPECT_TRUE(tools::same_bits(s, again));
    EXPECT_EQ(s.topology->face_vertices, again.topology->face_vertices);
  }
}

// Of every type the ends of its range, and numbers that only its own digits hold.
TEST(MeshRoundTrip, PlyKeepsOwnNumbersOfEveryType) {
  const std::vector<std::pair<std::string, std::vector<double>>> types = {
      {"char", {-128, 127, 0}},
      {"uchar", {0, 255, 7}},
      {"short", {-32768, 32767, -1}},
      {"ushort", {0, 65535, 256}},
      {"int", {-2147483648.0, 2147483647.0, 16777217}},
      {"uint", {0, 4294967295.0, 2147483648.0}},
      {"float", {static_cast<double>(0.1f), static_cast<double>(-1e-40f), static_cast<double>(3e38f)}},
      {"double", {0.1, -1e-300, 1e300}}};
  Surface s = tools::wavy_tube(5, 2);
  knead::MeshAttributes a;
  for (const auto& [type, values] : types) {
    a.vertex_properties.push_back({"of_vertex_" + type, type, {}});
    a.face_properties.push_back({"of_face_" + type, type, {}});
    for (size_t i = 0; i < s.vertices(); ++i) a.vertex_properties.back().values.push_back(values[i % 3]);
    for (size_t i = 0; i < s.topology->faces(); ++i) a.face_properties.back().values.push_back(values[(i + 1) % 3]);
  }
  s.attributes = std::make_shared<const knead::MeshAttributes>(a);
  const std::string little = tools::format("m.ply", s);
  for (const std::string& bytes : {little, big_endian(little), tools::format("m.ply", s, {.ascii = true})}) {
    const Surface again = tools::parse(bytes, "m.ply");
    EXPECT_TRUE(tools::same_bits(s, again));
    EXPECT_EQ(s.topology->face_vertices, again.topology->face_vertices);
    const auto expect_same = [](const std::vector<knead::MeshProperty>& was, const std::vector<knead::MeshProperty>& is) {
      ASSERT_EQ(was.size(), is.size());
      for (size_t k = 0; k < was.size(); ++k) {
        EXPECT_EQ(was[k].name, is[k].name);
        EXPECT_EQ(was[k].type, is[k].type) << was[k].name;
        EXPECT_EQ(was[k].values, is[k].values) << was[k].name;
      }
    };
    expect_same(a.vertex_properties, again.attributes->vertex_properties);
    expect_same(a.face_properties, again.attributes->face_properties);
    EXPECT_EQ(tools::format("m.ply", again), little);
  }
}

TEST(MeshRoundTrip, AnyOffsetAndAnySizeComesBackBitForBit) {
  for (const double size : {1e-12, 1e-4, 1.0, 1e4, 1e12})
    for (const double offset : {0.0, 3.0, 17.0, 25.0, 29.0, 30.0, 31.0, 33.0, 1e3, 1e6, 3.3e9}) {
      const Surface s = tools::wavy_tube(11, 9, {offset * size, -0.7 * offset * size, 0.01 * offset * size}, size);
      EXPECT_EQ(s.placement.is_identity(), length(0.5 * (to_double(s.lower) + to_double(s.upper)) + s.placement.translation) <= 8 * s.diagonal())
          << offset;
      if (offset >= 1e3) {
        EXPECT_FALSE(s.placement.is_identity());
      }
      EXPECT_LE(length(0.5 * (to_double(s.lower) + to_double(s.upper))), 8.001 * s.diagonal());
      for (const bool ascii : {false, true})
        for (const char* name : {"m.obj", "m.ply"}) {
          const Surface again = tools::parse(tools::format(name, s, {.ascii = ascii}), name);
          EXPECT_TRUE(tools::same_bits(s, again)) << name << " size " << size << " offset " << offset;
        }
    }
}

TEST(MeshRoundTrip, StlComesBackWithTheSameCorners) {
  const Surface s = tools::wavy_tube(8, 4);
  for (const bool ascii : {false, true}) {
    const Surface again = tools::parse(tools::format("m.stl", s, {.ascii = ascii}), "m.stl");
    EXPECT_EQ(again.vertices(), s.vertices());
    ASSERT_EQ(again.topology->triangle_count(), s.topology->triangle_count());
    for (size_t c = 0; c < 3 * s.topology->triangle_count(); ++c) {
      const Vec3f p = s.points.host()[s.topology->triangles[c]], q = again.points.host()[again.topology->triangles[c]];
      EXPECT_TRUE(p.x == q.x && p.y == q.y && p.z == q.z);
    }
  }
}

TEST(MeshRoundTrip, PlacementIsAppliedInDouble) {
  Surface s = tools::wavy_tube(7, 5);
  s.placement.scale = 2;
  s.placement.rotation = {0, -1, 0, 1, 0, 0, 0, 0, 1};
  s.placement.translation = {1e7, 0, 0.125};
  const Surface again = tools::parse(tools::format("m.obj", s), "m.obj");
  for (size_t i = 0; i < s.vertices(); ++i) {
    const knead::Vec3d p = s.placement.apply(to_double(s.points.host()[i])), q = again.placement.apply(to_double(again.points.host()[i]));
    EXPECT_LT(length(p - q), 1e-6);
  }
}

TEST(MeshRoundTrip, PrecisionShortensTheText) {
  const Surface s = tools::wavy_tube(7, 5);
  EXPECT_LT(tools::format("m.obj", s, {.precision = 4}).size(), tools::format("m.obj", s).size());
  const Surface again = tools::parse(tools::format("m.obj", s, {.precision = 4}), "m.obj");
  for (size_t i = 0; i < s.vertices(); ++i) EXPECT_LT(length(to_double(s.points.host()[i]) - to_double(again.points.host()[i])), 1e-3);
}

TEST(MeshRoundTrip, NormalsFollowTheDeformation) {
  const Surface s = tools::decorated_tube(false);
  const auto written = [](const Surface& surface) { return corner_normals(tools::parse(tools::format("m.obj", surface), "m.obj")); };
  const std::vector<Vec3f> rest(s.points.host().begin(), s.points.host().end());
  EXPECT_EQ(written(with_points(s, rest)), corner_normals(s));  // other storage, same points: the file's own
  const auto recomputed = written(with_points(s, bent(s)));
  EXPECT_NE(recomputed, corner_normals(s));
  for (const auto& n : recomputed) EXPECT_NEAR(n[0] * n[0] + n[1] * n[1] + n[2] * n[2], 1, 1e-5);
}

TEST(MeshRoundTrip, RecomputedNormalsPointOutAndKeepHardEdges) {
  // A cube with one normal a side, written as twelve triangles, then stretched: each side still has its one normal.
  const char* const cube =
      "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\nvn 0 0 -1\nvn 0 0 1\nvn 0 -1 0\nvn 1 0 0\nvn 0 1 0\nvn -1 0 0\n"
      "f 4//1 3//1 2//1\nf 4//1 2//1 1//1\nf 5//2 6//2 7//2 8//2\nf 1//3 2//3 6//3 5//3\nf 2//4 3//4 7//4 6//4\nf 3//5 4//5 8//5 7//5\nf 4//6 1//6 "
      "5//6 8//6\n";
  const Surface s = tools::parse(cube, "m.obj");
  std::vector<Vec3f> stretched;
  for (const Vec3f& p : s.points.host()) stretched.push_back({p.x * 3, p.y, p.z});
  const auto normals = corner_normals(tools::parse(tools::format("m.obj", with_points(s, stretched)), "m.obj"));
  EXPECT_EQ(normals, corner_normals(s));
  Surface turned = s;
  turned.placement.rotation = {0, -1, 0, 1, 0, 0, 0, 0, 1};  // x to y, y to -x
  const auto rotated = corner_normals(tools::parse(tools::format("m.obj", turned), "m.obj"));
  for (size_t c = 0; c < normals.size(); ++c) EXPECT_EQ(rotated[c], (std::array<float, 3>{-normals[c][1], normals[c][0], normals[c][2]}));
}

class MeshFiles : public ::testing::Test {
 protected:
  MeshFiles()
      : folder_(fs::temp_directory_path() /
                ("knead_mesh_" + std::to_string(::getpid()) + ::testing::UnitTest::GetInstance()->current_test_info()->name())) {
    fs::create_directories(folder_);
  }
  ~MeshFiles() override { fs::remove_all(folder_); }
  std::string at(const std::string& name) const { return (folder_ / name).string(); }
  fs::path folder_;
};

TEST_F(MeshFiles, WrittenFilesReadBack) {
  const Surface s = tools::decorated_tube(true);
  std::vector<std::string> warnings;
  for (const char* name : {"a/b.obj", "a/b.PLY"}) {
    knead::write_surface(at(name), s);
    EXPECT_TRUE(tools::same_bits(s, knead::read_surface(at(name), warnings)));
  }
  EXPECT_THAT(warnings, IsEmpty());
}

TEST_F(MeshFiles, AFailedWriteLeavesNothing) {
  std::vector<Vec3f> points(tools::wavy_tube(5, 3).vertices(), Vec3f{std::nanf(""), 0, 0});
  const Surface broken = with_points(tools::wavy_tube(5, 3), points);
  EXPECT_THAT(tools::error_of([&] { knead::write_surface(at("m.obj"), broken); }).what(), HasSubstr("vertex 0"));
  EXPECT_EQ(tools::error_of([&] { knead::write_surface(at("m.off"), tools::wavy_tube(5, 3)); }).code(), ErrorCode::kFile);
  EXPECT_TRUE(fs::is_empty(folder_));
  std::ofstream(at("file")) << "x";
  EXPECT_EQ(tools::error_of([&] { knead::write_surface(at("file/m.obj"), tools::wavy_tube(5, 3)); }).where().file, at("file/m.obj"));
}

TEST_F(MeshFiles, ReadingNamesWhatIsNearest) {
  knead::write_surface(at("head.obj"), tools::wavy_tube(5, 3));
  std::vector<std::string> warnings;
  EXPECT_THAT(tools::error_of([&] { knead::read_surface(at("haed.obj"), warnings); }).hint(), HasSubstr("head.obj"));
}

TEST_F(MeshFiles, AFullDiskIsAnError) {
  if (!fs::exists("/dev/full")) GTEST_SKIP() << "no /dev/full";
  fs::create_symlink("/dev/full", at("m.obj"));
  EXPECT_THAT(tools::error_of([&] { knead::write_surface(at("m.obj"), tools::wavy_tube(50, 300)); }).what(), HasSubstr("no space left"));
}

}  // namespace mesh_round_trip_test
