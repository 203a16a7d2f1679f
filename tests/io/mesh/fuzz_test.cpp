// Damaged files, made from good ones: each is read or refused with a knead::Error that names the file, and what is read is sound.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "tests/io/mesh/mesh_test_tools.h"

namespace mesh_fuzz_test {

namespace tools = mesh_test_tools;
using knead::Error;
using knead::Surface;

struct Sample {
  std::string name, bytes;
};

std::string with_own_properties(bool ascii) {
  Surface surface = tools::wavy_tube(5, 2);
  knead::MeshAttributes a;
  a.vertex_properties = {{"quality", "float", {}}, {"id", "int", {}}};
  a.face_properties = {{"flags", "uchar", {}}};
  for (size_t i = 0; i < surface.vertices(); ++i)
    for (knead::MeshProperty& p : a.vertex_properties) p.values.push_back(static_cast<double>(i));
  a.face_properties[0].values.assign(surface.topology->faces(), 3);
  surface.attributes = std::make_shared<const knead::MeshAttributes>(a);
  return tools::format("own.ply", surface, {.ascii = ascii});
}

std::string big_endian_strips() {
  std::string bytes =
      "ply\nformat binary_big_endian 1.0\nelement tristrips 2\nproperty list uchar short indices\nelement Vertex 4\nproperty FLOAT x\nproperty float "
      "y\n"
      "property float z\nproperty uchar flags\nend_header\n";
  const auto strip = [&](std::initializer_list<int> corners) {
    bytes += static_cast<char>(corners.size());
    for (const int v : corners) bytes += static_cast<char>(v >> 8), bytes += static_cast<char>(v);
  };
  strip({0, 1, 2, 3, 0, 1, -1, 0, 2, 1});
  strip({1, 2, 3});
  for (int v = 0; v < 4; ++v) {
    for (int k = 0; k < 3; ++k) bytes += k + 1 == v ? std::string("\x3f\x80\0\0", 4) : std::string(4, '\0');
    bytes += static_cast<char>(v);
  }
  return bytes;
}

std::vector<Sample> samples() {
  const Surface plain = tools::wavy_tube(6, 4), decorated = tools::decorated_tube(true);
  return {
      {"a.obj", tools::format("a.obj", plain)},
      {"b.obj", tools::format("b.obj", decorated)},
      {"a.ply", tools::format("a.ply", plain)},
      {"b.ply", tools::format("b.ply", decorated)},
      {"c.ply", tools::format("c.ply", decorated, {.ascii = true})},
      {"a.stl", tools::format("a.stl", plain)},
      {"b.stl", tools::format("b.stl", plain, {.ascii = true})},
      {"own.ply", with_own_properties(false)},
      {"own_ascii.ply", with_own_properties(true)},
      {"strips.ply",
       "ply\nformat ascii 1.0\nmade by a test\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement tristrips 1\n"
       "property list int int vertex_indices\nend_header\n0 0 0 1\n0 0 0 1\n0\n0 0 1\n10 0 1 2 3 0 1 -1 0 2 1\n"},
      {"strips_big.ply", big_endian_strips()},
      {"side.obj",
       "\xef\xbb\xbf$ made\nmtllib a\\\nv 0 0 0 # c\nv 1 0 0 1 2\nV 0 1 0\nv 0 0 \\\n1\nvn 1 0\nf 1/1/1 3/ 2\nf 1// 2//1 4\nf 1 4\nf 2 3 4 # c\n"
       "F 3 1 4\nl 1 2\nend of it\n\x1a"},
      {"side.stl",
       "SOLID a facet b\nFACET NORMAL 0 0 1 OUTER LOOP VERTEX 0 0 0 VERTEX 1 0 0\nvertex 0 1 0\nend loop end facet\ncolour 1 2\nend solid\nsolid b\n"
       "facet\nouterloop\nvertex 0 0 0\nvertex 0 1 0\nvertex 0\n0 1\nendloop endfacet\n"},
      {"bare.off", "NOFF\n4.0 4 0\n0 0 0\n1.D0 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 2 0 3.0\n"},
      {"loose.stl",
       "<made>\nsolid facet normal of x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1.0D0 0\nendloop\nendfacet\nendsolid\n"
       "facet outer loop vertex 0 0 0 vertex 0 1 0 vertex 0 0 1 endloop endfacet\n"},
      {"glued.off", "OFF4 4\n0 0 0 1 0 0 # c\n0 1 0\n0 0\n1\n3 0 2 1 3 0 1 3\n3\n1 2 3 3 2 0 3\n"},
      {"sides.off",
       "stnc4off\n4\n4\n6\n0 0 0 1 0 0 1 9 9 9 0 0\n1 0 0 1 0 0 1 9 9 9 1 0\n0 1 0 1 0 0 1 9 9 9 0 1\n0 0 1 1 0 0 1 9 9 9 1 1\n3 0 2 1 255 0 0\n"
       "3 0 1 3\n2 0 1\n3 1 2 3 0.5\n"},
      {"a.off", "COFF\n4 4 0\n0 0 0 1 0 0 1\n1 0 0 0 1 0 1\n0 1 0 0 0 1 1\n0 0 1 1 1 1 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 2 0 3\n"}};
}

// True when the bytes were refused.
bool read_or_refuse(const std::string& bytes, const std::string& name) {
  std::vector<std::string> warnings;
  try {
    const Surface s = knead::parse_surface(bytes, name, {}, warnings);
    for (const knead::Vec3f& p : s.points.host()) EXPECT_TRUE(std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z));
    for (uint32_t v : s.topology->face_vertices) EXPECT_LT(v, s.vertices());
    for (uint32_t v : s.topology->triangles) EXPECT_LT(v, s.vertices());
    EXPECT_GT(s.topology->triangle_count(), 0u);
    const knead::MeshAttributes& a = *s.attributes;
    EXPECT_TRUE(a.vertex_colours.empty() || a.vertex_colours.size() == s.vertices());
    for (const auto* per_corner : {&a.corner_texture, &a.corner_normal})
      EXPECT_TRUE(per_corner->empty() || per_corner->size() == s.topology->corners());
    for (int32_t i : a.corner_texture) EXPECT_LT(i, static_cast<int32_t>(a.texture_coordinates.size()));
    for (int32_t i : a.corner_normal) EXPECT_LT(i, static_cast<int32_t>(a.normals.size()));
    for (const knead::MeshProperty& p : a.vertex_properties) EXPECT_EQ(p.values.size(), s.vertices());
    for (const knead::MeshProperty& p : a.face_properties) EXPECT_EQ(p.values.size(), s.topology->faces());
    for (const auto* per_face : {&a.face_group, &a.face_object, &a.face_material})
      EXPECT_TRUE(per_face->empty() || per_face->size() == s.topology->faces());
    knead::describe_problems(s);
    for (const char* again : {"again.obj", "again.ply", "again.stl"}) tools::format(again, s);
    return false;
  } catch (const Error& error) {
    EXPECT_EQ(error.where().file, name) << error.what();
    EXPECT_FALSE(error.message().empty());
    EXPECT_TRUE(error.code() == knead::ErrorCode::kFile || error.code() == knead::ErrorCode::kInput) << error.what();
    return true;
  }
}

TEST(MeshFuzz, TheSamplesAreGood) {
  for (const Sample& sample : samples()) EXPECT_FALSE(read_or_refuse(sample.bytes, sample.name)) << sample.name;
}

TEST(MeshFuzz, CutFilesAreReadOrRefused) {
  for (const Sample& sample : samples()) {
    size_t refused = 0, tried = 0;
    for (size_t bytes = 0; bytes < sample.bytes.size(); bytes += 97, ++tried) refused += read_or_refuse(sample.bytes.substr(0, bytes), sample.name);
    // OBJ, OFF and STL in text have no end; a cut between two elements is a smaller mesh. The others know their length.
    if (sample.name.ends_with(".ply") || sample.name == "a.stl") {
      EXPECT_EQ(refused, tried) << sample.name;
    }
  }
}

TEST(MeshFuzz, MutatedFilesAreReadOrRefused) {
  static const char* const kWords[] = {"nan",    "-1",  "0",      "99999999", "1e308",    "\n",    " ",
                                       "-",      "/",   "\\\n",   "#",        "D+00",     "\\ \n", "4294967296",
                                       "1e-320", "\r",  "f 1 2",  "list",     "\x00\xff", "\x1a",  "\xef\xbb\xbf",
                                       "OFF",    "end", "solid ", "# ",       "/0",       "1e400", "comment c\n"};
  std::mt19937 random(20240601);
  const auto below = [&](size_t n) { return n ? random() % n : 0; };
  size_t refused = 0, tried = 0;
  for (const Sample& sample : samples())
    for (int round = 0; round < 80; ++round, ++tried) {
      std::string bytes = sample.bytes;
      for (size_t changes = 1 + below(4); changes > 0; --changes) {
        const size_t at = below(bytes.size());
        // Half of the damage hits the beginning, where the headers are.
        const size_t place = below(2) ? at : below(std::min<size_t>(bytes.size(), 250));
        switch (below(5)) {
          case 0: bytes[place] = static_cast<char>(random()); break;
          case 1: bytes[place] = static_cast<char>(bytes[place] ^ (1 << below(8))); break;
          case 2: bytes.erase(place, 1 + below(20)); break;
          case 3: bytes.insert(place, kWords[below(std::size(kWords))]); break;
          default: bytes.insert(place, bytes.substr(at, below(40))); break;
        }
        if (bytes.empty()) bytes = "x";
      }
      SCOPED_TRACE(sample.name + " round " + std::to_string(round));
      refused += read_or_refuse(bytes, sample.name);
    }
  EXPECT_GT(refused, tried / 4);
  EXPECT_LT(refused, tried);
}

TEST(MeshFuzz, NoiseIsRefused) {
  std::mt19937 random(5);
  for (const char* name : {"n.obj", "n.ply", "n.stl", "n.off"})
    for (size_t size = 1; size < 4000; size += 131) {
      std::string bytes(size, ' ');
      for (char& c : bytes) c = static_cast<char>(random());
      EXPECT_TRUE(read_or_refuse(bytes, name));
    }
}

}  // namespace mesh_fuzz_test
