#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <filesystem>
#include <set>

#include "app/common.h"
#include "app/interrupt.h"
#include "app/outcome.h"
#include "app/outputs.h"
#include "app/placement.h"
#include "app/progress.h"
#include "io/graph_file.h"
#include "io/stats.h"

namespace knead::app {
namespace {

std::vector<int> frames_of(const RunArguments& arguments, const Plan& plan) {
  std::vector<int> frames = plan.frames;
  if (!arguments.frames.empty()) try {
      frames = parse_frames(Literal(arguments.frames));
    } catch (const Error& error) {
      throw UsageError(fmt::format("--frames: {}", error.what()));
    }
  std::set<int> seen;
  std::erase_if(frames, [&](int frame) { return !seen.insert(frame).second; });
  return frames;
}

std::string stats_path(const RunArguments& arguments) {
  if (!arguments.stats.empty()) return arguments.stats;
  return (std::filesystem::path(arguments.graph.out) / "stats.jsonl").string();
}

void make_out_folder(const std::string& out) {
  if (out.empty()) return;
  std::error_code failed;
  std::filesystem::create_directories(out, failed);
  if (failed) throw Error(ErrorCode::kFile, Where{out, 0, 0, {}, {}}, "the folder cannot be made: " + failed.message(), "choose another with --out");
}

// One run of the command, from the compiled plan to the exit status.
class Run {
 public:
  Run(const RunArguments& arguments, std::shared_ptr<const Plan> plan, Strict strict);
  ~Run() { end_interrupts(); }
  int operator()();

 private:
  EvaluatorOptions evaluator_options();
  void find_work();
  void frame_done(const FrameResult& result, Progress& progress);
  template <class F>
  void keep_figures(Progress& progress, F&& write);
  void print_summary(const Progress& progress, double frames_seconds);
  std::string nothing_touched();
  bool is_unfinished() const { return done_ < frames_.size(); }
  void say_interrupted() const;

  const RunArguments& arguments_;
  const std::shared_ptr<const Plan> plan_;
  const std::vector<int> frames_;
  const std::unique_ptr<Executor> executor_, host_;  // host_: for nodes that run on no device
  std::unique_ptr<Evaluator> evaluator_;             // null when all frames are made and their figures told
  StatsFile stats_;
  const std::vector<std::string> outputs_;
  const std::vector<StatsNode> nodes_;
  const Judge judge_;
  Outcome outcome_;
  std::vector<int> to_do_;
  std::atomic<size_t> done_{0}, complete_{0};  // of frames_, for a run that is interrupted
  bool figures_kept_ = true;
};

Run::Run(const RunArguments& arguments, std::shared_ptr<const Plan> plan, Strict strict)
    : arguments_(arguments),
      plan_(std::move(plan)),
      frames_(frames_of(arguments, *plan_)),
      executor_(make_executor(arguments.device)),
      host_(executor_->device() == Device{} ? nullptr : make_cpu_executor(arguments.device.threads)),
      evaluator_(std::make_unique<Evaluator>(plan_, evaluator_options())),
      stats_((make_out_folder(arguments.graph.out), stats_path(arguments))),
      outputs_(wanted_outputs(*plan_, !arguments.graph.only.empty())),
      nodes_(stats_nodes(*plan_, targets_of(*plan_, outputs_))),
      judge_(*plan_),
      outcome_(std::move(strict)) {}

EvaluatorOptions Run::evaluator_options() {
  EvaluatorOptions options;
  options.executor = executor_.get();
  options.host_executor = host_.get();
  options.checked = arguments_.checked;
  options.cancelled = interrupted;
  return options;
}

// Sorts the frames into those that are complete already and those to be made.
void Run::find_work() {
  for (const int frame : frames_) {
    if (interrupted()) return;
    const std::vector<FrameRecord> records = arguments_.resume ? stats_.earlier(frame) : std::vector<FrameRecord>();
    const auto complete =
        std::find_if(records.begin(), records.end(), [&](const auto& record) { return is_complete(*evaluator_, outputs_, record); });
    if (complete == records.end()) {
      to_do_.push_back(frame);
      continue;
    }
    outcome_.add_skipped(frame, judge_.judge(complete->line));
    ++done_;
    ++complete_;
  }
}

// A disk that is full for the figures must not end the frames.
template <class F>
void Run::keep_figures(Progress& progress, F&& write) {
  try {
    write();
  } catch (const Error& error) {
    if (figures_kept_) progress.error(error.what());
    figures_kept_ = false;
  }
}

void Run::frame_done(const FrameResult& result, Progress& progress) {
  FrameRecord made;
  made.graph = arguments_.graph.graph;
  made.only = arguments_.graph.only;
  keep_figures(progress, [&] {
    if (result.error) return;
    made.key = evaluator_->frame_key(result.frame, outputs_, true).text();
    for (const std::string& path : files_of(*plan_, result.frame)) made.files.push_back(written_file(path));
  });
  const std::string line = stats_line(result, nodes_, made);
  keep_figures(progress, [&] { stats_.add(line); });
  const Verdict verdict = judge_.judge(line);
  if (result.error)
    outcome_.add_failed(result.frame);
  else
    outcome_.add_good(result.frame, verdict);
  progress.frame_done(result, verdict.ended);
  ++done_;
  complete_ += !result.error;
}

void Run::say_interrupted() const {
  spdlog::error("interrupted: {} of {} frames are complete; the same command with --resume goes on from here", complete_.load(), frames_.size());
}

// A collider that lies in the body, or around it, presses nothing either.
std::string Run::nothing_touched() {
  const Placement placement = find_placement(*evaluator_, frames_);
  for (const Reach& reach : placement.reaches)
    if (!reach.enclosed.empty()) return {};
  return fmt::format("nothing touched the body in any of these frames: are body and colliders of one size, and does the motion lead to the body?\n{}",
                     placement_text({{}, placement.reaches, {}, {}, placement.frames_looked_at}, frames_.size()));
}

void Run::print_summary(const Progress& progress, double frames_seconds) {
  const std::string outcome = outcome_.text();
  if (arguments_.quiet) {
    if (!outcome.empty()) spdlog::warn("{}: of {}, {}", arguments_.graph.graph, counted(frames_.size(), "frame"), outcome);
    return;
  }
  const size_t made = outcome_.good() + outcome_.failed();
  const double seconds = progress.seconds(), reading = seconds_of_process() - seconds;
  fmt::print("{} in {:.2f} s", counted(made, "frame"), seconds);
  if (made > 0 && seconds > 0) fmt::print(" ({:.2f} frames/s)", static_cast<double>(made) / seconds);
  if (outcome_.skipped()) fmt::print(", {} skipped: complete already", outcome_.skipped());
  if (!outcome.empty()) fmt::print("\n{}", outcome);
  const EvaluatorFigures figures = evaluator_->figures();
  const std::string warning = outcome_.without_contact() && !is_unfinished() ? nothing_touched() : std::string();
  evaluator_.reset();  // the memory of all that it keeps takes time to give back
  const double total = seconds_of_process();
  fmt::print("\n{}", times_text(figures, {reading, frames_seconds, total}));
  std::string evaluations;
  for (const auto& [type, times] : figures.evaluations) evaluations += fmt::format("{}{} {}", evaluations.empty() ? "" : ", ", type, times);
  fmt::print("cache: {} hits, {} misses; evaluated: {}\n", figures.cache.hits, figures.cache.misses, evaluations.empty() ? "nothing" : evaluations);
  if (figures.moved.count + figures.by_nodes.count > 0)
    fmt::print("transfers: {}, {} bytes between nodes; {}, {} bytes within them\n", figures.moved.count, figures.moved.bytes, figures.by_nodes.count,
               figures.by_nodes.bytes);
  fmt::print("figures: {}\n", stats_.path());
  if (!arguments_.graph.out.empty()) fmt::print("results: {}\n", arguments_.graph.out);
  fmt::print("{}", warning);
}

int Run::operator()() {
  catch_interrupts([this] { return !is_unfinished(); }, [this] { say_interrupted(); });
  const int threads = (host_ ? host_ : executor_)->threads();
  if (!arguments_.quiet)
    fmt::print("{}: {} on {}{}, {}\n", arguments_.graph.graph, counted(frames_.size(), "frame"), executor_->name(),
               host_ ? fmt::format(" ({})", executor_choices().front().description) : "", counted(static_cast<size_t>(threads), "thread"));
  find_work();
  Progress progress(to_do_.size(), arguments_.quiet);
  if (plan_->sinks().empty())
    progress.warn("the graph writes nothing: add a node such as write_mesh");
  else
    for (const std::string& line : unused_nodes(*plan_)) progress.warn(line);
  const double before = progress.seconds();
  evaluator_->evaluate_frames(to_do_, outputs_, true, [&](const FrameResult& result) { frame_done(result, progress); });
  const double frames_seconds = progress.seconds() - before;
  keep_figures(progress, [&] { stats_.finish(); });
  progress.end_line();
  print_summary(progress, frames_seconds);
  const std::vector<std::string> objections = outcome_.objections();
  for (const std::string& objection : objections) spdlog::error("{}", objection);
  if (interrupted() && is_unfinished()) {
    end_interrupts();
    say_interrupted();
    std::fflush(stdout);
    ::_exit(kInterrupted);  // libraries that end their threads would take longer than a signal may
  }
  if (arguments_.sheet)
    for (const std::string& sheet : write_sheets(*plan_, frames_))
      if (!arguments_.quiet) fmt::print("contact sheet: {}\n", sheet);
  if (outcome_.failed() || !figures_kept_) return kFrameFailed;
  return objections.empty() ? kGood : kStrict;
}

}  // namespace

int run(const RunArguments& arguments) {
  Strict strict(arguments.strict);
  return Run(arguments, load_plan(arguments.graph), std::move(strict))();
}

}  // namespace knead::app
