#include "io/files.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <filesystem>
#include <fstream>
#include <limits>
#include <string>
#include <thread>
#include <vector>

#include "graph/error.h"

namespace files_test {

namespace fs = std::filesystem;
using knead::Error;
using knead::ErrorCode;
using ::testing::HasSubstr;

// A folder of the test's own, removed at its end.
class FilesTest : public ::testing::Test {
 protected:
  FilesTest()
      : folder_(fs::temp_directory_path() /
                ("knead_files_" + std::to_string(::getpid()) + "_" + ::testing::UnitTest::GetInstance()->current_test_info()->name())) {
    fs::create_directories(folder_);
  }
  ~FilesTest() override {
    std::error_code ignored;
    fs::permissions(folder_, fs::perms::owner_all, ignored);
    fs::remove_all(folder_, ignored);
  }
  std::string at(const std::string& name) const { return (folder_ / name).string(); }
  std::vector<std::string> names() const {
    std::vector<std::string> found;
    for (const auto& entry : fs::directory_iterator(folder_)) found.push_back(entry.path().filename().string());
    return found;
  }
  fs::path folder_;
};

template <class F>
Error error_of(F&& f) {
  try {
    f();
  } catch (const Error& error) {
    return error;
  }
  ADD_FAILURE() << "nothing was thrown";
  return Error(ErrorCode::kInternal, "nothing was thrown");
}

TEST_F(FilesTest, FramePathPadsEachRunOfHashesInTheName) {
  EXPECT_EQ(knead::frame_path("out/head.####.obj", 7), "out/head.0007.obj");
  EXPECT_EQ(knead::frame_path("head.#.obj", 7), "head.7.obj");
  EXPECT_EQ(knead::frame_path("head.##.obj", 12345), "head.12345.obj");
  EXPECT_EQ(knead::frame_path("head.####.obj", -7), "head.-0007.obj");
  EXPECT_EQ(knead::frame_path("####", 0), "0000");
  EXPECT_EQ(knead::frame_path("a_##_###.ply", 5), "a_05_005.ply");
  EXPECT_EQ(knead::frame_path("plain.obj", 3), "plain.obj");
  EXPECT_EQ(knead::frame_path("##.obj", std::numeric_limits<int>::min()), "-2147483648.obj");
}

TEST_F(FilesTest, FramePathLeavesFoldersAlone) {
  EXPECT_FALSE(knead::has_frame_pattern("C#/head.obj"));
  EXPECT_TRUE(knead::has_frame_pattern("C#/head.#.obj"));
  EXPECT_EQ(knead::frame_path("C#/head.##.obj", 4), "C#/head.04.obj");
  EXPECT_EQ(knead::frame_path("C#/head.obj", 4), "C#/head.obj");
  EXPECT_EQ(knead::frame_path("take\\#2.##.obj", 7), "take#2.07.obj");
  EXPECT_EQ(knead::frame_path("\\##\\#", 7), "#7#");
  EXPECT_EQ(knead::frame_path("a\\b.obj", 7), "a\\b.obj") << "a backslash is a character like others";
  EXPECT_TRUE(knead::has_frame_pattern("take\\#2.##.obj"));
  EXPECT_FALSE(knead::has_frame_pattern("take\\#2.obj"));
}

TEST_F(FilesTest, ReadsEveryByte) {
  std::string bytes(3000000, '\0');
  for (size_t i = 0; i < bytes.size(); ++i) bytes[i] = static_cast<char>(i * 31 + i / 257);
  knead::write_whole_file(at("data"), bytes);
  EXPECT_TRUE(knead::read_whole_file(at("data")) == bytes);
  knead::write_whole_file(at("empty"), "");
  EXPECT_EQ(knead::read_whole_file(at("empty")), "");
}

TEST_F(FilesTest, MissingFileSuggestsTheNearestName) {
  knead::write_whole_file(at("head.obj"), "x");
  const Error error = error_of([&] { knead::read_whole_file(at("haed.obj")); });
  EXPECT_EQ(error.code(), ErrorCode::kFile);
  EXPECT_EQ(error.where().file, at("haed.obj"));
  EXPECT_THAT(error.hint(), HasSubstr("'head.obj'"));
  EXPECT_THAT(error_of([&] { knead::read_whole_file(at("nowhere/head.obj")); }).message(), HasSubstr("there is no folder"));
}

TEST_F(FilesTest, ReadingAFolderIsAnError) {
  EXPECT_THAT(error_of([&] { knead::read_whole_file(folder_.string()); }).what(), HasSubstr("folder"));
}

TEST_F(FilesTest, UnreadableFileIsAnError) {
  if (::geteuid() == 0) GTEST_SKIP() << "root may read everything";
  knead::write_whole_file(at("secret"), "x");
  ::chmod(at("secret").c_str(), 0);
  EXPECT_THAT(error_of([&] { knead::read_whole_file(at("secret")); }).what(), HasSubstr("permission denied"));
}

TEST_F(FilesTest, ContentKeyFollowsTheContentAndNotTheName) {
  knead::write_whole_file(at("a"), "one");
  knead::write_whole_file(at("b"), "one");
  const knead::Key first = knead::file_content_key(at("a"));
  EXPECT_EQ(first, knead::file_content_key(at("b")));
  EXPECT_EQ(first, knead::file_content_key(at("a")));
  knead::write_whole_file(at("a"), "two");  // same size, and perhaps the same time: another inode
  EXPECT_NE(first, knead::file_content_key(at("a")));
  std::ofstream(at("b")) << "six";  // in place: the same inode
  EXPECT_NE(first, knead::file_content_key(at("b")));
  EXPECT_EQ(error_of([&] { knead::file_content_key(at("c")); }).code(), ErrorCode::kFile);
}

TEST_F(FilesTest, ContentKeyMayBeAskedByManyThreads) {
  for (int i = 0; i < 8; ++i) knead::write_whole_file(at(std::to_string(i)), std::string(1000, static_cast<char>('a' + i)));
  std::vector<knead::Key> expected(8);
  for (size_t i = 0; i < 8; ++i) expected[i] = knead::file_content_key(at(std::to_string(i)));
  std::vector<std::thread> threads;
  std::atomic<int> wrong{0};
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&] {
      for (size_t i = 0; i < 400; ++i) wrong += knead::file_content_key(at(std::to_string(i % 8))) != expected[i % 8];
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(wrong, 0);
}

TEST_F(FilesTest, WholeFileIsInvisibleUntilItIsCommitted) {
  {
    knead::WholeFile file(at("deep/er/result.obj"));
    file.write(std::string(5 << 20, 'x'));
    EXPECT_FALSE(fs::exists(at("deep/er/result.obj")));
    file.commit();
    EXPECT_EQ(fs::file_size(at("deep/er/result.obj")), size_t{5} << 20);
  }
  size_t entries = 0;
  for ([[maybe_unused]] const auto& entry : fs::directory_iterator(at("deep/er"))) ++entries;
  EXPECT_EQ(entries, 1u);
}

TEST_F(FilesTest, WithoutCommitTheOldFileStaysAndNothingElse) {
  knead::write_whole_file(at("result"), "old");
  {
    knead::WholeFile file(at("result"));
    file.write("new and unfinished");
  }
  EXPECT_EQ(knead::read_whole_file(at("result")), "old");
  EXPECT_EQ(names().size(), 1u);
}

TEST_F(FilesTest, ALibraryMayWriteTheTemporaryFileByName) {
  knead::WholeFile file(at("result"));
  file.close();
  std::ofstream(file.temporary_path()) << "by somebody else";
  file.commit();
  EXPECT_EQ(knead::read_whole_file(at("result")), "by somebody else");
}

TEST_F(FilesTest, TheTargetOfALinkIsReplacedAndTheLinkStays) {
  knead::write_whole_file(at("real"), "old");
  fs::create_symlink("real", at("link"));
  knead::write_whole_file(at("link"), "new");
  EXPECT_TRUE(fs::is_symlink(at("link")));
  EXPECT_EQ(knead::read_whole_file(at("real")), "new");
}

TEST_F(FilesTest, AFullDiskIsAnError) {
  if (!fs::exists("/dev/full")) GTEST_SKIP() << "no /dev/full";
  const Error error = error_of([] { knead::write_whole_file("/dev/full", "some bytes"); });
  EXPECT_EQ(error.code(), ErrorCode::kFile);
  EXPECT_EQ(error.where().file, "/dev/full");
  EXPECT_THAT(error.what(), HasSubstr("no space left"));
}

TEST_F(FilesTest, UnwritablePlacesAreErrorsThatNameThePath) {
  knead::write_whole_file(at("file"), "x");
  for (const std::string& path :
       {at("file/below"), at("a/") + std::string(300, 'n'), folder_.string(), at("folder/"), std::string("/proc/knead/result.obj")}) {
    const Error error = error_of([&] { knead::write_whole_file(path, "x"); });
    EXPECT_EQ(error.code(), ErrorCode::kFile);
    EXPECT_EQ(error.where().file, path);
  }
  EXPECT_EQ(error_of([&] { knead::write_whole_file("", "x"); }).code(), ErrorCode::kFile);
  if (::geteuid() != 0) {
    ::chmod(folder_.c_str(), 0500);
    EXPECT_THAT(error_of([&] { knead::write_whole_file(at("new"), "x"); }).what(), HasSubstr("permission denied"));
    ::chmod(folder_.c_str(), 0700);
  }
}

}  // namespace files_test
