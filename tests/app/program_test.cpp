// The program as its users meet it: as a process, by its exit status, what it prints and the files it leaves.
#include "tests/app/program.h"

#include <signal.h>

#include <chrono>
#include <map>
#include <thread>

namespace program_test {

// Four frames of a small ball that moves.
const char* const kMoving = R"(knead: 1
frames: 1-4
nodes:
  ball: {type: primitive, shape: sphere, resolution: 1}
  move: {type: transform, mesh: ball, keys: {1: {translate: [0, 0, 0]}, 4: {translate: [0, 0, 3]}}}
  save: {type: write_mesh, surface: move, path: out/ball.####.obj}
)";

// Frame 2 of the sequence is not there.
class Gap : public Program {
 protected:
  fs::path graph() const {
    for (const int frame : {1, 3}) put("in." + std::to_string(frame) + ".obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    return put(
        "gap.yaml",
        "knead: 1\nframes: 1-3\nnodes:\n  read: {type: read_mesh, path: in.#.obj}\n  save: {type: write_mesh, surface: read, path: o.#.obj}\n");
  }
};

TEST_F(Program, MakesEveryFrameAndALineAboutEach) {
  const Ended ended = knead({"run", put("g.yaml", kMoving)});
  EXPECT_EQ(ended.status, 0) << ended.err;
  EXPECT_EQ(ended.err, "");
  EXPECT_THAT(files_in("out"), ElementsAre("ball.0001.obj", "ball.0002.obj", "ball.0003.obj", "ball.0004.obj"));
  const auto lines = stats();
  ASSERT_EQ(lines.size(), 4u);
  for (int i = 0; i < 4; ++i) {
    EXPECT_EQ(lines[i].at("frame"), i + 1);
    EXPECT_EQ(lines[i].at("ok"), true);
    EXPECT_EQ(lines[i].at("nodes").at("save").at("cached"), false);
  }
  EXPECT_THAT(ended.out, AllOf(HasSubstr("frame 3: "), HasSubstr("frames/s"), HasSubstr("stats.jsonl")));
}

TEST_F(Program, PutsRelativeOutputsUnderOut) {
  EXPECT_EQ(knead({"run", put("g.yaml", kMoving), "--out", "deep/er", "--frames", "2,4"}).status, 0);
  EXPECT_THAT(files_in("deep/er/out"), ElementsAre("ball.0002.obj", "ball.0004.obj"));
  EXPECT_EQ(stats("deep/er/stats.jsonl").size(), 2u);
  EXPECT_EQ(knead({"run", "g.yaml", "--out", "x", "--frames=1", "--set", "save.path=y.obj", "--stats", "s/figures.jsonl"}).status, 0);
  EXPECT_TRUE(fs::exists(folder_ / "x/y.obj"));
  EXPECT_EQ(stats("s/figures.jsonl").size(), 1u);
}

TEST_F(Program, ReadsRelativeInputsFromTheGraphsFolder) {
  fs::create_directories(folder_ / "scene");
  put("scene/m.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
  put("scene/g.json",
      R"({"knead": 1, "nodes": {"a": {"type": "read_mesh", "path": "m.obj"}, "b": {"type": "write_mesh", "surface": "a", "path": "copy.obj"}}})");
  const Ended ended = knead({"run", "scene/g.json"});
  EXPECT_EQ(ended.status, 0) << ended.err;
  EXPECT_TRUE(fs::exists(folder_ / "copy.obj"));
}

TEST_F(Program, GivesTheSameBytesOnEveryExecutor) {
  put("g.yaml", kMoving);
  for (const std::vector<std::string>& device :
       {std::vector<std::string>{"--device", "serial"}, {"--device", "cpu", "--threads", "1"}, {"--threads", "3"}})
    ASSERT_EQ(knead([&] {
                std::vector<std::string> words{"run", "g.yaml", "-q", "--out", device.back()};
                words.insert(words.end(), device.begin(), device.end());
                return words;
              }())
                  .status,
              0);
  for (const char* file : {"out/ball.0001.obj", "out/ball.0003.obj"}) {
    EXPECT_EQ(text_of(folder_ / "serial" / file), text_of(folder_ / "1" / file));
    EXPECT_EQ(text_of(folder_ / "serial" / file), text_of(folder_ / "3" / file));
    EXPECT_NE(text_of(folder_ / "serial" / file), "");
  }
}

TEST_F(Program, IsSilentWhenQuiet) {
  const Ended ended = knead({"run", put("g.yaml", kMoving), "--quiet"});
  EXPECT_EQ(ended.out + ended.err, "");
}

TEST_F(Program, NamesAllErrorsOfAGraphWithTheirPlaces) {
  put("bad.yaml",
      "knead: 1\nnodes:\n  a: {type: primitiv}\n  b: {type: primitive, shape: cubee, radius: -1, sise: 2}\n  c: {type: write_mesh, surface: d, path: "
      "x.obj}\n");
  for (const char* command : {"check", "run", "graph"}) {
    const Ended ended = knead({command, "bad.yaml"});
    EXPECT_EQ(ended.status, 1);
    EXPECT_THAT(ended.err, AllOf(HasSubstr("bad.yaml:3:3, node 'a': unknown node type 'primitiv' (did you mean 'primitive'?)"),
                                 HasSubstr("bad.yaml:4:31"), HasSubstr("bad.yaml:4:46"), HasSubstr("bad.yaml:4:50"), HasSubstr("bad.yaml:5:34")))
        << command;
    EXPECT_EQ(std::count(ended.err.begin(), ended.err.end(), '\n'), 5) << ended.err;
  }
  EXPECT_FALSE(fs::exists(folder_ / "stats.jsonl")) << "nothing is written for a wrong graph";
}

TEST_F(Program, EndsWithOneForWhatIsNoGraph) {
  for (const char* text : {"", "nodes: {", "[1]", "knead: 1\nnodes: {a: 1}", "knead: 7\nnodes: {}"}) {
    const Ended ended = knead({"check", put("bad.yaml", text)});
    EXPECT_EQ(ended.status, 1) << text;
    EXPECT_THAT(ended.err, HasSubstr("bad.yaml:")) << text;
  }
  EXPECT_EQ(knead({"check", "missing.yaml"}).status, 1);
  EXPECT_EQ(knead({"run", folder_.string()}).status, 1);
  EXPECT_EQ(knead({"check", program_path()}).status, 1);
}

TEST_F(Program, PraisesAGoodGraphAndWarnsOfUnusedNodes) {
  Ended ended = knead({"check", put("g.yaml", kMoving)});
  EXPECT_EQ(ended.status, 0);
  EXPECT_THAT(ended.out, HasSubstr("no errors, 0 warnings"));
  ended = knead({"check", put("h.yaml", std::string(kMoving) + "  idle: {type: primitive}\n")});
  EXPECT_EQ(ended.status, 0);
  EXPECT_THAT(ended.out, HasSubstr("h.yaml:7:3, node 'idle': nothing uses what this node makes"));
}

TEST_F(Program, EndsWithThreeForUsage) {
  put("g.yaml", kMoving);
  const std::vector<std::vector<std::string>> wrong = {{},
                                                       {"fly"},
                                                       {"run"},
                                                       {"run", "g.yaml", "--bogus"},
                                                       {"run", "g.yaml", "--device", "tpu"},
                                                       {"run", "g.yaml", "--frames", "x"},
                                                       {"run", "g.yaml", "--frames", "5-1"},
                                                       {"run", "g.yaml", "--set", "ball"},
                                                       {"run", "g.yaml", "--set", "ball=1"},
                                                       {"run", "g.yaml", "--set", "ball.radius={"},
                                                       {"run", "g.yaml", "--threads", "many"},
                                                       {"nodes", "primitiv"}};
  for (const auto& words : wrong) {
    const Ended ended = knead(words);
    EXPECT_EQ(ended.status, 3) << testing::PrintToString(words) << ended.out << ended.err;
    EXPECT_NE(ended.err, "") << testing::PrintToString(words);
  }
  EXPECT_FALSE(fs::exists(folder_ / "out"));
}

TEST_F(Program, ADeviceThatIsNotThereIsAnErrorThatSaysWhatIsMissing) {
  if (!cuda_devices().devices.empty()) GTEST_SKIP() << "this machine has a CUDA device";
  const Ended ended = knead({"run", put("g.yaml", kMoving), "--device", "cuda"});
  EXPECT_EQ(ended.status, 3);
  EXPECT_THAT(ended.err, HasSubstr("--device cuda is not here: " + cuda_devices().missing + "; there are cpu, serial"));
  EXPECT_THAT(knead({"info"}).out, HasSubstr(cuda_devices().missing));
  EXPECT_THAT(knead({"run", put("g.yaml", kMoving), "--frames", "1"}).out, HasSubstr("on cpu"));
}

TEST_F(Program, SetsParametersFromTheCommandLine) {
  put("g.yaml", kMoving);
  ASSERT_EQ(knead({"run", "g.yaml", "--frames", "1", "--set", "ball.shape=box", "--set", "ball.size=[4, 4, 4]", "-q"}).status, 0);
  EXPECT_THAT(text_of(folder_ / "out/ball.0001.obj"), HasSubstr("v -2 -2 -2"));
  const Ended ended = knead({"run", "g.yaml", "--set", "ball.shap=box"});
  EXPECT_EQ(ended.status, 1);
  EXPECT_THAT(ended.err, HasSubstr("did you mean 'ball.shape'?"));
}

TEST_F(Gap, FailsOneFrameAndMakesTheOthers) {
  const Ended ended = knead({"run", graph()});
  EXPECT_EQ(ended.status, 2);
  EXPECT_THAT(ended.err, AllOf(HasSubstr("frame 2"), HasSubstr("in.2.obj"), HasSubstr("node 'read'")));
  EXPECT_TRUE(fs::exists(folder_ / "o.1.obj"));
  EXPECT_FALSE(fs::exists(folder_ / "o.2.obj"));
  EXPECT_TRUE(fs::exists(folder_ / "o.3.obj"));
  const auto lines = stats();
  ASSERT_EQ(lines.size(), 3u);
  EXPECT_EQ(lines[1].at("ok"), false);
  EXPECT_THAT(lines[1].at("error").get<std::string>(), HasSubstr("in.2.obj"));
}

TEST_F(Gap, ResumesWithTheFrameThatFailed) {
  const fs::path file = graph();
  ASSERT_EQ(knead({"run", file}).status, 2);
  fs::copy_file(folder_ / "in.1.obj", folder_ / "in.2.obj");
  const Ended ended = knead({"run", file, "--resume"});
  EXPECT_EQ(ended.status, 0) << ended.err;
  EXPECT_THAT(ended.out, AllOf(HasSubstr("1 frame in"), HasSubstr("2 skipped")));
  EXPECT_EQ(stats().size(), 3u);
  EXPECT_EQ(stats()[1].at("ok"), true);
}

TEST_F(Program, ResumesOnlyWhatIsCompleteAndMadeFromTheSameInputs) {
  const fs::path graph = put("g.yaml", kMoving);
  const auto skipped = [&](std::vector<std::string> more) {
    std::vector<std::string> words{"run", graph, "--resume"};
    words.insert(words.end(), more.begin(), more.end());
    const Ended ended = knead(words);
    EXPECT_EQ(ended.status, 0) << ended.err;
    const size_t at = ended.out.find(" skipped");
    return at == std::string::npos ? 0 : std::stoi(ended.out.substr(ended.out.rfind(' ', at - 1)));
  };
  EXPECT_EQ(skipped({}), 0);
  EXPECT_EQ(skipped({}), 4);
  EXPECT_EQ(skipped({"--frames", "2-3"}), 2);
  EXPECT_EQ(stats().size(), 4u) << "the lines of frames that were not asked for stay";
  fs::remove(folder_ / "out/ball.0002.obj");
  EXPECT_EQ(skipped({}), 3);
  put("out/ball.0003.obj", "v 1 2 3\n");
  EXPECT_EQ(skipped({}), 3);
  EXPECT_EQ(skipped({"--set", "ball.radius=2"}), 0);
  EXPECT_EQ(skipped({"--set", "ball.radius=2"}), 4);
  put("stats.jsonl", "{\"frame\": 1, \"ok\": true, ");
  EXPECT_EQ(skipped({}), 0);
}

TEST_F(Program, EndsCleanlyWhenInterrupted) {
  std::string text = kMoving;
  text.replace(text.find("1-4"), 3, "1-100000");
  for (const int signal : {SIGINT, SIGTERM}) {
    const pid_t child = start({"run", put("g.yaml", text), "--stats", "s.jsonl"});
    for (int i = 0; i < 2000 && (!fs::exists(folder_ / "out") || files_in("out").size() < 3); ++i)
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    ::kill(child, signal);
    const Ended ended = wait_for(child);
    EXPECT_EQ(ended.status, 130) << ended.err;
    EXPECT_THAT(ended.err, HasSubstr("--resume"));
    const std::vector<std::string> files = files_in("out");
    const size_t lines = stats("s.jsonl").size();
    EXPECT_GE(lines, 1u);
    EXPECT_LT(lines, 100000u);
    // A file for every line, and nothing half written; a file of the last moment may lack its line, and is made again by --resume.
    EXPECT_GE(files.size(), lines);
    EXPECT_LE(files.size(), lines + 16);
    for (const std::string& file : files) EXPECT_TRUE(file.starts_with("ball.") && file.ends_with(".obj")) << file;
    fs::remove_all(folder_ / "out");
    fs::remove(folder_ / "s.jsonl");
  }
}

// Minutes of work, which the first tenths of a second do not bring to an end. 0.2 s are promised on a machine that does nothing else.
TEST_F(Program, EndsALongNodeSoonWhenTerminated) {
  put("g.yaml",
      "knead: 1\nnodes:\n  ball: {type: primitive, shape: blob, resolution: 60}\n  field: {type: mesh_to_sdf, mesh: ball, resolution: 1500, "
      "memory_limit: 60000}\n"
      "  out: {type: write_vdb, sdf: field, path: out.vdb}\n");
  const pid_t child = start({"run", "g.yaml"});
  std::this_thread::sleep_for(std::chrono::milliseconds(600));
  const auto asked = std::chrono::steady_clock::now();
  ::kill(child, SIGTERM);
  const Ended ended = wait_for(child);
  EXPECT_LT(std::chrono::duration<double>(std::chrono::steady_clock::now() - asked).count(), 2);
  EXPECT_EQ(ended.status, 130) << ended.err;
  EXPECT_THAT(ended.err, HasSubstr("0 of 1 frames are complete"));
  EXPECT_THAT(files_in("."), Not(testing::Contains("out.vdb")));
}

TEST_F(Program, SaysThatADiskIsFull) {
  if (!fs::exists("/dev/full")) GTEST_SKIP() << "no /dev/full here";
  put("g.yaml", kMoving);
  const Ended ended = knead({"run", "g.yaml", "--stats", "/dev/full"});
  EXPECT_EQ(ended.status, 2);
  EXPECT_THAT(ended.err, HasSubstr("/dev/full"));
  EXPECT_EQ(files_in("out").size(), 4u) << "the frames themselves are made";
  EXPECT_EQ(wait_for(start({"nodes"}, "/dev/full")).status, 2);
}

TEST_F(Program, FailsFramesThatCannotBeWritten) {
  put("g.yaml", kMoving);
  put("file", "not a folder");
  Ended ended = knead({"run", "g.yaml", "--set", "save.path=file/x.####.obj"});
  EXPECT_EQ(ended.status, 2);
  EXPECT_THAT(ended.err, HasSubstr("file/x.0001.obj"));
  EXPECT_EQ(stats().size(), 4u);
  ended = knead({"run", "g.yaml", "--out", "file/below"});
  EXPECT_EQ(ended.status, 2);
  EXPECT_THAT(ended.err, HasSubstr("file/below"));
}

TEST_F(Program, WarnsOfAGraphThatWritesNothing) {
  const Ended ended = knead({"run", put("g.yaml", "knead: 1\nnodes:\n  a: {type: primitive}\n")});
  EXPECT_EQ(ended.status, 0);
  EXPECT_THAT(ended.err, HasSubstr("writes nothing"));
  EXPECT_THAT(ended.out, HasSubstr("primitive 1"));
}

TEST_F(Program, MakesContactSheets) {
  const Ended ended = knead({"run", put("g.yaml", R"(knead: 1
frames: 1-3
nodes:
  ball: {type: primitive, shape: sphere, resolution: 1}
  move: {type: transform, mesh: ball, keys: {1: {translate: [0, 0, 0]}, 3: {translate: [0, 0, 1]}}}
  save: {type: write_picture, surface: move, path: out/p.####.png, width: 32, height: 24, samples: 1}
)"),
                             "--sheet"});
  EXPECT_EQ(ended.status, 0) << ended.err;
  EXPECT_TRUE(fs::exists(folder_ / "out/p_sheet.png"));
  EXPECT_THAT(ended.out, HasSubstr("p_sheet.png"));
}

TEST_F(Program, ShowsGraphs) {
  put("g.yaml", kMoving);
  Ended ended = knead({"graph", "g.yaml"});
  EXPECT_EQ(ended.status, 0);
  EXPECT_THAT(ended.out, AllOf(HasSubstr("ball (primitive)"), HasSubstr("surface <- move.surface")));
  ended = knead({"graph", "g.yaml", "--dot"});
  EXPECT_THAT(ended.out, AllOf(HasSubstr("digraph"), HasSubstr("\"move\" -> \"save\"")));
}

TEST_F(Program, ShowsTheManual) {
  EXPECT_THAT(knead({"nodes"}).out, AllOf(HasSubstr("primitive "), HasSubstr("iterate ")));
  EXPECT_THAT(knead({"nodes", "primitive"}).out, AllOf(HasSubstr("Parameters"), HasSubstr("radius")));
  EXPECT_TRUE(nlohmann::json::parse(knead({"nodes", "--schema"}).out).contains("definitions"));
  EXPECT_THAT(knead({"nodes", "--markdown"}).out, HasSubstr("| [`primitive`](#primitive) |"));
  EXPECT_THAT(knead({"nodes", "primitiv"}).err, HasSubstr("did you mean 'primitive'?"));
}

TEST_F(Program, TellsWhatItIs) {
  const Ended ended = knead({"info"});
  EXPECT_EQ(ended.status, 0);
  EXPECT_THAT(ended.out,
              AllOf(HasSubstr("knead 0."), HasSubstr("serial"), HasSubstr("cpu"), HasSubstr("cuda"), HasSubstr("OpenVDB"), HasSubstr("SIMD")));
  EXPECT_EQ(knead({"--version"}).status, 0);
  EXPECT_EQ(knead({"--help"}).status, 0);
  EXPECT_EQ(knead({"run", "--help"}).status, 0);
}

}  // namespace program_test
