#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>

#include "direct_run.h"
#include "io/files.h"
#include "io/mesh/mesh_io.h"

namespace knead {
void register_write_mesh(Registry&);
}

namespace knead::write_mesh_test {
namespace {

namespace fs = std::filesystem;

class WriteMeshNode : public ::testing::Test {
 protected:
  WriteMeshNode()
      : folder_(fs::temp_directory_path() /
                ("knead_write_mesh_" + std::to_string(::getpid()) + ::testing::UnitTest::GetInstance()->current_test_info()->name())) {}
  ~WriteMeshNode() override { fs::remove_all(folder_); }
  std::string at(const std::string& name) const { return (folder_ / name).string(); }
  static Surface pyramid() {
    std::vector<std::string> warnings;
    return parse_surface("g all\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0.1 0.3 1\nf 1 2 4\nf 2 3 4\nf 3 1 4\nf 1 3 2\n", "m.obj", {}, warnings);
  }
  fs::path folder_;
};

TEST_F(WriteMeshNode, WritesEachFrameUnderItsNumber) {
  direct::DirectRun run(register_write_mesh, "write_mesh", {{"path", at("out/m.###.obj")}});
  EXPECT_TRUE(run.node().has_effect());
  EXPECT_TRUE(run.node().depends_on_frame());
  run.give("surface", pyramid()).at(3).at(-4);
  EXPECT_EQ(read_whole_file(at("out/m.003.obj")), read_whole_file(at("out/m.-004.obj")));
  EXPECT_TRUE(run.warnings.empty());
}

TEST_F(WriteMeshNode, SaysWhatTheFormatLeavesOut) {
  direct::DirectRun run(register_write_mesh, "write_mesh", {{"path", at("m.ply")}, {"ascii", true}});
  run.give("surface", pyramid()).at(1);
  ASSERT_EQ(run.warnings.size(), 1u);
  EXPECT_THAT(run.warnings[0], ::testing::HasSubstr("no place for groups"));
  EXPECT_THAT(read_whole_file(at("m.ply")), ::testing::HasSubstr("format ascii"));
}

TEST_F(WriteMeshNode, PrecisionShortensNumbers) {
  direct::DirectRun run(register_write_mesh, "write_mesh", {{"path", at("m.obj")}, {"precision", 1}});
  run.give("surface", pyramid()).at(1);
  EXPECT_THAT(read_whole_file(at("m.obj")), ::testing::HasSubstr("v 0.1 0.3 1\n"));
}

TEST_F(WriteMeshNode, RefusesPathsThatCannotBeWritten) {
  EXPECT_THROW(direct::DirectRun(register_write_mesh, "write_mesh", {{"path", ""}}), Error);
  EXPECT_THROW(direct::DirectRun(register_write_mesh, "write_mesh", {{"path", "m.off"}}), Error);
  fs::create_directories(folder_);
  write_whole_file(at("file"), "x");
  direct::DirectRun run(register_write_mesh, "write_mesh", {{"path", at("file/m.obj")}});
  run.give("surface", pyramid());
  EXPECT_THROW(run.at(1), Error);
}

}  // namespace
}  // namespace knead::write_mesh_test
