// What the examples leave in stats.jsonl is what `knead nodes --stats-schema` says.
#include "tests/app/program.h"
#include "tests/json_schema.h"

namespace program_test {

class ExampleLines : public Program {
 protected:
  // The lines of an example's run.
  std::vector<nlohmann::json> lines_of(const std::string& file, const std::string& frames) {
    const Ended ended = knead({"run", source_dir() + "/examples/" + file, "--frames", frames, "-q"});
    EXPECT_EQ(ended.status, 0) << ended.err;
    return stats();
  }
  void expect_as_told(const std::vector<nlohmann::json>& lines) {
    const auto schema = nlohmann::json::parse(knead({"nodes", "--stats-schema"}).out);
    EXPECT_FALSE(lines.empty());
    for (const nlohmann::json& line : lines) EXPECT_EQ(json_schema::errors_of(schema, line), "") << line.dump(2);
  }
};

TEST_F(ExampleLines, HeadKeepsItsFiguresByNode) {
  const auto lines = lines_of("head/head.yaml", "1,24");
  expect_as_told(lines);
  ASSERT_EQ(lines.size(), 2u);
  for (const char* node : {"soft.figures", "stiff.figures"}) {
    EXPECT_TRUE(lines[0].at("nodes").at(node).at("report").contains("iterations")) << node;
    EXPECT_GT(lines[1].at("nodes").at(node).at("report").at("displacement_max"), 0) << node;
  }
}

TEST_F(ExampleLines, CrushIsAsTheSchemaSays) {
  expect_as_told(lines_of("crush/crush.yaml", "6"));
}

TEST_F(ExampleLines, CascadeIsAsTheSchemaSays) {
  expect_as_told(lines_of("crush/cascade.yaml", "6"));
}

TEST_F(ExampleLines, SdfPipelineIsAsTheSchemaSays) {
  expect_as_told(lines_of("sdf_pipeline/sdf_pipeline.yaml", "1,24"));
}

TEST_F(ExampleLines, TheTestSeesWhatIsWrong) {
  const auto schema = nlohmann::json::parse(knead({"nodes", "--stats-schema"}).out);
  const auto good = nlohmann::json::parse(
      R"({"version": 1, "frame": 1, "ok": true, "seconds": 0, "files": [],
          "nodes": {"a": {"type": "t", "seconds": 0, "cached": true, "report": {"x": null}}}})");
  EXPECT_EQ(json_schema::errors_of(schema, good), "");
  for (const auto& [place, value] : std::vector<std::pair<std::string, nlohmann::json>>{{"/version", 2},
                                                                                        {"/frame", 1.5},
                                                                                        {"/ok", "yes"},
                                                                                        {"/seconds", -1},
                                                                                        {"/error_kind", "odd"},
                                                                                        {"/iterations", 3},
                                                                                        {"/nodes/a/seconds", nullptr},
                                                                                        {"/nodes/a/report/x", true},
                                                                                        {"/nodes/a/more", 1},
                                                                                        {"/files/0", {{"path", "p"}}}}) {
    nlohmann::json bad = good;
    bad[nlohmann::json::json_pointer(place)] = value;
    EXPECT_NE(json_schema::errors_of(schema, bad), "") << place;
  }
}

}  // namespace program_test
