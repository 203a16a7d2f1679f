// What the documentation says is there: its links lead somewhere, and every graph in it runs.
#include <algorithm>
#include <cctype>
#include <map>
#include <set>

#include "tests/app/program.h"
#include "tests/paths.h"

namespace program_test {

class Docs : public Program {
 protected:
  static std::vector<fs::path> pages() {
    std::vector<fs::path> found{fs::path(source_dir()) / "README.md"};
    for (const auto& entry : fs::directory_iterator(fs::path(source_dir()) / "docs"))
      if (entry.path().extension() == ".md") found.push_back(entry.path());
    std::sort(found.begin(), found.end());
    return found;
  }

  static std::vector<std::string> between_all(const std::string& text, const std::string& open, const std::string& close) {
    std::vector<std::string> found;
    for (size_t at = text.find(open); at != std::string::npos; at = text.find(open, at)) {
      at += open.size();
      found.push_back(text.substr(at, text.find(close, at) - at));
    }
    return found;
  }

  // The blocks of a page between ```LANGUAGE and ```.
  static std::vector<std::string> blocks(const std::string& text, const std::string& language) {
    std::vector<std::string> found;
    const std::string open = "```" + language + "\n";
    for (size_t at = text.find(open); at != std::string::npos; at = text.find(open, at)) {
      at += open.size();
      const size_t end = text.find("```", at);
      found.push_back(text.substr(at, end - at));
      at = end + 3;
    }
    return found;
  }

  // "## Where things stand" as a link names it: where-things-stand.
  static std::set<std::string> anchors(const std::string& text) {
    std::set<std::string> found;
    std::istringstream lines(text);
    for (std::string line; std::getline(lines, line);) {
      if (line.rfind("#", 0) != 0) continue;
      std::string name;
      for (const char c : line.substr(line.find_first_not_of("# "))) {
        if (std::isalnum(static_cast<unsigned char>(c)) || c == '_' || c == '-') name += static_cast<char>(std::tolower(c));
        if (c == ' ') name += '-';
      }
      found.insert(name);
    }
    return found;
  }

  static std::string file_of(const std::string& graph) {  // from its first line, "# file: press.yaml"
    const std::string mark = "# file: ";
    return graph.rfind(mark, 0) == 0 ? graph.substr(mark.size(), graph.find('\n') - mark.size()) : "";
  }
};

TEST_F(Docs, LinksLeadSomewhere) {
  size_t count = 0;
  for (const fs::path& page : pages()) {
    const std::string text = text_of(page);
    for (const std::string& target : between_all(text, "](", ")")) {
      if (target.rfind("http", 0) == 0 || target.find_first_of(" \n") != std::string::npos) continue;
      ++count;
      const size_t hash = target.find('#');
      const fs::path file = hash == 0 ? page : page.parent_path() / target.substr(0, hash);
      EXPECT_TRUE(fs::exists(file)) << page << ": " << target;
      if (hash != std::string::npos && fs::exists(file)) EXPECT_TRUE(anchors(text_of(file)).count(target.substr(hash + 1))) << page << ": " << target;
    }
  }
  EXPECT_GT(count, 20u);
}

TEST_F(Docs, EveryPageIsReachedFromTheFirstAndIsInTheSite) {
  const std::string readme = text_of(fs::path(source_dir()) / "README.md"), site = text_of(fs::path(source_dir()) / "mkdocs.yml");
  for (const fs::path& page : pages()) {
    const std::string name = page.filename().string();
    if (name == "README.md") continue;
    EXPECT_THAT(readme, HasSubstr("(docs/" + name + ")"));
    EXPECT_THAT(site, HasSubstr("- " + name + "\n"));
  }
}

// Each page in a folder of its own, top to bottom; files that a graph names are made by the graphs before it, or by this test.
TEST_F(Docs, EveryGraphRunsAsItStands) {
  size_t count = 0;
  for (const fs::path& page : pages()) {
    const fs::path folder = folder_ / page.stem();
    fs::create_directories(folder);
    make_inputs(page.stem().string());
    for (const std::string& graph : blocks(text_of(page), "yaml")) {
      if (graph.find("knead: 1") == std::string::npos) continue;
      const std::string name = file_of(graph).empty() ? "graph.yaml" : file_of(graph);
      put(page.stem() / name, graph);
      if (graph.find("\ninputs:") != std::string::npos) continue;  // a group: the graph after it uses it
      ++count;
      const Ended ended = knead(
          {"run", (folder / name).string(), "-q", "--out", folder.string(), "--frames", graph.find("\nframes:") == std::string::npos ? "1" : "2"});
      EXPECT_EQ(ended.status, 0) << page << ", " << name << ": " << ended.err;
      // The paper's loop may say that it did not come to rest; nothing else may be said.
      if (ended.err.find("did not come to rest") == std::string::npos) EXPECT_EQ(ended.err, "") << page << ", " << name;
    }
  }
  EXPECT_GE(count, 6u);
}

TEST_F(Docs, NodesAreThoseThatTheDeclarationsGive) {
  EXPECT_EQ(text_of(fs::path(source_dir()) / "docs/nodes.md"), knead({"nodes", "--markdown"}).out)
      << "write the output of `knead nodes --markdown` to docs/nodes.md";
}

TEST_F(Docs, TheProgramsPageNamesEveryCommandAndOptionOfRun) {
  const std::string help = knead({"run", "--help"}).out, page = text_of(fs::path(source_dir()) / "docs/program.md");
  for (size_t at = help.find("--"); at != std::string::npos; at = help.find("--", at + 2)) {
    const std::string option = help.substr(at, help.find_first_not_of("abcdefghijklmnopqrstuvwxyz-", at) - at);
    if (option.size() > 3 && option != "--help") EXPECT_THAT(page, HasSubstr("`" + option)) << "of knead run";
  }
  for (const char* command : {"run", "check", "graph", "nodes", "info"}) EXPECT_THAT(page, HasSubstr(std::string("knead ") + command));
}

}  // namespace program_test
