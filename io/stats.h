// stats.jsonl: a line of JSON for every frame, in the order of the frames, and what --resume needs to know about it.
//
//   {"frame": 12, "ok": true, "seconds": 0.043, "iterations": 118, "ended": "at rest", ..., "times": {"press": 0.04, ...}, "warnings": [], "key":
//   "...",
//    "files": [{"path": "out/head.0012.obj", "bytes": 180211, "hash": "..."}]}
#pragma once
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "graph/evaluator.h"

namespace knead {

struct WrittenFile {
  std::string path;
  uint64_t bytes = 0;
  std::string hash;  // of the contents
};

// The file as it is now. Throws Error(kFile) when it is not there.
KNEAD_API WrittenFile written_file(const std::string& path);

// What a line says about how the frame was made.
struct FrameRecord {
  int frame = 0;
  bool ok = false;
  std::string key;  // Evaluator::frame_key
  std::vector<WrittenFile> files;
};

struct ReportOutput {
  std::string reference;    // "figures.report"
  bool is_summary = false;  // of a measure node
};

// The line of a frame, without its end of line. The figures of the Reports among `result.values` that `reports` names are merged in that order. A
// name that several nodes give is written as NODE.NAME, but plain for the one summary among them. What is not a finite number becomes null. Times are
// those of nodes that really ran.
KNEAD_API std::string stats_line(const FrameResult& result, const std::vector<ReportOutput>& reports, const std::string& key,
                                 const std::vector<WrittenFile>& files);

// False when the line is none of ours or is not whole.
KNEAD_API bool read_stats_line(const std::string& line, FrameRecord& record);

// Lines are appended as frames end, each with one write, so that a crash leaves whole lines; `finish` puts them in order. Throws Error(kFile).
class KNEAD_API StatsFile {
 public:
  // `keep` reads the lines of an earlier run, to stay unless their frames are added again. Otherwise the file begins empty. Missing folders are made.
  StatsFile(std::string path, bool keep);
  ~StatsFile();
  StatsFile(const StatsFile&) = delete;
  StatsFile& operator=(const StatsFile&) = delete;

  const std::string& path() const { return path_; }
  const FrameRecord* earlier(int frame) const;  // null when there is none
  void add(int frame, const std::string& line);
  void finish();

 private:
  std::string path_;
  std::map<int, std::string> lines_;
  std::map<int, FrameRecord> earlier_;
  int file_ = -1;
  bool is_regular_ = false;
};

}  // namespace knead
