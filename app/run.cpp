#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <filesystem>
#include <set>

#include "app/common.h"
#include "app/interrupt.h"
#include "app/outputs.h"
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

// What every frame is asked for: the figures, and where nothing is written the ends of the graph, so that it runs at all.
std::vector<std::string> wanted_outputs(const Plan& plan, const std::vector<ReportOutput>& reports) {
  std::vector<std::string> outputs;
  for (const ReportOutput& report : reports) outputs.push_back(report.reference);
  if (!plan.sinks().empty()) return outputs;
  std::vector<bool> used(plan.nodes.size());
  for (const PlanNode& node : plan.nodes)
    for (const auto& port : node.inputs)
      for (const Source source : port) used[static_cast<size_t>(source.node)] = true;
  for (size_t i = 0; i < plan.nodes.size(); ++i)
    if (const auto& outs = plan.nodes[i].node->outputs(); !used[i] && !outs.empty()) outputs.push_back(plan.nodes[i].name + "." + outs[0].name);
  return outputs;
}

struct Counts {
  size_t good = 0, failed = 0, skipped = 0;
};

void print_summary(const RunArguments& arguments, const Evaluator& evaluator, const Counts& counts, double seconds, const std::string& stats) {
  const size_t made = counts.good + counts.failed;
  fmt::print("{} frame{} in {:.2f} s", made, made == 1 ? "" : "s", seconds);
  if (made > 0 && seconds > 0) fmt::print(" ({:.2f} frames/s)", static_cast<double>(made) / seconds);
  if (counts.failed) fmt::print(", {} failed", counts.failed);
  if (counts.skipped) fmt::print(", {} skipped: complete already", counts.skipped);
  const EvaluatorFigures figures = evaluator.figures();
  std::string evaluations;
  for (const auto& [type, times] : figures.evaluations) evaluations += fmt::format("{}{} {}", evaluations.empty() ? "" : ", ", type, times);
  fmt::print("\ncache: {} hits, {} misses; evaluated: {}\n", figures.cache.hits, figures.cache.misses, evaluations.empty() ? "nothing" : evaluations);
  if (figures.moved.count + figures.by_nodes.count > 0)
    fmt::print("transfers: {}, {} bytes between nodes; {}, {} bytes within them\n", figures.moved.count, figures.moved.bytes, figures.by_nodes.count,
               figures.by_nodes.bytes);
  fmt::print("figures: {}\n", stats);
  if (!arguments.graph.out.empty()) fmt::print("results: {}\n", arguments.graph.out);
}

std::string stats_path(const RunArguments& arguments) {
  if (!arguments.stats.empty()) return arguments.stats;
  return (std::filesystem::path(arguments.graph.out) / "stats.jsonl").string();
}

// Keeps the figures of one run; a disk that is full for them must not end the frames.
class Figures {
 public:
  Figures(StatsFile& file, std::vector<ReportOutput> reports, Progress& progress) : file_(file), reports_(std::move(reports)), progress_(progress) {}
  bool good() const { return good_; }
  void add(const Evaluator& evaluator, const FrameResult& result, const std::vector<std::string>& outputs) {
    keep([&] {
      std::string key;
      std::vector<WrittenFile> files;
      if (!result.error) {
        key = evaluator.frame_key(result.frame, outputs, true).text();
        for (const std::string& path : files_of(evaluator.plan(), result.frame)) files.push_back(written_file(path));
      }
      file_.add(result.frame, stats_line(result, reports_, key, files));
    });
  }
  void finish() {
    keep([&] { file_.finish(); });
  }

 private:
  template <class F>
  void keep(F&& write) {
    try {
      write();
    } catch (const Error& error) {
      if (good_) progress_.error(error.what());
      good_ = false;
    }
  }
  StatsFile& file_;
  std::vector<ReportOutput> reports_;
  Progress& progress_;
  bool good_ = true;
};

void make_out_folder(const std::string& out) {
  if (out.empty()) return;
  std::error_code failed;
  std::filesystem::create_directories(out, failed);
  if (failed) throw Error(ErrorCode::kFile, Where{out, 0, 0, {}, {}}, "the folder cannot be made: " + failed.message(), "choose another with --out");
}

}  // namespace

int run(const RunArguments& arguments) {
  const auto plan = load_plan(arguments.graph);
  const std::vector<int> frames = frames_of(arguments, *plan);
  const auto executor = make_executor(arguments.device);
  const auto host = executor->device() == Device{} ? nullptr : make_cpu_executor(arguments.device.threads);  // for nodes that run on no device
  EvaluatorOptions options;
  options.executor = executor.get();
  options.host_executor = host.get();
  options.checked = arguments.checked;
  options.cancelled = interrupted;
  Evaluator evaluator(plan, options);
  catch_interrupts();
  make_out_folder(arguments.graph.out);
  StatsFile stats(stats_path(arguments), arguments.resume);
  const int threads = (host ? host : executor)->threads();
  if (!arguments.quiet)
    fmt::print("{}: {} frame{} on {}{}, {} thread{}\n", arguments.graph.graph, frames.size(), frames.size() == 1 ? "" : "s", executor->name(),
               host ? fmt::format(" ({})", executor_choices().front().description) : "", threads, threads == 1 ? "" : "s");

  Counts counts;
  std::vector<int> to_do;
  const std::vector<ReportOutput> reports = report_outputs(*plan);
  const std::vector<std::string> outputs = wanted_outputs(*plan, reports);
  for (const int frame : frames) {
    if (interrupted()) break;
    if (arguments.resume && is_complete(evaluator, frame, outputs, stats.earlier(frame)))
      ++counts.skipped;
    else
      to_do.push_back(frame);
  }
  Progress progress(to_do.size(), arguments.quiet);
  if (plan->sinks().empty())
    progress.warn("the graph writes nothing: add a node such as write_mesh");
  else
    for (const std::string& line : unused_nodes(*plan)) progress.warn(line);
  Figures figures(stats, reports, progress);
  evaluator.evaluate_frames(to_do, outputs, true, [&](FrameResult result) {
    ++(result.error ? counts.failed : counts.good);
    figures.add(evaluator, result, outputs);
    progress.frame_done(result);
  });
  figures.finish();
  progress.end_line();
  if (!arguments.quiet) print_summary(arguments, evaluator, counts, progress.seconds(), stats.path());
  if (!arguments.quiet && progress.without_contact())
    fmt::print("nothing touched the body in any of these frames: are body and colliders of one size, and does the motion lead to the body?\n");
  if (interrupted() && counts.good + counts.failed + counts.skipped < frames.size()) {
    spdlog::error("interrupted: {} of {} frames are complete; the same command with --resume goes on from here", counts.good + counts.skipped,
                  frames.size());
    return kInterrupted;
  }
  if (arguments.sheet)
    for (const std::string& sheet : write_sheets(*plan, frames))
      if (!arguments.quiet) fmt::print("contact sheet: {}\n", sheet);
  return counts.failed || !figures.good() ? kFrameFailed : kGood;
}

}  // namespace knead::app
