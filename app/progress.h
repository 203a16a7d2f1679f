// How a run goes on: one live line with frames per second and time left on a terminal, a line per frame elsewhere, nothing when quiet.
#pragma once
#include <chrono>
#include <cstddef>
#include <set>
#include <string>

#include "graph/evaluator.h"

namespace knead::app {

class Progress {
 public:
  Progress(size_t frames, bool quiet);
  ~Progress();

  void frame_done(const FrameResult& result, const std::string& ended);  // "118 iterations, at rest", "" when nothing tells
  void warn(const std::string& message);                                 // once per message
  void error(const std::string& message);
  void end_line();  // before anything else is printed

  double seconds() const;

 private:
  void clear_line();
  void draw_line();

  size_t frames_, done_ = 0;
  bool quiet_, live_;
  std::chrono::steady_clock::time_point start_, drawn_;
  size_t width_ = 0;  // of the live line now on the screen
  std::set<std::string> warned_;
};

// "42 s", "3 min 20 s", "2 h 5 min"
std::string duration_text(double seconds);

}  // namespace knead::app
