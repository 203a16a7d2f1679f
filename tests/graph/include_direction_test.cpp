// Who may include whom: design.md, "The house". Reads the tree, not the compiler.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "tests/paths.h"

namespace knead {
namespace include_direction_test {

namespace fs = std::filesystem;

struct Include {
  std::string file;  // "io/vdb/vdb.cpp"
  std::string what;  // "graph/error.h" or "openvdb/openvdb.h"
  int line;
};

const char* const kRooms[] = {"graph", "kernels", "nodes", "io", "app"};

bool is_header(const fs::path& path) {
  return path.extension() == ".h" || path.extension() == ".hpp" || path.extension() == ".cuh";
}
bool is_source(const fs::path& path) {
  return path.extension() == ".cpp" || path.extension() == ".cu" || is_header(path);
}

// What stands between <> or "" in an #include line; "" for other lines.
std::string included(const std::string& line) {
  const size_t hash = line.find_first_not_of(" \t");
  if (hash == std::string::npos || line[hash] != '#') return {};
  const size_t word = line.find_first_not_of(" \t", hash + 1);
  if (word == std::string::npos || line.compare(word, 7, "include") != 0) return {};
  const size_t open = line.find_first_of("<\"", word);
  const size_t close = open == std::string::npos ? open : line.find_first_of(">\"", open + 1);
  return close == std::string::npos ? std::string() : line.substr(open + 1, close - open - 1);
}

std::vector<Include> includes_of(const std::string& room) {
  std::vector<Include> found;
  const fs::path root = source_dir();
  for (const auto& entry : fs::recursive_directory_iterator(root / room)) {
    if (!entry.is_regular_file() || !is_source(entry.path())) continue;
    std::ifstream in(entry.path());
    std::string text;
    for (int line = 1; std::getline(in, text); ++line)
      if (const std::string what = included(text); !what.empty()) found.push_back({fs::relative(entry.path(), root).generic_string(), what, line});
  }
  return found;
}

std::string room_of(const std::string& path) {
  const std::string first = path.substr(0, path.find('/'));
  for (const char* room : kRooms)
    if (first == room && path != first) return first;
  return {};
}

bool begins(const std::string& text, const std::string& with) {
  return text.compare(0, with.size(), with) == 0;
}

std::string said(const Include& include) {
  return include.file + ":" + std::to_string(include.line) + " includes " + include.what;
}

TEST(IncludeDirection, IsOneWay) {
  const std::map<std::string, std::set<std::string>> may_see{{"graph", {"graph"}},
                                                             {"kernels", {"kernels", "graph"}},
                                                             {"nodes", {"nodes", "graph", "kernels", "io"}},
                                                             {"io", {"io", "graph", "kernels"}},
                                                             {"app", {"app", "graph", "io"}}};
  for (const char* room : kRooms) {
    const std::vector<Include> includes = includes_of(room);
    EXPECT_FALSE(includes.empty()) << room << ": is source_dir() right?";
    for (const Include& include : includes) {
      const std::string other = room_of(include.what);
      EXPECT_TRUE(other.empty() || may_see.at(room).count(other)) << said(include);
    }
  }
}

TEST(IncludeDirection, IoSeesAFewHeadersOfKernels) {
  const std::map<std::string, const char*> known{
      {"kernels/port_types.h", "the data that files hold"},
      {"kernels/vec.h", "its arithmetic"},
      {"kernels/simd_level.h", "what `knead info` prints"},
      {"kernels/surface/disjoint_sets.h", "pieces, to describe a mesh"},
      {"kernels/surface/edges.h", "open and crowded edges, to describe a mesh"},
      {"kernels/surface/volume.h", "which way a mesh faces, to describe it"},
      {"kernels/surface/weld.h", "vertices at the same place"},
      {"kernels/surface/mesh_distance.h", "the distances that fields are made of"},
      {"kernels/surface/exact_distance.h", "the same, of whatever a collider is"},
      {"kernels/surface/shell_distance.h", "the same, of what bounds nothing"},
      {"kernels/surface/searchable_mesh.h", "the same, as nodes share it"},
  };
  std::set<std::string> seen;
  for (const Include& include : includes_of("io")) {
    if (room_of(include.what) != "kernels") continue;
    EXPECT_TRUE(known.count(include.what)) << said(include) << ": not one of the headers that io may see";
    seen.insert(include.what);
  }
  for (const auto& [header, reason] : known) EXPECT_TRUE(seen.count(header)) << header << " (" << reason << ") is on the list and no longer seen";
}

// The room of kernels/ that a path is in; "" for the top, and for other folders.
std::string kernel_room_of(const std::string& path) {
  const size_t first = path.find('/'), second = path.find('/', first + 1);
  return begins(path, "kernels/") && second != std::string::npos ? path.substr(first + 1, second - first - 1) : std::string();
}

TEST(IncludeDirection, TheRoomsOfKernelsLookOneWay) {
  const std::map<std::string, std::set<std::string>> may_see{
      {"surface", {}},       {"shapes", {}},    {"build_tets", {"surface"}},
      {"loop", {"surface"}}, {"multigrid", {}}, {"equilibrium", {"surface", "loop", "multigrid"}},
  };
  // The one table of functions that is compiled per level of vector instructions holds the multigrid's rows too.
  const std::set<std::pair<std::string, std::string>> excused{{"kernels/multigrid/multigrid.cpp", "kernels/equilibrium/energy_simd.h"}};
  std::set<std::string> rooms;
  for (const Include& include : includes_of("kernels")) {
    const std::string room = kernel_room_of(include.file), other = kernel_room_of(include.what);
    if (room.empty()) continue;
    rooms.insert(room);
    ASSERT_TRUE(may_see.count(room)) << room << ": say here what this room may see";
    EXPECT_TRUE(other.empty() || other == room || may_see.at(room).count(other) || excused.count({include.file, include.what})) << said(include);
  }
  EXPECT_EQ(rooms.size(), may_see.size());
}

TEST(IncludeDirection, WhatAllKernelsShareSeesNoRoom) {
  const std::set<std::string> excused{
      "kernels/device_bodies.h",  // the list of everything that devices run
      "kernels/measure.cpp",      // figures about what the rooms have made
  };
  for (const Include& include : includes_of("kernels"))
    EXPECT_TRUE(!kernel_room_of(include.file).empty() || kernel_room_of(include.what).empty() || excused.count(include.file)) << said(include);
}

TEST(IncludeDirection, NobodyIncludesNodesOrApp) {
  // But for the words that the two nodes of the whole job share.
  const std::set<std::string> excused{"nodes/deform_parts.h"};
  for (const char* room : kRooms)
    for (const Include& include : includes_of(room)) {
      EXPECT_TRUE(room_of(include.what) != "nodes" || (std::string(room) == "nodes" && excused.count(include.what))) << said(include);
      EXPECT_TRUE(std::string(room) == "app" || room_of(include.what) != "app") << said(include);
    }
}

TEST(IncludeDirection, TheRoomsNameTheirHeadersInFull) {
  for (const char* room : kRooms)
    for (const Include& include : includes_of(room)) {
      EXPECT_FALSE(begins(include.what, "../")) << said(include);
      EXPECT_FALSE(fs::exists(fs::path(source_dir()) / fs::path(include.file).parent_path() / include.what))
          << said(include) << ": write the room's name too";
    }
}

TEST(IncludeDirection, HeadersShowNoneOfTheLibrariesBehindThem) {
  const char* const hidden[] = {"openvdb/", "tbb/", "oneapi/",         "embree", "yaml-cpp/", "Eigen/",
                                "spdlog/",  "CLI/", "tiny_obj_loader", "png.h",  "cuda",      "Imath"};
  for (const char* room : {"graph", "kernels", "nodes", "io"})
    for (const Include& include : includes_of(room)) {
      // But for what the sources of libknead_vdb tell each other, which are all OpenVDB's.
      if (include.what == "io/vdb/file_grids.h") EXPECT_TRUE(begins(include.file, "io/vdb/") && !is_header(include.file)) << said(include);
      if (!is_header(include.file) || include.file == "io/vdb/file_grids.h") continue;
      for (const char* library : hidden) EXPECT_FALSE(begins(include.what, library)) << said(include);
    }
}

TEST(IncludeDirection, TheEngineKnowsNoGeometryAndNoDevice) {
  for (const Include& include : includes_of("graph"))
    for (const char* library : {"openvdb/", "nanovdb/", "cuda", "embree", "Eigen/", "yaml-cpp/"})
      EXPECT_FALSE(begins(include.what, library)) << said(include);
}

TEST(IncludeDirection, TbbStandsWhereLoopsAreMade) {
  for (const Include& include : includes_of("graph"))
    EXPECT_TRUE(include.file == "graph/executor.cpp" || (!begins(include.what, "oneapi/") && !begins(include.what, "tbb/"))) << said(include);
}

TEST(IncludeDirection, EveryHeaderIsIncludedOnce) {
  for (const char* room : kRooms)
    for (const auto& entry : fs::recursive_directory_iterator(fs::path(source_dir()) / room)) {
      if (!is_header(entry.path())) continue;
      std::ifstream in(entry.path());
      const std::string text((std::istreambuf_iterator<char>(in)), {});
      EXPECT_NE(text.find("#pragma once"), std::string::npos) << entry.path();
    }
}

}  // namespace include_direction_test
}  // namespace knead
