// Bad input, case by case, as design.md's last section lists it: a clear message that names the place and what to do, the right exit status, nothing
// half written, no crash, and no number in an output that is none.
#include <sys/mount.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include <cmath>
#include <thread>

#include "tests/app/program.h"
#include "tests/bad_meshes.h"
#include "tests/paths.h"

namespace program_test {

// A ball against a body; every file and number of it can be set to something bad.
const char* const kPress = R"(knead: 1
frames: 1-2
nodes:
  body: {type: read_mesh, path: body.obj}
  ball: {type: primitive, shape: sphere, radius: 0.4, resolution: 3}
  motion: {type: transform, mesh: ball, translate: [0, 1.1, 0]}
  solid: {type: mesh_to_sdf, mesh: motion, resolution: 16}
  press: {type: deform, surface: body, sdf: solid, max_depth: 3, max_iterations: 8}
  result: {type: write_mesh, surface: press.surface, path: out/r.####.obj}
)";

class BadInput : public Program {
 protected:
  void SetUp() override {
    Program::SetUp();
    if (IsSkipped()) return;
    put("press.yaml", kPress);
    put("make.yaml",
        "knead: 1\nnodes:\n  a: {type: primitive, shape: sphere, radius: 1, resolution: 3}\n  b: {type: write_mesh, surface: a, path: body.obj}\n");
    ASSERT_EQ(knead({"run", "make.yaml", "-q"}).status, 0);
    fs::remove(folder_ / "stats.jsonl");
  }

  static std::string shared(const std::string& name) { return shared_data() + "/" + name; }

  // Not one frame is made, none is half written, and the message has all that is asked for.
  void fails(const std::vector<std::string>& sets, int status, const std::vector<std::string>& said) const {
    SCOPED_TRACE(testing::PrintToString(sets));
    fs::remove_all(folder_ / "out");
    const Ended ended = run("press.yaml", sets);
    EXPECT_EQ(ended.status, status) << ended.err;
    for (const std::string& text : said) EXPECT_THAT(ended.err, HasSubstr(text));
    EXPECT_TRUE(!fs::exists(folder_ / "out") || files_in("out").empty());
  }

  // All frames are made, of finite numbers, and a warning says what was assumed.
  void warns(const std::vector<std::string>& sets, const std::vector<std::string>& said) const {
    SCOPED_TRACE(testing::PrintToString(sets));
    fs::remove_all(folder_ / "out");
    const Ended ended = run("press.yaml", sets);
    EXPECT_EQ(ended.status, 0) << ended.err;
    for (const std::string& text : said) EXPECT_THAT(ended.err, HasSubstr(text));
    if (said.empty()) EXPECT_EQ(ended.err, "");
    expect_finite();
    const auto lines = stats();
    ASSERT_EQ(lines.size(), 2u);
    for (const auto& line : lines) {
      EXPECT_EQ(line.at("ok"), true);
      if (!said.empty()) EXPECT_FALSE(warnings(line).empty()) << "also beside the figures";
      EXPECT_EQ(line.dump().find("null"), std::string::npos) << "no number: " << line.dump();
    }
  }

  void expect_finite() const {
    ASSERT_THAT(files_in("out"), ElementsAre("r.0001.obj", "r.0002.obj"));
    std::ifstream in(folder_ / "out/r.0001.obj");
    size_t vertices = 0;
    for (std::string word, x, y, z; in >> word;) {
      if (word == "v") {
        in >> x >> y >> z;
        ++vertices;
        for (const std::string& number : {x, y, z}) ASSERT_TRUE(std::isfinite(std::stod(number))) << number;
      }
      in.ignore(100000, '\n');
    }
    EXPECT_GT(vertices, 0u);
  }
};

TEST_F(BadInput, MissingUnreadableAndForeignFiles) {
  fails({"body.path=bodi.obj"}, 2, {"bodi.obj", "no such file", "did you mean 'body.obj'?", "node 'body'"});
  fails({"body.path=nowhere/body.obj"}, 2, {"there is no folder 'nowhere'"});
  fs::create_directories(folder_ / "folder.obj");
  fails({"body.path=folder.obj"}, 2, {"it is a folder"});
  fails({"body.path=body.yaml"}, 1, {"by its ending", ".obj, .ply, .stl or .off"});
  fails({"body.path=''"}, 1, {"no file is named"});
  ASSERT_EQ(::mkfifo((folder_ / "pipe.obj").c_str(), 0600), 0);
  fails({"body.path=pipe.obj"}, 2, {"it is a pipe"});
  put("locked.obj", "v 0 0 0\n");
  fs::permissions(folder_ / "locked.obj", fs::perms::none);
  if (::access((folder_ / "locked.obj").c_str(), R_OK) != 0) fails({"body.path=locked.obj"}, 2, {"permission denied"});
}

TEST_F(BadInput, DamagedFilesOfEveryKind) {
  const std::vector<std::pair<std::string, std::string>> files = {{"truncated_binary.ply", "more than the file holds"},
                                                                  {"truncated_binary.stl", "cut short"},
                                                                  {"index_out_of_range.obj", "vertex 99"},
                                                                  {"index_negative_out_of_range.obj", "vertex -9"},
                                                                  {"index_zero.obj", "OBJ counts from 1"},
                                                                  {"text_garbage.obj", "text_garbage.obj:3"},
                                                                  {"empty.obj", "no vertices"},
                                                                  {"comments_only.obj", "no vertices"},
                                                                  {"zero_faces.obj", "no faces"},
                                                                  {"header_only.ply", "cannot hold them"},
                                                                  {"ply_missing_end_header.ply", "end_header"},
                                                                  {"not_a_mesh.ply", "no PLY file"}};
  bad_meshes::write_all(folder_);
  for (const auto& [name, said] : files) fails({"body.path=malformed/" + name}, 2, {name, "node 'body'", said});
  fails({"body.path=problem/nan_vertex.obj"}, 2, {"no finite number", "vertex 101 (line 103)"});
  fails({"body.path=problem/inf_vertex.obj"}, 2, {"no finite number", "vertex 101 (line 103)"});
}

TEST_F(BadInput, DamagedFilesMadeHere) {
  const auto bad = [&](const std::string& name, const std::string& text, const std::string& said) {
    put(name, text);
    fails({"body.path=" + name}, 2, {name, said});
  };
  bad("empty.obj", "", "no vertices");
  bad("zeros.obj", std::string(3000, '\0'), "zeros.obj");
  bad("range.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "vertex 9");
  bad("huge.obj", "v 0 0 0\nv 1e300 0 0\nv 0 1 0\nf 1 2 3\n", "huge.obj");
  bad("nan.obj", "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "no finite number");
  bad("flat.obj", "v 0 0 0\nv 0 0 0\nv 0 0 0\nf 1 2 3\n", "flat.obj");
  bad("count.ply",
      "ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\nproperty float y\nproperty float z\nend_header\n\1\2",
      "count.ply");
  bad("count.stl", std::string(80, 'x') + "\xff\xff\xff\x7f" + std::string(50, 'y'), "count.stl");
  put("cut.vdb", text_of(folder_ / "body.obj"));
  const Ended ended =
      knead({"run", put("vdb.yaml", "knead: 1\nnodes:\n  a: {type: read_vdb, path: cut.vdb}\n  b: {type: write_vdb, sdf: a, path: o.vdb}\n")});
  EXPECT_EQ(ended.status, 2);
  EXPECT_THAT(ended.err, HasSubstr("cut.vdb"));
  EXPECT_FALSE(fs::exists(folder_ / "o.vdb"));
}

TEST_F(BadInput, BrokenSurfacesDeformWithAWarning) {
  bad_meshes::write_all(folder_);
  if (fs::exists(shared("problem")))
    for (const char* name : bad_meshes::kSharedProblems) fs::copy_file(shared("problem/") + name, folder_ / "problem" / name);
  const auto problem = [&](const std::string& name, const std::vector<std::string>& said) {
    if (!fs::exists(folder_ / "problem" / name)) return;  // beside the checkout
    // The ball goes to the top of the body, wherever and however large that is.
    std::ifstream in(folder_ / "problem" / name);
    double top = -1e300, low = 1e300, x = 0, z = 0;
    for (std::string word; in >> word; in.ignore(100000, '\n'))
      if (double a, b, c; word == "v" && in >> a >> b >> c) {
        low = std::min(low, b);
        if (b > top) top = b, x = a, z = c;
      }
    const double size = top - low;
    const auto text = [](double v) {
      std::ostringstream out;
      out.precision(17);
      out << v;
      return out.str();
    };
    warns({"body.path=problem/" + name, "ball.radius=" + text(0.2 * size),
           "motion.translate=[" + text(x) + ", " + text(top + 0.15 * size) + ", " + text(z) + "]"},
          said);
    EXPECT_GT(figure(stats().at(0), "displacement_max"), 0) << name;
  };
  problem("open_boundary.obj", {"open: " + std::to_string(bad_meshes::boundary_edges(bad_meshes::open_boundary())) + " boundary edges"});
  problem("nonmanifold_edge.obj", {"non-manifold: 7 edges"});
  problem("nonmanifold_vertex.obj", {"non-manifold: 1 vertex"});
  problem("self_intersecting.obj", {"self-intersecting: 168 pairs"});
  problem("duplicate_vertices_soup.obj", {"exactly where another does"});
  problem("degenerate_faces.obj", {"54 faces have no area"});
  problem("multi_component.obj", {"7 separate pieces"});
  problem("inside_out.obj", {"inside-out"});
  problem("mixed_orientation.obj", {"inconsistent orientation"});
  problem("unreferenced_vertices.obj", {"100 vertices belong to no face"});
  problem("offset_1e6.obj", {});
  problem("scale_1e-4.obj", {});
  problem("scale_1e6.obj", {});
  problem("ngons_hex_pent.obj", {});
  problem("ngons_concave_star_prism.obj", {});
}

TEST_F(BadInput, CollidersThatSwallowOrStartInTheBody) {
  warns({"ball.radius=5"}, {"swallow the body"});
  warns({"motion.translate=[0, 0.3, 0]"}, {});
}

TEST_F(BadInput, CollidersThinnerThanAVoxelNameTheVoxelThatWouldDo) {
  std::string text = kPress;
  const std::string ball = "{type: primitive, shape: sphere, radius: 0.4, resolution: 3}";
  text.replace(text.find(ball), ball.size(), "{type: primitive, shape: plate, size: [1, 1, 1], thickness: 0.02}");
  put("press.yaml", text.replace(text.find("[0, 1.1, 0]"), 11, "[0, 0.9, 0]"));
  const std::vector<std::string> said{"node 'solid'", "thinner than two voxels", "a voxel size of ", " would do"};
  warns({}, said);
  std::string warning;
  for (const std::string& each : warnings(stats().at(0)))
    if (each.find("a voxel size of ") != std::string::npos) warning = each;
  const std::string size = warning.substr(warning.rfind("a voxel size of ") + 16);
  const Ended finer = run("press.yaml", {"solid.voxel_size=" + size.substr(0, size.find(' '))});
  EXPECT_EQ(finer.status, 0);
  EXPECT_THAT(finer.err, Not(HasSubstr("voxel")));
  EXPECT_GT(figure(stats().at(0), "displacement_max"), 0.001) << "now it is felt";
}

TEST_F(BadInput, VoxelsThatNeedTooMuchMemory) {
  fails({"solid.voxel_size=1e-6"}, 2, {"node 'solid'", "MiB", "more than the limit of 2048 MiB", "a voxel size of"});
  fails({"solid.voxel_size=1e-30"}, 2, {"node 'solid'", "voxel"});
  fails({"solid.voxel_size=0.004", "solid.memory_limit=1"}, 2, {"more than the limit of 1 MiB", "raise memory_limit"});
}

TEST_F(BadInput, NumbersAndWordsOutOfRange) {
  fails({"press.stiffness=1.5"}, 1, {"'stiffness'", "1.5 is out of range"});
  fails({"press.max_depth=99"}, 1, {"'max_depth'", "out of range"});
  fails({"press.max_iterations=2.5"}, 1, {"'max_iterations'", "integer"});
  fails({"press.hold=high"}, 1, {"'hold'", "number"});
  fails({"press.lattice=barycentrik"}, 1, {"did you mean 'barycentric'?"});
  fails({"solid.voxel_size=.nan"}, 1, {"finite"});
  fails({"solid.voxel_size=-1"}, 1, {"out of range"});
  fails({"motion.scale=0"}, 1, {"'scale'"});
  fails({"motion.translate=[1, 2]"}, 1, {"'translate'"});
  fails({"motion.translate=[1, 2, .inf]"}, 1, {"'translate'"});
}

TEST_F(BadInput, WrongGraphsAreRefusedBeforeAnythingIsMade) {
  const auto wrong = [&](const std::string& nodes, const std::string& said) {
    const Ended ended = knead({"run", put("wrong.yaml", "knead: 1\nnodes:\n" + nodes)});
    EXPECT_EQ(ended.status, 1) << nodes;
    EXPECT_THAT(ended.err, AllOf(HasSubstr("wrong.yaml:"), HasSubstr(said)));
    EXPECT_FALSE(fs::exists(folder_ / "stats.jsonl"));
  };
  wrong("  a: {type: transform, mesh: b}\n  b: {type: transform, mesh: a}\n", "a cycle: a -> b -> a");
  wrong("  a: {type: transform, mesh: a}\n", "a cycle: a -> a");
  wrong("  a: {type: primitve}\n", "did you mean 'primitive'?");
  wrong("  a: {type: primitive, radios: 1}\n", "did you mean 'radius'?");
  wrong("  a: {type: primitive}\n  b: {type: transform, mesh: a.surfaces}\n", "has no output 'surfaces'");
  wrong("  a: {type: primitive}\n  b: {type: transform, mesh: aa}\n", "did you mean 'a'?");
  wrong("  a: {type: primitive}\n  b: {type: deform, surface: a, sdf: a}\n", "expected a Sdf, but 'a' is a Surface");
  wrong(
      "  a: {type: primitive}\n  t: {type: build_tets, surface: a}\n  b: {type: equilibrium, surface: a, sdf: [], tets: t, lattice: t.lattice, "
      "start: a}\n",
      "expected an EquilibriumState, but 'a' is a Surface");
  wrong("  a: {type: primitive}\n  b: {type: deform, surface: a, sdf: a}\n", "put mesh_to_sdf between: {type: mesh_to_sdf, mesh: a}");
  wrong("  a: {type: primitive}\n  b: {type: transform, mesh: a, rotation: [0, 90, 0]}\n", "did you mean 'rotate'?");
  wrong("  a: {type: primitive}\n  b: {type: build_tets, surface: a, depth: 3}\n", "did you mean 'max_depth'?");
  wrong("  a: {type: sdf}\n", "unknown node type 'sdf' (a Sdf is made by mesh_to_sdf, plane, read_vdb, union_sdf)");
  wrong("  a: {type: transform}\n", "must be connected");
  wrong("  a: {type: primitive}\n  a: {type: primitive}\n", "there twice");
  wrong("  a: {type: primitive}\n  b: {type: write_mesh, surface: [a, a], path: x.obj}\n", "takes one value");
}

TEST_F(BadInput, FramesOutOfRange) {
  for (const char* frames : {"x", "5-1", "1-99999999999", "99999999999", "1,,2", "1-2-3", "1-4x0", "1-2000000"})
    EXPECT_EQ(knead({"run", "press.yaml", "--frames", frames}).status, 3) << frames;
  put("keys.yaml", "knead: 1\nnodes:\n  a: {type: primitive}\n  b: {type: transform, mesh: a, keys: {1: {scale: 1}, one: {scale: 2}}}\n");
  EXPECT_EQ(knead({"check", "keys.yaml"}).status, 1);
  // Before the first key and after the last the motion stands still.
  const Ended ended =
      knead({"run",
             put("still.yaml",
                 "knead: 1\nnodes:\n  a: {type: primitive, shape: box}\n  b: {type: transform, mesh: a, keys: {1: {translate: [1, 0, 0]}}}\n"
                 "  c: {type: write_mesh, surface: b, path: f.#.obj}\n"),
             "--frames", "-2000000000,1,2000000000"});
  EXPECT_EQ(ended.status, 0) << ended.err;
  EXPECT_EQ(text_of(folder_ / "f.-2000000000.obj"), text_of(folder_ / "f.1.obj"));
  EXPECT_EQ(text_of(folder_ / "f.2000000000.obj"), text_of(folder_ / "f.1.obj"));
}

TEST_F(BadInput, FoldersThatCannotBeWritten) {
  fails({"result.path=/proc/nowhere/r.####.obj"}, 2, {"/proc/nowhere/r.0001.obj", "node 'result'"});
  fails({"result.path=body.obj/r.####.obj"}, 2, {"body.obj/r.0001.obj"});
  fails({"result.path=r.xyz"}, 1, {"r.xyz"});
  EXPECT_EQ(knead({"run", "press.yaml", "--out", "/proc/nowhere"}).status, 2);
  if (::geteuid() != 0) {
    fs::create_directories(folder_ / "locked");
    fs::permissions(folder_ / "locked", fs::perms::owner_read | fs::perms::owner_exec);
    fails({"result.path=locked/r.####.obj"}, 2, {"locked/r.0001.obj", "permission denied"});
    fs::permissions(folder_ / "locked", fs::perms::owner_all);
  }
}

TEST_F(BadInput, AFullDiskLeavesNothingHalfWritten) {
  const fs::path disk = folder_ / "disk";
  fs::create_directories(disk);
  if (::mount("tmpfs", disk.c_str(), "tmpfs", 0, "size=16k") != 0) GTEST_SKIP() << "no small disk can be mounted here";
  const Ended ended = knead({"run", "press.yaml", "--out", "disk"});
  std::vector<std::string> left;
  for (const auto& entry : fs::recursive_directory_iterator(disk))
    if (entry.is_regular_file()) left.push_back(entry.path().filename().string());
  const auto lines = stats("disk/stats.jsonl");
  ::umount(disk.c_str());
  EXPECT_EQ(ended.status, 2);
  EXPECT_THAT(ended.err, AllOf(HasSubstr("no space left on the device"), HasSubstr("free some space")));
  EXPECT_THAT(left, ElementsAre("stats.jsonl"));
  EXPECT_EQ(lines.size(), 2u);
}

TEST_F(BadInput, AFileSizeLimitLeavesNothingHalfWritten) {
  struct rlimit before {};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &before), 0);
  const struct rlimit small { 8192, before.rlim_max };
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &small), 0);
  const Ended ended = run("press.yaml");
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &before), 0);
  EXPECT_EQ(ended.status, 2);
  EXPECT_THAT(ended.err, HasSubstr("larger than this process may write"));
  EXPECT_THAT(files_in("out"), IsEmpty());
}

TEST_F(BadInput, CollidersThatNeverTouchAreSaidToBe) {
  Ended ended = run("press.yaml", {"motion.translate=[0, 50, 0]"});
  EXPECT_EQ(ended.status, 0);
  EXPECT_EQ(ended.err, "");
  EXPECT_THAT(ended.out, AllOf(HasSubstr("frame 2: "), HasSubstr("no contact"), HasSubstr("nothing touched the body")));
  ended = run("press.yaml");
  EXPECT_THAT(ended.out, AllOf(HasSubstr(" iterations, "), Not(HasSubstr("no contact")), Not(HasSubstr("nothing touched"))));
}

TEST_F(BadInput, CheckNamesInputsThatAreNotThere) {
  fs::remove(folder_ / "body.obj");
  const Ended ended = knead({"check", "press.yaml"});
  EXPECT_EQ(ended.status, 1);
  EXPECT_THAT(ended.err, AllOf(HasSubstr("body.obj"), HasSubstr("no such file")));
  EXPECT_THAT(ended.out, HasSubstr("1 error"));
  put("sequence.yaml", "knead: 1\nframes: 1-6\nnodes:\n  a: {type: read_mesh, path: s.#.obj}\n  b: {type: write_mesh, surface: a, path: t.#.obj}\n");
  for (const int frame : {1, 2, 6}) put("s." + std::to_string(frame) + ".obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
  const Ended sequence = knead({"check", "sequence.yaml"});
  EXPECT_EQ(sequence.status, 1);
  EXPECT_THAT(sequence.err, HasSubstr("is not there at frames 3-5"));
}

}  // namespace program_test
