// What a run says of itself: its lines of figures, its closing words, its exit status, whoever else writes to the same folder.
#include <signal.h>

#include <chrono>
#include <regex>
#include <thread>

#include "tests/app/program.h"
#include "tests/json_schema.h"

namespace program_test {

const char* const kShot = R"(knead: 1
frames: 1-3
nodes:
  body: {type: primitive, shape: sphere, radius: 1, resolution: 3}
  ball: {type: primitive, shape: sphere, radius: 0.4, resolution: 3}
  motion: {type: transform, mesh: ball, keys: {1: {translate: [0, 3, 0]}, 3: {translate: [0, 1.2, 0]}}}
  solid: {type: mesh_to_sdf, mesh: motion, resolution: 24}
  press: {type: deform_equilibrium, surface: body, sdf: solid, max_depth: 3}
  result: {type: write_mesh, surface: press, path: out/r.####.obj}
)";

const char* const kBall = R"(knead: 1
frames: 1-12
nodes:
  ball: {type: primitive, shape: sphere, resolution: 2}
  move: {type: transform, mesh: ball, keys: {1: {translate: [0, 0, 0]}, 12: {translate: [0, 0, 3]}}}
  save: {type: write_mesh, surface: move, path: ball.####.obj}
)";

class Figures : public Program {
 protected:
  void SetUp() override {
    Program::SetUp();
    put("press.yaml", kShot);
    put("ball.yaml", kBall);
  }
  Ended press(std::vector<std::string> more) const {
    more.insert(more.begin(), {"run", "press.yaml"});
    return knead(more);
  }
  std::vector<int> frames_told(const std::string& path = "stats.jsonl") const {
    std::vector<int> frames;
    for (const auto& line : stats(path)) frames.push_back(line.at("frame"));
    return frames;
  }
};

TEST_F(Figures, StandByNodeWhateverElseTheGraphHolds) {
  ASSERT_EQ(press({"-q", "--frames", "3"}).status, 0);
  const auto alone = stats().at(0).at("nodes");
  for (const char* node : {"body", "ball", "motion", "solid", "press.tets", "press.press", "press.exact", "press.figures", "result"})
    EXPECT_TRUE(alone.contains(node)) << node;
  EXPECT_EQ(alone.at("press.press").at("type"), "equilibrium");
  put("press.yaml", std::string(kShot) +
                        "  more: {type: measure, surface: press, rest: body, sdf: solid}\n  other: {type: deform, surface: body, sdf: "
                        "solid, max_depth: 3}\n");
  ASSERT_EQ(press({"-q", "--frames", "3"}).status, 0);
  const auto beside = stats().at(0).at("nodes");
  EXPECT_EQ(beside.at("press.press").at("report").at("iterations"), alone.at("press.press").at("report").at("iterations"));
  EXPECT_EQ(beside.at("press.figures").at("report").at("volume_error"), alone.at("press.figures").at("report").at("volume_error"));
  EXPECT_TRUE(beside.contains("other.press.collide") || beside.contains("other.press"))
      << "nodes inside a loop stand under its name: " << beside.dump(2);
  const auto schema = nlohmann::json::parse(knead({"nodes", "--stats-schema"}).out);
  EXPECT_EQ(json_schema::errors_of(schema, stats().at(0)), "");
}

TEST_F(Figures, CloseWithWhatDidNotGoWell) {
  Ended ended = press({"--set", "press.max_iterations=2"});
  EXPECT_EQ(ended.status, 0);
  EXPECT_THAT(ended.out, HasSubstr("1 frame did not come to rest (3)"));
  ended = press({"--set", "press.max_iterations=2", "-q"});
  EXPECT_EQ(ended.status, 0);
  EXPECT_EQ(ended.out, "");
  EXPECT_THAT(ended.err, AllOf(HasSubstr("of 3 frames"), HasSubstr("1 frame did not come to rest (3)")));
  EXPECT_EQ(press({"-q"}).err, "");
}

TEST_F(Figures, AreHeldAgainstLimits) {
  EXPECT_EQ(press({"--strict"}).status, 0);
  Ended ended = press({"--strict", "--set", "press.max_iterations=2", "-q"});
  EXPECT_EQ(ended.status, 4);
  EXPECT_THAT(ended.err, HasSubstr("frame 3: node 'press.press' did not come to rest"));
  EXPECT_EQ(press({"--strict", "penetration=1e-3,rest"}).status, 0);
  ended = press({"--strict", "displacement_max=1e-3"});
  EXPECT_EQ(ended.status, 4);
  EXPECT_THAT(ended.err, AllOf(HasSubstr("displacement_max is "), HasSubstr("beyond the limit of 0.001")));
  ended = press({"--strict=press.press.iterations=1000,penetratoin=1"});
  EXPECT_EQ(ended.status, 4) << "what was never held against anything did not pass";
  EXPECT_THAT(ended.err, HasSubstr("no node tells a figure 'penetratoin'"));
  EXPECT_EQ(press({"--strict=rset"}).status, 3);
  EXPECT_EQ(press({"--strict", "penetration=much"}).status, 3);
  EXPECT_EQ(knead({"run", "--strict", "press.yaml", "-q"}).status, 0) << "alone before the graph";
}

TEST_F(Figures, OfFramesThatAreSkippedAreJudgedToo) {
  ASSERT_EQ(press({"--set", "press.max_iterations=2"}).status, 0);
  const Ended ended = press({"--set", "press.max_iterations=2", "--resume", "--strict"});
  EXPECT_EQ(ended.status, 4);
  EXPECT_THAT(ended.out, AllOf(HasSubstr("3 skipped"), HasSubstr("1 frame did not come to rest (3)")));
}

TEST_F(Figures, NeverGuessThatNothingWasTouchedWhereFramesFailed) {
  put("in.1.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n");
  put("far.yaml", R"(knead: 1
frames: 1-2
nodes:
  body: {type: primitive, shape: sphere, radius: 1, resolution: 2}
  read: {type: read_mesh, path: in.#.obj}
  motion: {type: transform, mesh: read, translate: [0, 50, 0]}
  solid: {type: mesh_to_sdf, mesh: motion, resolution: 16}
  press: {type: deform, surface: body, sdf: solid, max_depth: 3}
  result: {type: write_mesh, surface: press, path: out/r.####.obj}
)");
  Ended ended = knead({"run", "far.yaml"});
  EXPECT_EQ(ended.status, 2);
  EXPECT_THAT(ended.out, AllOf(HasSubstr("1 frame failed (2)"), Not(HasSubstr("nothing touched"))));
  ended = knead({"run", "far.yaml", "--frames", "1"});
  EXPECT_EQ(ended.status, 0) << ended.err;
  EXPECT_THAT(ended.out, HasSubstr("nothing touched"));
}

TEST_F(Figures, NeverGuessThatNothingWasTouchedWhereNothingIsThatCould) {
  put("plain.yaml",
      "knead: 1\nnodes:\n  body: {type: primitive, shape: sphere, resolution: 2}\n  m: {type: measure, surface: body, rest: body}\n"
      "  out: {type: write_mesh, surface: body, path: out.obj}\n");
  const Ended ended = knead({"run", "plain.yaml"});
  EXPECT_EQ(ended.status, 0) << ended.err;
  EXPECT_THAT(ended.out, AllOf(Not(HasSubstr("nothing touched")), Not(HasSubstr("no contact"))));
}

TEST_F(Figures, NeverGuessThatNothingWasTouchedInABodyThatHoldsItsCollider) {
  for (const char* type : {"deform", "deform_equilibrium"}) {
    const Ended ended =
        press({"--frames", "1", "--set", std::string("press.max_depth=3"), "--set", "motion.keys={1: {translate: [0, 0, 0], scale: 0.5}}"});
    EXPECT_EQ(ended.status, 0) << ended.err;
    EXPECT_THAT(ended.out, Not(HasSubstr("nothing touched"))) << type;
    put("press.yaml", std::regex_replace(std::string(kShot), std::regex("deform_equilibrium"), "deform"));
  }
}

TEST_F(Figures, SayWhereTheTimeWent) {
  const auto started = std::chrono::steady_clock::now();
  const Ended ended = press({});
  const double wall = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
  std::smatch parts;
  ASSERT_TRUE(std::regex_search(ended.out, parts,
                                std::regex("time: ([0-9.]+) s = ([0-9.]+) reading \\+ ([0-9.]+) set-up \\+ ([0-9.]+) frames \\+ ([0-9.]+) closing")))
      << ended.out;
  const double total = std::stod(parts[1]), sum = std::stod(parts[2]) + std::stod(parts[3]) + std::stod(parts[4]) + std::stod(parts[5]);
  EXPECT_NEAR(sum, total, 0.021) << "rounded to hundredths";
  EXPECT_LE(total, wall + 0.01);
  EXPECT_GE(total, 0.95 * wall - 0.1) << "of which a tenth of a second is the test's own, on a machine that does other things";
  EXPECT_THAT(ended.out, AllOf(HasSubstr("set-up by node: "), HasSubstr("press.tets"), HasSubstr("frames by node: "), HasSubstr("press.press")));
  for (const auto& line : stats()) {
    EXPECT_TRUE(line.at("nodes").at("press.tets").at("cached"));
    for (const char* node : {"press.tets", "press.press"}) EXPECT_GT(line.at("nodes").at(node).at("set_up_seconds"), 0) << node;
  }
}

TEST_F(Figures, OfOneFrameHoldAllItsTime) {
  ASSERT_EQ(press({"--frames", "3", "-q"}).status, 0);
  const auto line = stats().at(0);
  double most = 0;
  for (const auto& [name, node] : line.at("nodes").items()) {
    EXPECT_EQ(node.at("cached"), false) << name;
    most = std::max(most, node.at("seconds").get<double>());
  }
  EXPECT_GE(line.at("seconds"), most);
}

TEST_F(Figures, OfOtherFramesStay) {
  ASSERT_EQ(knead({"run", "ball.yaml", "-q"}).status, 0);
  ASSERT_EQ(knead({"run", "ball.yaml", "-q", "--frames", "4"}).status, 0);
  EXPECT_EQ(frames_told().size(), 12u);
  EXPECT_THAT(knead({"run", "ball.yaml", "--resume"}).out, HasSubstr("12 skipped"));
}

TEST_F(Figures, OfProcessesWithOneFolderAreAllKept) {
  for (int round = 0; round < 3; ++round) {
    fs::remove_all(folder_ / "o");
    std::vector<pid_t> children;
    for (const char* frames : {"1-3", "4-6", "7-9", "10-12"})
      children.push_back(start({"run", "ball.yaml", "-q", "--out", "o", "--frames", frames, "--threads", "1"}));
    for (const pid_t child : children) EXPECT_EQ(wait_for(child).status, 0);
    EXPECT_THAT(frames_told("o/stats.jsonl"), ElementsAre(1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12));
    EXPECT_EQ(files_in("o").size(), 13u) << "nothing beside the meshes and their figures";
    EXPECT_THAT(knead({"run", "ball.yaml", "--out", "o", "--resume"}).out, AllOf(HasSubstr("0 frames in"), HasSubstr("12 skipped")));
  }
}

TEST_F(Figures, OfTwoGraphsInOneFolderAreAllKept) {
  put("other.yaml", std::regex_replace(std::string(kBall), std::regex("ball\\.####"), "other.####"));
  const pid_t one = start({"run", "ball.yaml", "-q"}), other = start({"run", "other.yaml", "-q"});
  EXPECT_EQ(wait_for(one).status, 0);
  EXPECT_EQ(wait_for(other).status, 0);
  EXPECT_EQ(stats().size(), 24u);
  for (const char* graph : {"ball.yaml", "other.yaml"}) EXPECT_THAT(knead({"run", graph, "--resume"}).out, HasSubstr("12 skipped")) << graph;
}

TEST_F(Figures, OfSomeWritersAloneSayWhich) {
  put("two.yaml", std::string(kShot) + "  rest: {type: write_mesh, surface: body, path: out/rest.obj}\n");
  Ended ended = knead({"run", "two.yaml", "--only", "rest", "--frames", "1"});
  EXPECT_EQ(ended.status, 0) << ended.err;
  EXPECT_THAT(files_in("out"), ElementsAre("rest.obj"));
  EXPECT_THAT(ended.out, AllOf(HasSubstr("evaluated: primitive 1, write_mesh 1"))) << "nothing is pressed for it";
  EXPECT_EQ(stats().at(0).at("only"), nlohmann::json({"rest"}));
  ended = knead({"run", "two.yaml", "--only", "resul"});
  EXPECT_EQ(ended.status, 1);
  EXPECT_THAT(ended.err, HasSubstr("node 'resul': no node of this name writes anything (did you mean 'result'?)"));
  for (const std::vector<std::string>& both : {std::vector<std::string>{"--only", "result", "--only", "rest"}, {"--only", "rest,result"}}) {
    std::vector<std::string> words{"run", "two.yaml", "--frames", "3", "-q"};
    words.insert(words.end(), both.begin(), both.end());
    ASSERT_EQ(knead(words).status, 0);
  }
  EXPECT_TRUE(fs::exists(folder_ / "out/r.0003.obj"));
  EXPECT_TRUE(stats().back().at("nodes").contains("press.figures")) << "what looks at the same result tells its figures";
}

TEST_F(Figures, AreWholeWhenASignalEndsANodeThatDoesNotListen) {
  put("slow.yaml", R"(knead: 1
frames: 1-2
nodes:
  ball: {type: primitive, shape: sphere, radius: 1, resolution: 6}
  first: {type: write_mesh, surface: ball, path: first.##.ply}
  solid: {type: mesh_to_sdf, mesh: ball, resolution: 700, memory_limit: 100000}
  save: {type: write_vdb, sdf: solid, path: solid.vdb}
)");
  const pid_t child = start({"run", "slow.yaml"});
  std::this_thread::sleep_for(std::chrono::milliseconds(500));
  ::kill(child, SIGTERM);
  const Ended ended = wait_for(child);
  EXPECT_EQ(ended.status, 130) << ended.err;
  EXPECT_THAT(ended.err, HasSubstr("interrupted: 0 of 2 frames are complete"));
  for (const auto& entry : fs::directory_iterator(folder_)) EXPECT_THAT(entry.path().filename().string(), Not(HasSubstr(".part")));
  EXPECT_FALSE(fs::exists(folder_ / "solid.vdb"));
}

TEST_F(Figures, OfNamesWithAHashThatIsNoFrame) {
  const Ended ended = knead({"run", "ball.yaml", "-q", "--frames", "2", "--set", R"(save.path=take\#1.##.obj)"});
  EXPECT_EQ(ended.status, 0) << ended.err;
  EXPECT_TRUE(fs::exists(folder_ / "take#1.02.obj"));
  EXPECT_EQ(stats().at(0).at("files").at(0).at("path"), "take#1.02.obj");
}

TEST_F(Figures, CheckTellsWhereEverythingLies) {
  Ended ended = knead({"check", "press.yaml"});
  EXPECT_EQ(ended.status, 0) << ended.err;
  EXPECT_THAT(ended.out,
              AllOf(HasSubstr("body: mesh of 642 vertices, 1280 faces, 1 piece\n  (-1, -1, -1) to (1, 1, 1), diagonal 3.464"),
                    HasSubstr("  frame 1: (-0.4, 2.6, -0.4) to (0.4, 3.4, 0.4)"), HasSubstr("  frame 3: (-0.4, 0.8, -0.4) to (0.4, 1.6, 0.4)"),
                    HasSubstr("solid: field of "), HasSubstr("solid can reach body at frame 3\n")));
  EXPECT_THAT(knead({"graph", "press.yaml"}).out, HasSubstr("solid can reach body at frame 3\n"));
  ended = knead({"check", "press.yaml", "--set", "motion.keys={1: {translate: [0, 50, 0]}}"});
  EXPECT_THAT(ended.out, HasSubstr("solid can reach body at no frame: 48.6 apart at frame 1"));
}

}  // namespace program_test
