#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>

#include "direct_run.h"
#include "io/files.h"

namespace knead {
void register_read_mesh(Registry&);
}

namespace knead::read_mesh_test {
namespace {

namespace fs = std::filesystem;

const char* const kOpenPyramid = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";
const char* const kSoup = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 4 5 6\n";

class ReadMeshNode : public ::testing::Test {
 protected:
  ReadMeshNode()
      : folder_(fs::temp_directory_path() /
                ("knead_read_mesh_" + std::to_string(::getpid()) + ::testing::UnitTest::GetInstance()->current_test_info()->name())) {
    fs::create_directories(folder_);
  }
  ~ReadMeshNode() override { fs::remove_all(folder_); }
  std::string at(const std::string& name) const { return (folder_ / name).string(); }
  static direct::DirectRun node(const std::string& path, bool weld = false) {
    return direct::DirectRun(register_read_mesh, "read_mesh", {{"path", path}, {"weld", weld}});
  }
  static Key key(const Node& node, int frame) {
    Hasher hasher;
    node.add_to_key(hasher, frame);
    return hasher.key();
  }
  fs::path folder_;
};

TEST_F(ReadMeshNode, ReadsTheFrameThatTheNameAsksFor) {
  write_whole_file(at("m.0007.obj"), kOpenPyramid);
  write_whole_file(at("m.0008.obj"), kSoup);
  direct::DirectRun run = node(at("m.####.obj"));
  EXPECT_TRUE(run.node().depends_on_frame());
  EXPECT_EQ(run.at(7).result<Surface>().vertices(), 4u);
  EXPECT_EQ(run.at(8).result<Surface>().vertices(), 6u);
  EXPECT_NE(key(run.node(), 7), key(run.node(), 8));
  EXPECT_THROW(run.at(9), Error);
  EXPECT_THROW(key(run.node(), 9), Error);
}

TEST_F(ReadMeshNode, TheKeyFollowsTheFilesContent) {
  write_whole_file(at("m.obj"), kOpenPyramid);
  direct::DirectRun run = node(at("m.obj"));
  EXPECT_FALSE(run.node().depends_on_frame());
  const Key before = key(run.node(), 1);
  EXPECT_EQ(before, key(run.node(), 2));
  write_whole_file(at("m.obj"), kSoup);
  EXPECT_NE(before, key(run.node(), 1));
}

TEST_F(ReadMeshNode, WarnsOfWhatItFoundAndNamesTheFile) {
  write_whole_file(at("m.obj"), kOpenPyramid);
  direct::DirectRun run = node(at("m.obj"));
  run.at(1);
  ASSERT_EQ(run.warnings.size(), 1u);
  EXPECT_THAT(run.warnings[0], ::testing::AllOf(::testing::HasSubstr(at("m.obj")), ::testing::HasSubstr("open: 3 boundary edges")));
}

TEST_F(ReadMeshNode, WeldsOnRequest) {
  write_whole_file(at("m.obj"), kSoup);
  EXPECT_EQ(node(at("m.obj")).at(1).result<Surface>().vertices(), 6u);
  EXPECT_EQ(node(at("m.obj"), true).at(1).result<Surface>().vertices(), 4u);
}

TEST_F(ReadMeshNode, RefusesPathsThatNameNoMesh) {
  EXPECT_THROW(node(""), Error);
  EXPECT_THROW(node("m.blend"), Error);
}

}  // namespace
}  // namespace knead::read_mesh_test
