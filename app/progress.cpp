#include "app/progress.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>

namespace knead::app {
namespace {

bool is_terminal() {
  const char* kind = std::getenv("TERM");
  return ::isatty(STDOUT_FILENO) && kind && std::strcmp(kind, "dumb") != 0;
}

}  // namespace

std::string duration_text(double seconds) {
  const auto whole = static_cast<int64_t>(std::llround(std::min(seconds, 1e9)));
  if (whole < 60) return fmt::format("{} s", whole);
  if (whole < 3600) return fmt::format("{} min {} s", whole / 60, whole % 60);
  return fmt::format("{} h {} min", whole / 3600, whole % 3600 / 60);
}

Progress::Progress(size_t frames, bool quiet)
    : frames_(frames), quiet_(quiet), live_(!quiet && is_terminal()), start_(std::chrono::steady_clock::now()), drawn_(start_) {
  if (live_) draw_line();
}

Progress::~Progress() {
  end_line();
}

double Progress::seconds() const {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
}

void Progress::frame_done(const FrameResult& result, const std::string& ended) {
  ++done_;
  for (const std::string& warning : result.warnings) warn(warning);
  if (result.error) error(fmt::format("frame {}: {}", result.frame, result.error->what()));
  if (live_) {
    const auto now = std::chrono::steady_clock::now();
    if (done_ == frames_ || now - drawn_ > std::chrono::milliseconds(50)) draw_line();
  } else if (!quiet_ && !result.error) {
    fmt::print("frame {}: {:.3f} s{}{}  ({} of {})\n", result.frame, result.seconds, ended.empty() ? "" : ", ", ended, done_, frames_);
    std::fflush(stdout);
  }
}

void Progress::warn(const std::string& message) {
  if (!warned_.insert(message).second) return;
  clear_line();
  spdlog::warn("{}", message);
}

void Progress::error(const std::string& message) {
  clear_line();
  spdlog::error("{}", message);
}

void Progress::clear_line() {
  if (width_ == 0) return;
  fmt::print("\r{:{}}\r", "", width_);
  std::fflush(stdout);
  width_ = 0;
}

void Progress::draw_line() {
  drawn_ = std::chrono::steady_clock::now();
  std::string line = fmt::format("{} of {} frames", done_, frames_);
  if (const double passed = seconds(); done_ > 0 && passed > 0) {
    const double rate = static_cast<double>(done_) / passed;
    line += fmt::format(", {:.1f} frames/s, {} left", rate, duration_text(static_cast<double>(frames_ - done_) / rate));
  }
  fmt::print("\r{:{}}", line, width_);
  std::fflush(stdout);
  width_ = std::max(width_, line.size());
}

void Progress::end_line() {
  if (width_ == 0) return;
  fmt::print("\n");
  width_ = 0;
}

}  // namespace knead::app
