#include "io/stats.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "graph/report.h"
#include "io/files.h"

namespace knead {
namespace stats_test {

using Json = nlohmann::json;
using testing::ElementsAre;

class Stats : public testing::Test {
 protected:
  void SetUp() override {
    const testing::TestInfo* test = testing::UnitTest::GetInstance()->current_test_info();
    folder_ = std::filesystem::temp_directory_path() / ("knead_stats_" + std::string(test->name()) + std::to_string(::getpid()));
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directories(folder_);
    path_ = (folder_ / "stats.jsonl").string();
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  std::vector<int> frames_in_file() const {
    std::vector<int> frames;
    std::ifstream in(path_);
    for (std::string line; std::getline(in, line);) frames.push_back(Json::parse(line).at("frame").get<int>());
    return frames;
  }
  static std::string line(int frame, const std::string& key = "k") {
    FrameResult result;
    result.frame = frame;
    return stats_line(result, {}, key, {});
  }

  std::filesystem::path folder_;
  std::string path_;
};

Value report_value(std::initializer_list<std::pair<const char*, double>> entries) {
  Report report;
  for (const auto& [name, value] : entries) report.set(name, value);
  return Value::of(std::move(report));
}

TEST_F(Stats, SaysWhatAFrameCameTo) {
  FrameResult result;
  result.frame = 12;
  result.seconds = 0.25;
  Report report;
  report.set("iterations", 118);
  report.set("ended", "at rest");
  report.set("volume_error", -0.0021);
  result.values["press.report"] = Value::of(std::move(report));
  result.times = {{"press", 0.2, false}, {"tets", 0, true}};
  result.warnings = {"node 'tets': open surface"};
  const Json json = Json::parse(stats_line(result, {{"press.report"}}, "abc", {{"out/a.obj", 17, "ff"}}));
  EXPECT_EQ(json["frame"], 12);
  EXPECT_EQ(json["ok"], true);
  EXPECT_EQ(json["iterations"], 118);
  EXPECT_TRUE(json["iterations"].is_number_integer());
  EXPECT_EQ(json["ended"], "at rest");
  EXPECT_EQ(json["volume_error"], -0.0021);
  EXPECT_EQ(json["times"], Json({{"press", 0.2}})) << "cached nodes took no time";
  EXPECT_EQ(json["warnings"][0], "node 'tets': open surface");
  EXPECT_FALSE(json.contains("error"));
}

TEST_F(Stats, SaysWhyAFrameFailed) {
  FrameResult result;
  result.error = Error(ErrorCode::kFile, Where{"a.obj", 3, 0, {}, {}}, "index out of range");
  const Json json = Json::parse(stats_line(result, {}, "", {}));
  EXPECT_EQ(json["ok"], false);
  EXPECT_EQ(json["error"], "a.obj:3: index out of range");
  EXPECT_EQ(json["error_kind"], "file");
  EXPECT_FALSE(json.contains("key"));
}

TEST_F(Stats, WritesNullForWhatIsNoNumber) {
  FrameResult result;
  result.values["m.report"] = report_value({{"a", NAN}, {"b", INFINITY}, {"c", 1e300}});
  const Json json = Json::parse(stats_line(result, {{"m.report"}}, "", {}));
  EXPECT_TRUE(json["a"].is_null());
  EXPECT_TRUE(json["b"].is_null());
  EXPECT_EQ(json["c"], 1e300);
}

TEST_F(Stats, PrefixesFiguresThatSeveralNodesGive) {
  FrameResult result;
  result.values["left.report"] = report_value({{"iterations", 3}, {"only_left", 1}});
  result.values["right.report"] = report_value({{"iterations", 4}, {"frame", 9}});
  const Json json = Json::parse(stats_line(result, {{"left.report"}, {"right.report"}}, "", {}));
  EXPECT_EQ(json["left.iterations"], 3);
  EXPECT_EQ(json["right.iterations"], 4);
  EXPECT_FALSE(json.contains("iterations"));
  EXPECT_EQ(json["only_left"], 1);
  EXPECT_EQ(json["frame"], 0) << "the line's own names are not to be overwritten";
  EXPECT_EQ(json["right.frame"], 9);
}

TEST_F(Stats, KeepsThePlainNamesOfTheOnlySummary) {
  FrameResult result;
  result.values["loop.report"] = report_value({{"penetration", 3}, {"iterations", 4}});
  result.values["measure.report"] = report_value({{"penetration", 1}});
  result.values["other.report"] = report_value({{"penetration", 2}});
  Json json = Json::parse(stats_line(result, {{"loop.report"}, {"measure.report", true}}, "", {}));
  EXPECT_EQ(json["penetration"], 1);
  EXPECT_EQ(json["loop.penetration"], 3);
  EXPECT_EQ(json["iterations"], 4);
  json = Json::parse(stats_line(result, {{"measure.report", true}, {"other.report", true}}, "", {}));
  EXPECT_FALSE(json.contains("penetration")) << "with two of them neither is plain";
  EXPECT_EQ(json["other.penetration"], 2);
}

TEST_F(Stats, SurvivesTextsThatAreNotUtf8) {
  FrameResult result;
  result.warnings = {"\xff\xfe broken"};
  EXPECT_NO_THROW(Json::parse(stats_line(result, {}, "", {})));
}

TEST_F(Stats, ReadsBackWhatItWrote) {
  FrameResult result;
  result.frame = -7;
  FrameRecord record;
  ASSERT_TRUE(read_stats_line(stats_line(result, {}, "abc", {{"out/a b.obj", 17, "ff"}}), record));
  EXPECT_EQ(record.frame, -7);
  EXPECT_TRUE(record.ok);
  EXPECT_EQ(record.key, "abc");
  ASSERT_EQ(record.files.size(), 1u);
  EXPECT_EQ(record.files[0].path, "out/a b.obj");
  EXPECT_EQ(record.files[0].bytes, 17u);
  EXPECT_EQ(record.files[0].hash, "ff");
}

TEST_F(Stats, TakesNoLineThatIsBrokenOrForeign) {
  FrameRecord record;
  const std::string whole = line(3);
  for (size_t n = 0; n < whole.size(); ++n) EXPECT_FALSE(read_stats_line(whole.substr(0, n), record)) << whole.substr(0, n);
  for (const char* foreign :
       {"", "null", "[1]", "{}", R"({"frame": "1", "ok": true})", R"({"frame": 1, "ok": 1})", R"({"frame": 1, "ok": true, "files": [3]})"})
    EXPECT_FALSE(read_stats_line(foreign, record)) << foreign;
}

TEST_F(Stats, HoldsWholeLinesBeforeItIsFinished) {
  StatsFile stats(path_, false);
  stats.add(2, line(2));
  stats.add(1, line(1));
  EXPECT_THAT(frames_in_file(), ElementsAre(2, 1));
}

TEST_F(Stats, OrdersLinesByFrameInTheEnd) {
  StatsFile stats(path_, false);
  for (const int frame : {10, 2, -1}) stats.add(frame, line(frame));
  stats.finish();
  EXPECT_THAT(frames_in_file(), ElementsAre(-1, 2, 10));
}

TEST_F(Stats, KeepsEarlierLinesAndReplacesThoseMadeAgain) {
  {
    StatsFile first(path_, false);
    for (const int frame : {1, 2, 3}) first.add(frame, line(frame, "old"));
    first.finish();
  }
  StatsFile second(path_, true);
  ASSERT_NE(second.earlier(2), nullptr);
  EXPECT_EQ(second.earlier(2)->key, "old");
  EXPECT_EQ(second.earlier(4), nullptr);
  second.add(2, line(2, "new"));
  second.finish();
  EXPECT_THAT(frames_in_file(), ElementsAre(1, 2, 3));
  EXPECT_EQ(StatsFile(path_, true).earlier(2)->key, "new");
  EXPECT_EQ(StatsFile(path_, true).earlier(3)->key, "old");
}

TEST_F(Stats, BeginsEmptyUnlessToldToKeep) {
  std::ofstream(path_) << line(5) << '\n';
  StatsFile stats(path_, false);
  EXPECT_EQ(stats.earlier(5), nullptr);
  stats.finish();
  EXPECT_THAT(frames_in_file(), ElementsAre());
}

TEST_F(Stats, GoesOnAfterALineThatACrashCutShort) {
  std::ofstream(path_) << line(1) << '\n' << line(2).substr(0, 9);
  StatsFile stats(path_, true);
  stats.add(3, line(3));
  EXPECT_EQ(StatsFile(path_, true).earlier(3)->frame, 3) << "before finish";
  stats.finish();
  EXPECT_THAT(frames_in_file(), ElementsAre(1, 3));
}

TEST_F(Stats, MakesItsFolder) {
  const std::string deep = (folder_ / "a/b/stats.jsonl").string();
  StatsFile(deep, false).add(1, line(1));
  EXPECT_TRUE(std::filesystem::exists(deep));
}

TEST_F(Stats, NamesAFileThatCannotBeWritten) {
  EXPECT_THROW(StatsFile("/proc/nowhere/stats.jsonl", false), Error);
  if (!std::filesystem::exists("/dev/full")) GTEST_SKIP() << "no /dev/full here";
  StatsFile full("/dev/full", false);
  EXPECT_THROW(full.add(1, line(1)), Error);
  EXPECT_NO_THROW(full.finish()) << "a device is not rewritten";
}

TEST_F(Stats, KnowsAWrittenFileByItsContents) {
  const std::string file = (folder_ / "mesh.obj").string();
  write_whole_file(file, "v 0 0 0\n");
  const WrittenFile before = written_file(file);
  EXPECT_EQ(before.bytes, 8u);
  write_whole_file(file, "v 0 0 1\n");
  EXPECT_NE(written_file(file).hash, before.hash);
  EXPECT_THROW(written_file(file + "x"), Error);
}

}  // namespace stats_test
}  // namespace knead
