#include "io/tets/tet_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <random>

#include "graph/error.h"
#include "io/files.h"

namespace tet_file_test {

using knead::TetField;
using knead::TetFile;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

std::string at(const std::string& name) {
  const std::filesystem::path folder = std::filesystem::temp_directory_path() / "knead_tet_file_test";
  std::filesystem::create_directories(folder);
  return (folder / name).string();
}

std::string file(const std::string& name, const std::string& text) {
  knead::write_whole_file(at(name), text);
  return at(name);
}

TetFile read(const std::string& path) {
  std::vector<std::string> warnings;
  TetFile mesh = knead::read_tet_file(path, warnings);
  EXPECT_THAT(warnings, IsEmpty());
  return mesh;
}

std::string refusal(const std::string& path) {
  try {
    std::vector<std::string> warnings;
    knead::read_tet_file(path, warnings);
  } catch (const knead::Error& e) {
    return e.what();
  }
  return "";
}

TetFile two_tets() {
  return {{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0.1, 1.0 / 3, 1e6 + 0.125}}, {{0, 1, 2, 3}, {1, 2, 3, 4}}};
}

void expect_same(const TetFile& a, const TetFile& b) {
  ASSERT_EQ(a.points.size(), b.points.size());
  for (size_t v = 0; v < a.points.size(); ++v)
    for (int k = 0; k < 3; ++k) EXPECT_EQ(a.points[v][k], b.points[v][k]);
  EXPECT_EQ(a.tets, b.tets);
}

TEST(TetFile, ComesBackToTheBitFromEveryFormat) {
  const TetFile mesh = two_tets();
  const std::vector<TetField> fields{
      {"weight", false, 1, {1, 2, 3, 4, 5}}, {"rest", false, 3, std::vector<double>(15, 0.5)}, {"volume", true, 1, {1, 2}}};
  for (const char* name : {"round.vtu", "round.vtk", "round.msh"}) {
    knead::write_tet_file(at(name), mesh, fields);
    expect_same(read(at(name)), mesh);
  }
}

const char* const kMsh2 = R"($MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
1
3 1 "body"
$EndPhysicalNames
$Nodes
5
10 0 0 0
20 1 0 0
30 0 1 0
40 0 0 1
50 0.1 0.333 2
$EndNodes
$Elements
3
1 2 2 0 1 10 20 30
2 4 2 0 1 10 20 30 40
3 4 2 0 1 20 30 40 50
$EndElements
)";

TEST(TetFile, OfGmshMayNumberItsNodesAsItLikes) {
  const TetFile mesh = read(file("two.msh", kMsh2));
  EXPECT_EQ(mesh.tets, two_tets().tets);
  EXPECT_EQ(mesh.points.size(), 5u);
  EXPECT_THAT(refusal(file("cut.msh", std::string(kMsh2).substr(0, 200))), HasSubstr("cut.msh:"));
  std::string wrong = kMsh2;
  wrong.replace(wrong.find("20 30 40 50"), 11, "20 30 40 60");
  EXPECT_THAT(refusal(file("wrong.msh", wrong)), HasSubstr("node 60"));
}

template <class T>
std::string big_endian(const std::vector<T>& values) {
  std::string bytes;
  for (const T value : values) {
    const char* from = reinterpret_cast<const char*>(&value);
    for (size_t k = sizeof(T); k-- > 0;) bytes += from[k];
  }
  return bytes;
}

TEST(TetFile, OfVtkMayBeBinaryOfBothKinds) {
  const std::string points = big_endian<float>({0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1});
  const std::string old_one = "# vtk DataFile Version 3.0\nt\nBINARY\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 float\n" + points + "\nCELLS 2 9\n" +
                              big_endian<int32_t>({3, 0, 1, 2, 4, 0, 1, 2, 3}) + "\nCELL_TYPES 2\n" + big_endian<int32_t>({5, 10}) + "\n";
  EXPECT_THAT(read(file("old.vtk", old_one)).tets, ElementsAre(std::array<uint32_t, 4>{0, 1, 2, 3}));
  const std::string new_one = "# vtk DataFile Version 5.1\nt\nBINARY\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 float\n" + points +
                              "\nCELLS 3 7\nOFFSETS vtktypeint64\n" + big_endian<int64_t>({0, 3, 7}) + "\nCONNECTIVITY vtktypeint64\n" +
                              big_endian<int64_t>({0, 1, 2, 0, 1, 2, 3}) + "\nCELL_TYPES 2\n" + big_endian<int32_t>({5, 10}) + "\n";
  EXPECT_THAT(read(file("new.vtk", new_one)).tets, ElementsAre(std::array<uint32_t, 4>{0, 1, 2, 3}));
}

TEST(TetFile, OfVtkInXmlMayBeTextOrAppended) {
  const std::string head =
      "<?xml version='1.0'?>\n<VTKFile type=\"UnstructuredGrid\" version='0.1' byte_order='LittleEndian'>\n<UnstructuredGrid>\n"
      "<Piece NumberOfPoints='4' NumberOfCells='1'>\n";
  const std::string text = head +
                           "<Points><DataArray type='Float32' NumberOfComponents='3' format='ascii'>0 0 0 1 0 0 0 1 0 0 0 1</DataArray></Points>\n"
                           "<Cells><DataArray type='Int32' Name='connectivity' format='ascii'>0 1 2 3</DataArray>\n"
                           "<DataArray type='Int32' Name='offsets' format='ascii'>4</DataArray>\n"
                           "<DataArray type='UInt8' Name='types' format='ascii'>10</DataArray></Cells></Piece></UnstructuredGrid></VTKFile>";
  EXPECT_EQ(read(file("text.vtu", text)).tets.size(), 1u);
  const auto block = [](const auto& values) {
    const auto size = static_cast<uint32_t>(values.size() * sizeof(values[0]));
    return std::string(reinterpret_cast<const char*>(&size), 4) + std::string(reinterpret_cast<const char*>(values.data()), size);
  };
  const std::string raw = head +
                          "<Points><DataArray type='Float32' NumberOfComponents='3' format='appended' offset='0'/></Points>\n"
                          "<Cells><DataArray type='Int32' Name='connectivity' format='appended' offset='52'/>\n"
                          "<DataArray type='Int32' Name='offsets' format='appended' offset='72'/>\n"
                          "<DataArray type='UInt8' Name='types' format='appended' offset='80'/></Cells></Piece></UnstructuredGrid>\n"
                          "<AppendedData encoding='raw'>\n_" +
                          block(std::vector<float>{0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1}) + block(std::vector<int32_t>{0, 1, 2, 3}) +
                          block(std::vector<int32_t>{4}) + block(std::vector<uint8_t>{10}) + "\n</AppendedData></VTKFile>";
  const TetFile mesh = read(file("raw.vtu", raw));
  EXPECT_THAT(mesh.tets, ElementsAre(std::array<uint32_t, 4>{0, 1, 2, 3}));
  EXPECT_EQ(mesh.points[3].z, 1);
}

TEST(TetFile, OfTetGenMayCountFromZeroOrFromOne) {
  for (const int first : {0, 1}) {
    std::string nodes = "# vertices\n4 3 1 1\n", tets = "1 4 0\n";
    for (int v = 0; v < 4; ++v)
      nodes += std::to_string(v + first) + " " + (v == 1 ? "1" : "0") + " " + (v == 2 ? "1" : "0") + " " + (v == 3 ? "1" : "0") + " 7.5 1  # one\n";
    tets += std::to_string(first);
    for (int v = 0; v < 4; ++v) tets += " " + std::to_string(v + first);
    file("t.1.node", nodes);
    EXPECT_THAT(read(file("t.1.ele", tets + "\n")).tets, ElementsAre(std::array<uint32_t, 4>{0, 1, 2, 3}));
  }
}

TEST(TetFile, WithoutTetsOrOfOtherCellsSaysSo) {
  std::string surface = kMsh2;
  surface.replace(surface.find("3\n1 2 2"), surface.find("$EndElements") - surface.find("3\n1 2 2"), "1\n1 2 2 0 1 10 20 30\n");
  EXPECT_THAT(refusal(file("surface.msh", surface)), HasSubstr("holds no tets (5 points, 1 faces or edges, 0 other cells)"));
  std::string curved = kMsh2;
  curved.replace(curved.find("3 4 2 0 1 20 30 40 50"), 21, "3 11 2 0 1 20 30 40 50 10 10 10 10 10 10");
  std::vector<std::string> warnings;
  EXPECT_EQ(knead::read_tet_file(file("curved.msh", curved), warnings).tets.size(), 2u);
  EXPECT_THAT(warnings, ElementsAre(HasSubstr("1 of 2 tets are curved")));
  EXPECT_THAT(refusal(at("h.obj")), HasSubstr(".vtu, .vtk, .msh"));
}

TEST(TetFile, OfGarbageIsRefusedOrRead) {
  std::mt19937 random(7);
  for (const char* name : {"round.vtu", "round.vtk", "round.msh"}) {
    knead::write_tet_file(at(name), two_tets(), {});
    const std::string whole = knead::read_whole_file(at(name));
    for (int n = 0; n < 400; ++n) {
      std::string broken = whole.substr(0, n % 3 == 0 ? random() % whole.size() : whole.size());
      for (int k = 0; k < 3 && !broken.empty(); ++k) broken[random() % broken.size()] = static_cast<char>("0123456789-. <\n\x80"[random() % 16]);
      (void)refusal(file(std::string("broken") + std::filesystem::path(name).extension().string(), broken));  // no crash, no hang
    }
  }
}

}  // namespace tet_file_test
