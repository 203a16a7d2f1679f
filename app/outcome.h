// What a run came to: how many frames failed, did not come to rest or carry warnings, and where its time went.
#pragma once
#include <string>
#include <vector>

#include "app/strict.h"
#include "app/verdict.h"
#include "graph/evaluator.h"

namespace knead::app {

class Outcome {
 public:
  explicit Outcome(Strict strict) : strict_(std::move(strict)) {}

  void add_failed(int frame) { failed_.push_back(frame); }
  void add_good(int frame, const Verdict& verdict);
  void add_skipped(int frame, const Verdict& verdict);

  size_t good() const { return good_; }
  size_t failed() const { return failed_.size(); }
  size_t skipped() const { return skipped_; }
  size_t complete() const { return good_ + skipped_; }

  // "2 frames failed (3, 7), 1 did not come to rest (5)"; "" when all went well.
  std::string text() const;

  // Why --strict is not content, a line for every frame.
  std::vector<std::string> objections() const;

  // Every frame can tell, and none was pressed by anything, though nothing hides that.
  bool without_contact() const { return untouched_ > 0 && touched_ == 0 && untold_ == 0 && failed_.empty(); }

 private:
  void judge(int frame, const Verdict& verdict);
  Strict strict_;
  size_t good_ = 0, skipped_ = 0, touched_ = 0, untouched_ = 0, untold_ = 0;
  std::vector<int> failed_, restless_, warned_;
  std::vector<std::string> objections_;
};

// Wall clock of a run's parts.
struct RunTimes {
  double reading = 0;  // from the start of the process to the first frame
  double frames = 0;   // evaluate_frames, the set-up included
  double total = 0;
};

// "time: 2.31 s = 0.02 reading + 1.85 set-up + 0.40 frames + 0.04 closing", and the nodes that took most of set-up and frames.
std::string times_text(const EvaluatorFigures& figures, const RunTimes& times);

}  // namespace knead::app
