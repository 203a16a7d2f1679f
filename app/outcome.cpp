#include "app/outcome.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "app/common.h"

namespace knead::app {
namespace {

constexpr size_t kNodesNamed = 5;

// "solid 1.21, tets 0.52 and 3 others 0.02", the longest first.
std::string longest(const std::map<std::string, double>& seconds) {
  std::vector<std::pair<std::string, double>> nodes(seconds.begin(), seconds.end());
  std::stable_sort(nodes.begin(), nodes.end(), [](const auto& a, const auto& b) { return a.second > b.second; });
  const size_t named = nodes.size() > kNodesNamed + 1 ? kNodesNamed : nodes.size();
  std::string text;
  double others = 0;
  for (size_t i = 0; i < nodes.size(); ++i) {
    if (i < named)
      text += fmt::format("{}{} {:.2f}", text.empty() ? "" : ", ", nodes[i].first, nodes[i].second);
    else
      others += nodes[i].second;
  }
  if (named < nodes.size()) text += fmt::format(" and {} others {:.2f}", nodes.size() - named, others);
  return text;
}

}  // namespace

void Outcome::add_good(int frame, const Verdict& verdict) {
  ++good_;
  judge(frame, verdict);
}

void Outcome::add_skipped(int frame, const Verdict& verdict) {
  ++skipped_;
  judge(frame, verdict);
}

void Outcome::judge(int frame, const Verdict& verdict) {
  if (!verdict.restless.empty()) restless_.push_back(frame);
  if (verdict.warned) warned_.push_back(frame);
  if (!verdict.touched || verdict.enclosed)
    ++untold_;
  else
    ++(*verdict.touched ? touched_ : untouched_);
  for (const std::string& objection : strict_.objections(verdict)) objections_.push_back(fmt::format("--strict: frame {}: {}", frame, objection));
}

std::vector<std::string> Outcome::objections() const {
  std::vector<std::string> all = objections_;
  if (complete() > 0)
    for (const std::string& figure : strict_.unknown_figures()) all.push_back(fmt::format("--strict: no node tells a figure '{}'", figure));
  return all;
}

std::string Outcome::text() const {
  std::string text;
  const auto add = [&](const std::vector<int>& frames, const char* what) {
    if (frames.empty()) return;
    text += fmt::format("{}{} {} ({})", text.empty() ? "" : ", ", text.empty() ? counted(frames.size(), "frame") : std::to_string(frames.size()),
                        what, frames_text(frames));
  };
  add(failed_, "failed");
  add(restless_, "did not come to rest");
  add(warned_, warned_.size() == 1 ? "carries warnings" : "carry warnings");
  return text;
}

std::string times_text(const EvaluatorFigures& figures, const RunTimes& times) {
  const double set_up = std::min(figures.set_up_seconds, times.frames), frames = times.frames - set_up;
  std::string text = fmt::format("time: {:.2f} s = {:.2f} reading + {:.2f} set-up + {:.2f} frames + {:.2f} closing\n", times.total, times.reading,
                                 set_up, frames, std::max(0.0, times.total - times.reading - times.frames));
  std::map<std::string, double> in_frames;
  for (const auto& [name, seconds] : figures.seconds) {
    const auto once = figures.set_up.find(name);
    const double rest = seconds - (once == figures.set_up.end() ? 0 : once->second);
    if (rest > 1e-6) in_frames[name] = rest;
  }
  if (!figures.set_up.empty()) text += fmt::format("  set-up by node: {}\n", longest(figures.set_up));
  if (!in_frames.empty()) text += fmt::format("  frames by node: {}\n", longest(in_frames));
  return text;
}

}  // namespace knead::app
