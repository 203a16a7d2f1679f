// stats.jsonl: a line of JSON for every frame, in the order of the frames, and what --resume needs to know about it. Figures stand by node, so that a
// node's stay where they are whatever else the graph holds; `stats_schema` says what a line may hold.
//
//   {"version": 1, "frame": 12, "ok": true, "graph": "press.yaml", "seconds": 0.043,
//    "nodes": {"press.press": {"type": "equilibrium", "seconds": 0.04, "cached": false, "report": {"iterations": 118, "ended": "at rest", ...},
//              "warnings": ["..."]}, ...},
//    "files": [{"path": "out/head.0012.obj", "bytes": 180211, "hash": "..."}], "key": "..."}
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "graph/evaluator.h"
#include "graph/report.h"

namespace knead {

struct WrittenFile {
  std::string path;
  uint64_t bytes = 0;
  std::string hash;  // of the contents
};

// The file as it is now. Throws Error(kFile) when it is not there.
KNEAD_API WrittenFile written_file(const std::string& path);

// A node of which lines speak.
struct StatsNode {
  std::string name, type;
  std::string report;  // the reference of its Report; "" for a node without one
};

// Every node that `targets` stand on, in plan order, a loop's inner nodes after it. Only nodes outside of loops have reports.
KNEAD_API std::vector<StatsNode> stats_nodes(const Plan& plan, const std::vector<Source>& targets);

// What a line says about how the frame was made.
struct FrameRecord {
  int version = 0;  // of the line; 0: written before lines had one
  int frame = 0;
  bool ok = false;
  std::string graph;              // the graph file, as it was named
  std::vector<std::string> only;  // CompileOptions::only
  std::string key;                // Evaluator::frame_key
  std::vector<WrittenFile> files;
  std::string line;  // as it was read
};

// What a line says about a node.
struct NodeFigures {
  std::string name, type;
  Report report;
  std::vector<std::string> warnings;
};

// The line of a frame, without its end of line. `made` gives graph, only, key and files. Reports are those among `result.values`. What is not a
// finite number becomes null.
KNEAD_API std::string stats_line(const FrameResult& result, const std::vector<StatsNode>& nodes, const FrameRecord& made);

// False when the line is none of ours or is not whole.
KNEAD_API bool read_stats_line(const std::string& line, FrameRecord& record);

// The nodes of a line, in its order.
KNEAD_API std::vector<NodeFigures> read_node_figures(const std::string& line);

// A JSON schema (draft 7) of a line, as indented text.
KNEAD_API std::string stats_schema();

// The file of lines, which other processes may write at the same time: each line is appended whole, under a lock, so that a crash leaves whole lines.
// A line replaces an earlier one of the same frame when both were made by the same graph, or when all files of the earlier one are written again.
// Other lines stay. Throws Error(kFile).
class KNEAD_API StatsFile {
 public:
  // Reads the lines that are there. Missing folders are made.
  explicit StatsFile(std::string path);
  ~StatsFile();
  StatsFile(const StatsFile&) = delete;
  StatsFile& operator=(const StatsFile&) = delete;

  const std::string& path() const { return path_; }
  std::vector<FrameRecord> earlier(int frame) const;  // of the lines that were there
  void add(const std::string& line);
  void finish();  // leaves out what was replaced, and puts the lines in order

 private:
  class Lock;
  void open();
  [[noreturn]] void fail(const char* doing, int error) const;
  std::string path_;
  std::vector<FrameRecord> earlier_;
  int file_ = -1;
  bool is_regular_ = false;
};

}  // namespace knead
