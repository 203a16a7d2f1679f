// What README.md says is what the program does.
#include "tests/app/program.h"
#include "tests/paths.h"

namespace program_test {

class Readme : public Program {
 protected:
  // The text between two marks, the first of which is the line's end.
  static std::string between(const std::string& text, const std::string& first, const std::string& last) {
    const size_t from = text.find(first);
    if (from == std::string::npos) return {};
    const size_t start = text.find('\n', from + first.size()) + 1, end = text.find(last, start);
    return end == std::string::npos ? std::string() : text.substr(start, end - start);
  }
  const std::string text_ = text_of(source_dir() + "/README.md");
};

TEST_F(Readme, HasAGraphThatRunsAsItStands) {
  const std::string graph = between(text_, "```yaml\nknead: 1", "```");
  ASSERT_NE(graph, "");
  put("press.yaml", "knead: 1\n" + graph);
  make_inputs();
  const Ended ended =
      knead({"run", "press.yaml", "--frames", "24", "--set", "press.max_iterations=5", "--set", "solid.resolution=16", "--set", "press.max_depth=4"});
  EXPECT_EQ(ended.status, 0) << ended.err;
  EXPECT_THAT(ended.err, AllOf(HasSubstr("not at rest after 5 iterations"), Not(HasSubstr("inside")))) << "cut short, and nothing else";
  EXPECT_TRUE(fs::exists(folder_ / "out/head.0024.obj"));
  EXPECT_GT(figure(stats().back(), "displacement_max"), 0);
}

TEST_F(Readme, ShowsTheMessageThatAMistakeGives) {
  std::string lines = "knead: 1\n" + between(text_, "```yaml\nknead: 1", "```");
  const size_t at = lines.find(", sdf: solid}");
  ASSERT_NE(at, std::string::npos);
  put("press.yaml", lines.insert(at + 12, ", hodl: 20"));
  const Ended ended = knead({"check", "press.yaml"});
  EXPECT_EQ(ended.status, 1);
  ASSERT_NE(ended.err, "");
  EXPECT_THAT(text_, HasSubstr("```\n" + ended.err + "```")) << "README.md shows another message";
}

}  // namespace program_test
