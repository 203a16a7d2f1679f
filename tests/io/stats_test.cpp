#include "io/stats.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
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
  static std::string line(int frame, const std::string& key = "k", const std::string& graph = "g.yaml", const std::vector<std::string>& files = {}) {
    FrameResult result;
    result.frame = frame;
    FrameRecord made;
    made.graph = graph;
    made.key = key;
    for (const std::string& file : files) made.files.push_back({file, 1, "f"});
    return stats_line(result, {}, made);
  }
  std::vector<std::string> keys_in_file() const {
    std::vector<std::string> keys;
    std::ifstream in(path_);
    for (std::string line; std::getline(in, line);) keys.push_back(Json::parse(line).at("key"));
    return keys;
  }

  std::filesystem::path folder_;
  std::string path_;
};

Value report_value(std::initializer_list<std::pair<const char*, double>> entries) {
  Report report;
  for (const auto& [name, value] : entries) report.set(name, value);
  return Value::of(std::move(report));
}

TEST_F(Stats, PutsFiguresTimesAndWarningsByNode) {
  FrameResult result;
  result.frame = 12;
  result.seconds = 0.25;
  Report report;
  report.set("iterations", 118);
  report.set("ended", "at rest");
  report.set("volume_error", -0.0021);
  result.values["press.report"] = Value::of(std::move(report));
  result.times = {{"tets", 0, true, 1.5}, {"press", 0.2, false}};
  result.warnings = {"node 'body': open surface", "node 'press': odd"};
  FrameRecord made;
  made.graph = "press.yaml";
  made.key = "abc";
  made.files = {{"out/a.obj", 17, "ff"}};
  const std::vector<StatsNode> nodes{{"body", "read_mesh", ""}, {"tets", "build_tets", ""}, {"press", "equilibrium", "press.report"}};
  const Json json = Json::parse(stats_line(result, nodes, made));
  EXPECT_EQ(json["version"], 1);
  EXPECT_EQ(json["frame"], 12);
  EXPECT_EQ(json["ok"], true);
  EXPECT_EQ(json["graph"], "press.yaml");
  EXPECT_EQ(json["seconds"], 0.25);
  EXPECT_EQ(json["key"], "abc");
  EXPECT_FALSE(json.contains("error"));
  const Json& press = json["nodes"]["press"];
  EXPECT_EQ(press["type"], "equilibrium");
  EXPECT_EQ(press["seconds"], 0.2);
  EXPECT_EQ(press["cached"], false);
  EXPECT_EQ(press["report"], Json({{"iterations", 118}, {"ended", "at rest"}, {"volume_error", -0.0021}}));
  EXPECT_TRUE(press["report"]["iterations"].is_number_integer());
  EXPECT_EQ(press["warnings"], Json({"odd"}));
  EXPECT_EQ(json["nodes"]["tets"], Json({{"type", "build_tets"}, {"seconds", 0}, {"cached", true}, {"set_up_seconds", 1.5}}));
  EXPECT_EQ(json["nodes"]["body"], Json({{"type", "read_mesh"}, {"seconds", 0}, {"cached", true}, {"warnings", {"open surface"}}}))
      << "a node at which the frame did not look stands there too";
}

TEST_F(Stats, SaysWhyAFrameFailed) {
  FrameResult result;
  result.error = Error(ErrorCode::kFile, Where{"a.obj", 3, 0, {}, {}}, "index out of range");
  const Json json = Json::parse(stats_line(result, {{"read", "read_mesh", ""}}, {}));
  EXPECT_EQ(json["ok"], false);
  EXPECT_EQ(json["error"], "a.obj:3: index out of range");
  EXPECT_EQ(json["error_kind"], "file");
  EXPECT_FALSE(json.contains("key"));
  EXPECT_THAT(json["nodes"], testing::IsEmpty()) << "what did not run is not said to be there";
}

TEST_F(Stats, WritesNullForWhatIsNoNumber) {
  FrameResult result;
  result.seconds = NAN;
  result.values["m.report"] = report_value({{"a", NAN}, {"b", INFINITY}, {"c", 1e300}});
  const std::string line = stats_line(result, {{"m", "measure", "m.report"}}, {});
  const Json report = Json::parse(line)["nodes"]["m"]["report"];
  EXPECT_TRUE(report["a"].is_null());
  EXPECT_TRUE(report["b"].is_null());
  EXPECT_EQ(report["c"], 1e300);
}

TEST_F(Stats, ReadsTheFiguresOfALine) {
  FrameResult result;
  result.values["m.report"] = report_value({{"a", 2}, {"b", NAN}});
  result.warnings = {"node 'm': odd"};
  const std::vector<NodeFigures> nodes = read_node_figures(stats_line(result, {{"m", "measure", "m.report"}}, {}));
  ASSERT_EQ(nodes.size(), 1u);
  EXPECT_EQ(nodes[0].type, "measure");
  EXPECT_EQ(nodes[0].report.number("a"), 2);
  EXPECT_TRUE(std::isnan(nodes[0].report.number("b")));
  EXPECT_THAT(nodes[0].warnings, ElementsAre("odd"));
  EXPECT_TRUE(read_node_figures("{\"frame\": 1").empty());
}

TEST_F(Stats, SurvivesTextsThatAreNotUtf8) {
  FrameResult result;
  result.warnings = {"\xff\xfe broken"};
  EXPECT_NO_THROW(Json::parse(stats_line(result, {}, {})));
}

TEST_F(Stats, ReadsBackWhatItWrote) {
  FrameResult result;
  result.frame = -7;
  FrameRecord record, made;
  made.graph = "g.yaml";
  made.only = {"save"};
  made.key = "abc";
  made.files = {{"out/a b.obj", 17, "ff"}};
  ASSERT_TRUE(read_stats_line(stats_line(result, {}, made), record));
  EXPECT_EQ(record.version, 1);
  EXPECT_EQ(record.graph, "g.yaml");
  EXPECT_THAT(record.only, ElementsAre("save"));
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
  StatsFile stats(path_);
  stats.add(line(2));
  stats.add(line(1));
  EXPECT_THAT(frames_in_file(), ElementsAre(2, 1));
}

TEST_F(Stats, OrdersLinesByFrameInTheEnd) {
  StatsFile stats(path_);
  for (const int frame : {10, 2, -1}) stats.add(line(frame));
  stats.finish();
  EXPECT_THAT(frames_in_file(), ElementsAre(-1, 2, 10));
}

TEST_F(Stats, KeepsEarlierLinesAndReplacesThoseMadeAgain) {
  {
    StatsFile first(path_);
    for (const int frame : {1, 2, 3}) first.add(line(frame, "old"));
    first.finish();
  }
  StatsFile second(path_);
  ASSERT_EQ(second.earlier(2).size(), 1u);
  EXPECT_EQ(second.earlier(2)[0].key, "old");
  EXPECT_TRUE(second.earlier(4).empty());
  second.add(line(2, "new"));
  second.finish();
  EXPECT_THAT(frames_in_file(), ElementsAre(1, 2, 3));
  EXPECT_THAT(keys_in_file(), ElementsAre("old", "new", "old"));
}

TEST_F(Stats, KeepsTheLinesOfAnotherGraphUntilAllItsFilesAreWrittenAgain) {
  StatsFile stats(path_);
  stats.add(line(1, "a", "a.yaml", {"a.obj"}));
  stats.add(line(1, "b", "b.yaml", {"b.obj"}));
  stats.add(line(1, "none", "c.yaml"));
  stats.finish();
  EXPECT_THAT(keys_in_file(), ElementsAre("a", "b", "none"));
  stats.add(line(1, "both", "../a.yaml", {"b.obj", "a.obj"}));
  stats.finish();
  EXPECT_THAT(keys_in_file(), ElementsAre("none", "both"));
  EXPECT_EQ(StatsFile(path_).earlier(1).size(), 2u);
}

TEST_F(Stats, ReplacesLinesFromBeforeTheyHadAVersionAndBuildsOnNone) {
  std::ofstream(path_) << R"({"frame": 1, "ok": true, "key": "k", "files": []})" << '\n' << R"({"frame": 2, "ok": true, "key": "k"})" << '\n';
  StatsFile stats(path_);
  EXPECT_TRUE(stats.earlier(1).empty());
  stats.add(line(1, "new"));
  stats.finish();
  EXPECT_THAT(keys_in_file(), ElementsAre("new", "k"));
}

TEST_F(Stats, LosesNothingOfWhatOthersWriteMeanwhile) {
  StatsFile mine(path_), other(path_);
  mine.add(line(1));
  other.add(line(7));
  mine.finish();  // the file is another one from here on
  other.add(line(8));
  mine.add(line(2));
  other.finish();
  mine.add(line(3));
  EXPECT_THAT(frames_in_file(), ElementsAre(1, 2, 7, 8, 3));
}

TEST_F(Stats, LosesNothingWhenManyProcessesWriteAtOnce) {
  constexpr int kProcesses = 6, kLines = 20;
  std::vector<pid_t> children;
  for (int p = 0; p < kProcesses; ++p) {
    const pid_t child = ::fork();
    if (child == 0) {
      for (int i = 0; i < kLines; i += 10) {
        StatsFile stats(path_);
        for (int k = 0; k < 10; ++k) stats.add(line(p * kLines + i + k, std::string(5000, 'x')));
        stats.finish();
      }
      ::_exit(0);
    }
    children.push_back(child);
  }
  for (const pid_t child : children) {
    int status = -1;
    ::waitpid(child, &status, 0);
    EXPECT_EQ(status, 0);
  }
  StatsFile(path_).finish();
  const std::vector<int> frames = frames_in_file();
  ASSERT_EQ(frames.size(), static_cast<size_t>(kProcesses * kLines));
  for (size_t i = 0; i < frames.size(); ++i) EXPECT_EQ(frames[i], static_cast<int>(i));
}

TEST_F(Stats, GoesOnAfterALineThatACrashCutShort) {
  std::ofstream(path_) << line(1) << '\n' << line(2).substr(0, 9);
  StatsFile stats(path_);
  stats.add(line(3));
  EXPECT_EQ(StatsFile(path_).earlier(3).size(), 1u) << "before finish";
  stats.finish();
  EXPECT_THAT(frames_in_file(), ElementsAre(1, 3));
}

TEST_F(Stats, MakesItsFolder) {
  const std::string deep = (folder_ / "a/b/stats.jsonl").string();
  StatsFile(deep).add(line(1));
  EXPECT_TRUE(std::filesystem::exists(deep));
}

TEST_F(Stats, NamesAFileThatCannotBeWritten) {
  EXPECT_THROW(StatsFile("/proc/nowhere/stats.jsonl"), Error);
  if (!std::filesystem::exists("/dev/full")) GTEST_SKIP() << "no /dev/full here";
  StatsFile full("/dev/full");
  EXPECT_THROW(full.add(line(1)), Error);
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
