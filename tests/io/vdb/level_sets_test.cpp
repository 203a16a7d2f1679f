// Level sets as other programs and other versions write them.
#include <blosc.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <openvdb/io/Stream.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/LevelSetSphere.h>
#include <zlib.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>

#include "graph/error.h"
#include "io/files.h"
#include "io/vdb/vdb.h"
#include "kernels/sdf_sample.h"
#include "tests/paths.h"

namespace level_sets_test {

using knead::ReadSdf;
using knead::Sdf;
using knead::Vec3d;
using openvdb::Coord;
using openvdb::FloatGrid;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

std::string at(const std::string& name) {
  const std::filesystem::path folder = std::filesystem::temp_directory_path() / "knead_level_sets_test";
  std::filesystem::create_directories(folder);
  return (folder / name).string();
}

double sample(const Sdf& sdf, const Vec3d& world) {
  const Vec3d local = sdf.placement.inverse().apply(world);
  const float far = 1e9f;
  const auto* grid = reinterpret_cast<const nanovdb::NanoGrid<float>*>(sdf.grid.host().data());
  knead::SdfSampler sampler(knead::SdfView{grid, {-far, -far, -far}, {far, far, far}});
  return sampler.value(knead::to_float((local - to_double(sdf.index_origin)) * (1.0 / sdf.voxel_size))) * sdf.placement.scale;
}

ReadSdf read(const std::string& path, const std::string& name = "") {
  return knead::read_sdf(path, name, *knead::make_serial_executor());
}

std::string refusal(const std::string& path, const std::string& name = "") {
  try {
    read(path, name);
  } catch (const knead::Error& e) {
    EXPECT_EQ(e.where().file, path);
    return e.what();
  }
  return "";
}

FloatGrid::Ptr sphere(const std::string& name, double radius = 1) {
  openvdb::initialize();
  auto grid = openvdb::tools::createLevelSetSphere<FloatGrid>(static_cast<float>(radius), openvdb::Vec3f(0), 0.1f, 3.0f);
  grid->setName(name);
  return grid;
}

std::string write(const std::string& name, const openvdb::GridPtrVec& grids) {
  openvdb::io::File(at(name)).write(grids);
  return at(name);
}

void expect_ball(const Sdf& sdf, double radius = 1, const Vec3d& centre = {0, 0, 0}, double tolerance = 0.012) {
  for (double r = 0.2; r < radius + 0.1; r += 0.07) EXPECT_NEAR(sample(sdf, centre + Vec3d{0.6 * r, 0, -0.8 * r}), r - radius, tolerance) << r;
}

void replace_all(std::string& bytes, const std::string& from, const std::string& to, size_t first = 0) {
  for (size_t found = bytes.find(from, first); found != std::string::npos; found = bytes.find(from, found + 1)) bytes.replace(found, to.size(), to);
}

template <class T>
void put(std::string& bytes, size_t where, T value) {
  bytes.replace(where, sizeof value, reinterpret_cast<const char*>(&value), sizeof value);
}

TEST(LevelSets, StepOverGridsOfUnknownTypes) {
  for (const bool first : {false, true}) {
    std::string bytes = knead::read_whole_file(write(
        "foreign.vdb", first ? openvdb::GridPtrVec{sphere("odd", 0.5), sphere("tool")} : openvdb::GridPtrVec{sphere("tool"), sphere("odd", 0.5)}));
    bytes.replace(bytes.find("Tree_float_5_4_3", bytes.find("odd")), 16, "Tree_thing_5_4_3");
    knead::write_whole_file(at("foreign.vdb"), bytes);
    const ReadSdf got = read(at("foreign.vdb"));
    expect_ball(got.sdf);
    EXPECT_THAT(got.warnings, ElementsAre(HasSubstr("grid 'odd' is of a type that is unknown here (Tree_thing_5_4_3); it is stepped over")));
    EXPECT_THAT(refusal(at("foreign.vdb"), "odd"), HasSubstr("unknown here (Tree_thing_5_4_3)"));
  }
}

TEST(LevelSets, ReadFilesWithoutPositionsUpToTheFirstUnknownType) {
  std::ostringstream stream;
  openvdb::io::Stream(stream).write(openvdb::GridPtrVec{sphere("tool"), sphere("odd", 0.5), sphere("last", 0.4)});
  std::string bytes = stream.str();
  knead::write_whole_file(at("stream.vdb"), bytes);
  expect_ball(read(at("stream.vdb"), "last").sdf, 0.4);
  bytes.replace(bytes.find("Tree_float_5_4_3", bytes.find("odd")), 16, "Tree_thing_5_4_3");
  knead::write_whole_file(at("stream.vdb"), bytes);
  const ReadSdf got = read(at("stream.vdb"));
  expect_ball(got.sdf);
  EXPECT_THAT(got.warnings, ElementsAre(HasSubstr("what follows grid 'odd' cannot be reached"), HasSubstr("stepped over")));
}

TEST(LevelSets, AreChosenAndTheChoiceIsSaid) {
  const std::string two = write("two.vdb", {sphere("small", 0.4), sphere("tool")});
  const ReadSdf got = read(two);
  expect_ball(got.sdf, 0.4);
  EXPECT_THAT(got.warnings, ElementsAre("the file holds 2 level sets, 'small' and 'tool'; 'small' is taken, name one with grid"));
  EXPECT_THAT(read(two, "tool").warnings, IsEmpty());

  auto empty = FloatGrid::create(0.3f);
  empty->setName("nothing");
  empty->setGridClass(openvdb::GRID_LEVEL_SET);
  const ReadSdf second = read(write("empty_first.vdb", {empty, sphere("tool")}));
  expect_ball(second.sdf);
  EXPECT_THAT(second.warnings, ElementsAre("'nothing' is empty and stepped over"));

  auto density = FloatGrid::create(0.0f);
  density->setName("density");
  density->tree().setValue(Coord(1, 2, 3), 0.5f);
  auto vectors = openvdb::Vec3SGrid::create();
  vectors->setName("v");
  vectors->setGridClass(openvdb::GRID_STAGGERED);
  auto unmarked = sphere("shape");
  unmarked->setGridClass(openvdb::GRID_UNKNOWN);
  const ReadSdf third = read(write("unmarked.vdb", {vectors, density, unmarked}));
  expect_ball(third.sdf);
  EXPECT_THAT(third.warnings, ElementsAre(HasSubstr("'shape' is not marked")));
}

TEST(LevelSets, OfOneNameAreToldApart) {
  const std::string path = write("same.vdb", {sphere("tool"), sphere("tool", 0.5)});
  expect_ball(read(path, "tool[1]").sdf, 0.5);
  const ReadSdf got = read(path, "tool");
  EXPECT_THAT(got.warnings, ElementsAre(HasSubstr("2 grids called 'tool'")));
}

TEST(LevelSets, MayShareATree) {
  const auto one = sphere("one");
  auto moved = one->copy();
  moved->setName("moved");
  moved->setTransform(openvdb::math::Transform::createLinearTransform(0.1));
  moved->transform().postTranslate({5, 0, 0});
  expect_ball(read(write("shared.vdb", {one, moved}), "moved").sdf, 1, {5, 0, 0});
}

FloatGrid::Ptr dense(const std::function<double(const Vec3d&)>& distance, float background, int half = 16) {
  openvdb::initialize();
  auto grid = FloatGrid::create(background);
  grid->setName("sdf");
  grid->setTransform(openvdb::math::Transform::createLinearTransform(0.1));
  for (int i = -half; i <= half; ++i)
    for (int j = -half; j <= half; ++j)
      for (int k = -half; k <= half; ++k) {
        const auto value = static_cast<float>(distance(Vec3d{0.1 * i, 0.1 * j, 0.1 * k}));
        if (value != background) grid->tree().setValue(Coord(i, j, k), value);  // as arrays are copied in
      }
  return grid;
}

TEST(LevelSets, InADenseBoxOverZerosAreConverted) {
  const ReadSdf got = read(write("dense.vdb", {dense([](const Vec3d& p) { return length(p) - 1; }, 0)}));
  expect_ball(got.sdf);
  EXPECT_THAT(got.warnings, ElementsAre("grid 'sdf' holds dense distances with background 0, taken as a level set"));

  // A box with faces through voxels: exact zeros count as background and are not active.
  const auto of_box = [](const Vec3d& p) {
    double distance = -1e9;
    for (int k = 0; k < 3; ++k) distance = std::max(distance, std::round(1e6 * (std::abs(p[k]) - 1)) * 1e-6);
    return distance;
  };
  const Sdf box = read(write("dense_box.vdb", {dense(of_box, 0)})).sdf;
  for (const double x : {0.8, 0.95, 1.0, 1.1}) {
    EXPECT_NEAR(sample(box, {x, 0.3, 0}), x - 1, 1e-4);
    EXPECT_NEAR(sample(box, {0.2, 0.1, -x}), x - 1, 1e-4);
  }
}

TEST(LevelSets, ThatReachTheBorderOfTheirBoxAreClosedThereWithAWarning) {
  const ReadSdf got = read(write("floor.vdb", {dense([](const Vec3d& p) { return p.z + 0.03; }, 0)}));
  EXPECT_NEAR(sample(got.sdf, {0, 0, 0.1}), 0.13, 1e-3);
  EXPECT_NEAR(sample(got.sdf, {0.2, 0, -0.4}), -0.37, 1e-3);
  EXPECT_GT(sample(got.sdf, {3, 0, -0.4}), 0.1);
  EXPECT_THAT(got.warnings, ElementsAre(HasSubstr("dense distances"), HasSubstr("it is closed there")));
}

TEST(LevelSets, WithABandOverZerosGetTheirSignsBack) {
  auto grid = FloatGrid::create(0.0f);
  grid->setName("band");
  grid->setTransform(openvdb::math::Transform::createLinearTransform(0.1));
  const auto whole = sphere("whole");
  for (auto value = whole->cbeginValueOn(); value; ++value) grid->tree().setValue(value.getCoord(), *value);
  const ReadSdf got = read(write("band.vdb", {grid}));
  expect_ball(got.sdf);
  EXPECT_GT(sample(got.sdf, {2, 0, 0}), 0.1);
  EXPECT_THAT(got.warnings, ElementsAre(HasSubstr("no width of a band")));
}

TEST(LevelSets, AreNotMadeOfFogOrOfDistancesWithoutASign) {
  const auto fog = dense([](const Vec3d& p) { return std::max(0.0, 1 - length(p)); }, 0);
  EXPECT_THAT(refusal(write("fog.vdb", {fog})), HasSubstr("densities of a fog volume"));
  const auto plain = dense([](const Vec3d& p) { return std::abs(length(p) - 1) + 0.001; }, 0.3f);
  EXPECT_THAT(refusal(write("unsigned.vdb", {plain})), HasSubstr("Distances without a sign"));
  const auto inside_out = dense([](const Vec3d& p) { return std::clamp(1 - length(p), -0.3, 0.3); }, -0.3f);
  EXPECT_THAT(refusal(write("inside_out.vdb", {inside_out})), HasSubstr("inside out"));
}

TEST(LevelSets, OfHalfAndDoublePrecisionAreRead) {
  auto half = sphere("half");
  half->setSaveFloatAsHalf(true);
  expect_ball(read(write("half.vdb", {half})).sdf);
  auto wide = std::make_shared<openvdb::DoubleGrid>(*sphere("wide"));
  EXPECT_THAT(read(write("wide.vdb", {wide})).warnings, IsEmpty());
  expect_ball(read(at("wide.vdb")).sdf);
}

TEST(LevelSets, WithAnImmenseBackgroundAreRead) {
  expect_ball(read(write("immense.vdb", {dense([](const Vec3d& p) { return length(p) - 1; }, 1e10f)})).sdf);
}

TEST(LevelSets, KeepTheirPlaceWhereVoxelsHaveLargeNumbers) {
  const auto near = sphere("near");
  for (const int corner : {1 << 13, (1 << 20) + 8, (1 << 24) - 40, 1 << 24, -(1 << 26) + 8}) {
    auto far = FloatGrid::create(near->background());
    far->setGridClass(openvdb::GRID_LEVEL_SET);
    const Coord offset(corner, -corner, corner);
    for (auto leaf = near->tree().cbeginLeaf(); leaf; ++leaf) {
      auto copy = std::make_unique<openvdb::FloatTree::LeafNodeType>(*leaf);
      copy->setOrigin(leaf->origin() + offset);
      far->tree().addLeaf(copy.release());
    }
    far->setTransform(openvdb::math::Transform::createLinearTransform(0.1));
    far->transform().postTranslate(offset.asVec3d() * -0.1);
    write("large_numbers.vdb", {far});
    // OpenVDB's files keep a scale to 1e-9 beside a large translation: the ball stands where the file says, which is not quite where it was put.
    openvdb::io::File file(at("large_numbers.vdb"));
    file.open();
    const openvdb::Vec3d stands = file.readGrid(far->getName())->transform().indexToWorld(offset.asVec3d());
    file.close();
    const Vec3d centre{stands.x(), stands.y(), stands.z()};
    const Sdf sdf = read(at("large_numbers.vdb")).sdf;
    expect_ball(sdf, 1, centre, 0.012);
    EXPECT_NEAR(sample(sdf, centre + Vec3d{1, 0, 0}), sample(read(write("near.vdb", {near})).sdf, {1, 0, 0}), 1e-4) << corner;
  }
}

TEST(LevelSets, OfANewerFormatAreReadWithoutAWordOfOpenVDBs) {
  std::string bytes = knead::read_whole_file(write("newer.vdb", {sphere("tool")}));
  put<uint32_t>(bytes, 8, 225);
  knead::write_whole_file(at("newer.vdb"), bytes);
  testing::internal::CaptureStderr();
  const ReadSdf got = read(at("newer.vdb"));
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
  expect_ball(got.sdf);
  EXPECT_THAT(got.warnings, ElementsAre(HasSubstr("the file's format is 225")));
}

// A file of NanoVDB's as Knead writes it, taken apart: head, directory, name, grid.
constexpr size_t kEntry = 16, kEntrySize = 176, kGridHead = 672 + 64;

struct NanoFile {
  std::string head, grid;
  explicit NanoFile(double radius = 1) {
    const Sdf sdf = read(write("plain.vdb", {sphere("tool", radius)})).sdf;
    knead::write_sdf(at("plain.nvdb"), sdf, "tool");
    const std::string bytes = knead::read_whole_file(at("plain.nvdb"));
    const size_t grid_begin = kEntry + kEntrySize + 5;
    head = bytes.substr(0, grid_begin);
    grid = bytes.substr(grid_begin);
  }
  static uint32_t crc(const std::string& bytes, size_t begin, size_t size) {
    return static_cast<uint32_t>(crc32(0, reinterpret_cast<const Bytef*>(bytes.data()) + begin, static_cast<uInt>(size)));
  }
  // As 32.7 and later sign: the head, and the rest in blocks of 4096 bytes, of which the last takes what is left.
  void make_version(uint32_t minor) {
    const uint32_t version = 32u << 21 | minor << 10 | 1;
    head.replace(0, 8, "NanoVDB2");
    put(head, 8, version);
    put(head, kEntry + kEntrySize - 4, version);
    grid.replace(0, 8, "NanoVDB1");
    put(grid, 16, version);
    std::string sums;
    const size_t tail = grid.size() - kGridHead, blocks = tail / 4096;
    for (size_t n = 0; n < blocks; ++n) {
      const size_t size = n + 1 == blocks ? tail - n * 4096 : 4096;
      const uint32_t sum = crc(grid, kGridHead + n * 4096, size);
      sums.append(reinterpret_cast<const char*>(&sum), 4);
    }
    put(grid, 8, crc(grid, 16, kGridHead - 16));
    put(grid, 12, crc(sums, 0, sums.size()));
  }
  std::string path(const std::string& name) const {
    knead::write_whole_file(at(name), head + grid);
    return at(name);
  }
};

TEST(LevelSets, OfEveryNanoVDB32AreRead) {
  NanoFile file;
  EXPECT_THAT(read(file.path("32_4.nvdb")).warnings, IsEmpty());
  for (const uint32_t minor : {7u, 9u}) {
    file.make_version(minor);
    const ReadSdf got = read(file.path("newer.nvdb"));
    expect_ball(got.sdf);
    EXPECT_THAT(got.warnings, IsEmpty());
  }
  file.grid.replace(8, 8, std::string(8, '\xff'));  // not signed
  expect_ball(read(file.path("bare_signature.nvdb")).sdf);
  knead::write_whole_file(at("bare.nvdb"), file.grid);  // without a directory
  expect_ball(read(at("bare.nvdb"), "tool").sdf);
}

TEST(LevelSets, OfNanoVDBWithABadByteAreRefused) {
  NanoFile file(0.5);
  file.make_version(9);
  for (const size_t where : {size_t{40}, size_t{700}, kGridHead + 3, file.grid.size() - 900}) {
    NanoFile damaged = file;
    damaged.grid[where] = static_cast<char>(damaged.grid[where] ^ 1);
    EXPECT_THAT(refusal(damaged.path("damaged.nvdb")), HasSubstr("damaged")) << where;
  }
  file.grid.replace(8, 8, std::string(8, '\xff'));  // without a checksum, structure alone can tell
  for (size_t where = kGridHead - 64; where < file.grid.size(); where += where < kGridHead + 200 ? 8 : 200'003) {
    NanoFile damaged = file;
    put<uint32_t>(damaged.grid, where, 0x7fff1234);
    (void)refusal(damaged.path("damaged.nvdb"));  // may be read, may not crash
  }
}

TEST(LevelSets, OfOtherNanoVDBsAreRefusedByTheirVersion) {
  NanoFile file;
  put<uint32_t>(file.head, 8, 31u << 21 | 2u << 10);
  EXPECT_THAT(refusal(file.path("old.nvdb")), HasSubstr("NanoVDB 31.2.0"));
}

TEST(LevelSets, OfNanoVDBMayStandBesideUnknownTypes) {
  NanoFile odd(0.5), file;
  odd.make_version(9);
  file.make_version(9);
  put<uint32_t>(odd.grid, 636, 25);
  const std::string bytes = odd.head + odd.grid + file.head + file.grid;
  knead::write_whole_file(at("beside.nvdb"), bytes);
  const ReadSdf got = read(at("beside.nvdb"));
  expect_ball(got.sdf);
  EXPECT_THAT(got.warnings, ElementsAre(HasSubstr("type that is unknown here (number 25 of NanoVDB 32.9.1)")));
}

TEST(LevelSets, OfNanoVDBMayBePacked) {
  const NanoFile plain;
  for (const uint16_t codec : {uint16_t{1}, uint16_t{2}}) {
    NanoFile file = plain;
    std::string packed(plain.grid.size() + 4096, '\0');
    uint64_t size = 0;
    if (codec == 1) {
      uLongf bound = packed.size();
      ASSERT_EQ(compress(reinterpret_cast<Bytef*>(packed.data()), &bound, reinterpret_cast<const Bytef*>(plain.grid.data()), plain.grid.size()),
                Z_OK);
      size = bound;
    } else {
      size = static_cast<uint64_t>(blosc_compress_ctx(9, 1, 4, plain.grid.size(), plain.grid.data(), packed.data(), packed.size(), "lz4", 0, 1));
    }
    put(file.head, 14, codec);
    put<uint64_t>(file.head, kEntry + 8, size + 8);
    put(file.head, kEntry + kEntrySize - 8, codec);
    file.grid = std::string(reinterpret_cast<const char*>(&size), 8) + packed.substr(0, size);
    expect_ball(read(file.path("packed.nvdb")).sdf);
    file.grid[200] = static_cast<char>(file.grid[200] ^ 64);
    EXPECT_NE(refusal(file.path("packed.nvdb")), "") << codec;
    file.grid.resize(300);
    EXPECT_NE(refusal(file.path("packed.nvdb")), "") << codec;
  }
}

TEST(LevelSets, OfTheSharedCasesAreRead) {
  const std::string cases = shared_data() + "/../cases/";
  if (!std::filesystem::exists(cases)) GTEST_SKIP() << "shared data is absent";
  expect_ball(read(cases + "nvdb_of_openvdb_13/a.nvdb").sdf, 0.5, {1, 1, 1.85}, 0.06);
  EXPECT_THAT(read(cases + "vdb_dense_sdf_background_0/a.vdb").warnings,
              ElementsAre(HasSubstr("dense distances with background 0, taken as a level set")));
  EXPECT_THAT(read(cases + "vdb_foreign_grid_beside/a.vdb").warnings, ElementsAre(HasSubstr("stepped over")));
  EXPECT_THAT(read(cases + "vdb_two_level_sets/a.vdb").warnings,
              ElementsAre(HasSubstr("the file holds 2 level sets, 'small' and 'tool'; 'small' is taken")));
}

}  // namespace level_sets_test
