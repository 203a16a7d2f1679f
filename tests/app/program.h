// Runs the program as a process in a folder of its own: its exit status, what it prints and the files it leaves.
#pragma once
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "graph/executor.h"
#include "tests/paths.h"

namespace program_test {

namespace fs = std::filesystem;
using knead::cuda_devices;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

inline std::string program_path() {
  return binary_dir() + "/app/knead";
}

inline std::string text_of(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

struct Ended {
  int status = -1;  // exit status, or 1000 + signal
  std::string out, err;
};

class Program : public testing::Test {
 protected:
  void SetUp() override {
    if (!fs::exists(program_path())) GTEST_SKIP() << "built without the program";
    folder_ = fs::temp_directory_path() /
              ("knead_program_" + std::string(testing::UnitTest::GetInstance()->current_test_info()->name()) + std::to_string(::getpid()));
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  void TearDown() override {
    if (!folder_.empty()) fs::remove_all(folder_);
  }

  fs::path put(const std::string& name, const std::string& text) const {
    std::ofstream(folder_ / name, std::ios::binary) << text;
    return folder_ / name;
  }

  // What the graphs of README.md and docs/ read, head.obj and fist.obj, in a folder of folder_.
  void make_inputs(const std::string& sub = ".") const {
    put(sub + "/make_inputs.yaml", R"(knead: 1
nodes:
  head: {type: primitive, shape: blob, height: 2, resolution: 12}
  fist: {type: primitive, shape: sphere, radius: 0.4, resolution: 3}
  head_file: {type: write_mesh, surface: head, path: head.obj}
  fist_file: {type: write_mesh, surface: fist, path: fist.obj}
)");
    ASSERT_EQ(knead({"run", sub + "/make_inputs.yaml", "-q", "--out", sub}).status, 0);
  }

  // Starts the program in folder_; its output goes to files, or stdout to `out_path`.
  pid_t start(const std::vector<std::string>& words, const std::string& out_path = {}) const {
    std::string program = program_path();
    std::vector<char*> arguments{program.data()};
    for (const std::string& word : words) arguments.push_back(const_cast<char*>(word.c_str()));
    arguments.push_back(nullptr);
    const std::string out = out_path.empty() ? (folder_ / "stdout").string() : out_path, err = (folder_ / "stderr").string();
    const pid_t child = ::fork();
    if (child != 0) return child;
    const int out_file = ::open(out.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0666), err_file = ::open(err.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0666);
    if (::chdir(folder_.c_str()) != 0 || ::dup2(out_file, 1) < 0 || ::dup2(err_file, 2) < 0) ::_exit(125);
    ::execv(program.c_str(), arguments.data());
    ::_exit(126);
  }
  Ended wait_for(pid_t child) const {
    int status = 0;
    ::waitpid(child, &status, 0);
    return {WIFEXITED(status) ? WEXITSTATUS(status) : 1000 + WTERMSIG(status), text_of(folder_ / "stdout"), text_of(folder_ / "stderr")};
  }
  Ended knead(const std::vector<std::string>& words) const { return wait_for(start(words)); }

  std::vector<nlohmann::json> stats(const std::string& path = "stats.jsonl") const {
    std::vector<nlohmann::json> lines;
    std::ifstream in(folder_ / path);
    for (std::string line; std::getline(in, line);) lines.push_back(nlohmann::json::parse(line));
    return lines;
  }
  // A figure of the last node of the line that tells it; NaN where none does.
  static double figure(const nlohmann::json& line, const std::string& name) {
    double value = std::numeric_limits<double>::quiet_NaN();
    for (const auto& [node, entry] : line.at("nodes").items())
      if (entry.contains("report") && entry["report"].contains(name) && entry["report"][name].is_number()) value = entry["report"][name];
    return value;
  }
  static std::vector<std::string> warnings(const nlohmann::json& line) {
    std::vector<std::string> all;
    for (const auto& [node, entry] : line.at("nodes").items())
      for (const auto& warning : entry.value("warnings", nlohmann::json::array()))
        all.push_back("node '" + node + "': " + warning.get<std::string>());
    return all;
  }
  std::vector<std::string> files_in(const std::string& sub) const {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(folder_ / sub)) names.push_back(entry.path().filename().string());
    std::sort(names.begin(), names.end());
    return names;
  }

  // With parameters set.
  Ended run(const std::string& graph, const std::vector<std::string>& sets = {}) const {
    std::vector<std::string> words{"run", graph};
    for (const std::string& set : sets) words.insert(words.end(), {"--set", set});
    return knead(words);
  }

  fs::path folder_;
};

}  // namespace program_test
