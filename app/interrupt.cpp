#include "app/interrupt.h"

#include <fcntl.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <csignal>
#include <cstdio>
#include <mutex>
#include <thread>
#include <utility>

#include "app/commands.h"
#include "io/files.h"

namespace knead::app {
namespace {

// A signal is answered within 0.2 s. Most nodes end in far less; what remains is for the end of the process itself.
constexpr std::chrono::milliseconds kPatience{50}, kPatienceWithLines{30};

std::atomic<bool> asked{false};
static_assert(std::atomic<bool>::is_always_lock_free);
int pipe_ends[2] = {-1, -1};

void ask(int) {
  asked.store(true, std::memory_order_relaxed);
  [[maybe_unused]] const ssize_t written = ::write(pipe_ends[1], "!", 1);
}

// Waits for a signal, then for the run to end by itself, then no longer.
class Watch {
 public:
  Watch(std::function<bool()> is_done, std::function<void()> last_words)
      : is_done_(std::move(is_done)), last_words_(std::move(last_words)), thread_([this] { run(); }) {}

  void end() {
    {
      const std::lock_guard lock(mutex_);
      ended_ = true;
    }
    changed_.notify_all();
    [[maybe_unused]] const ssize_t written = ::write(pipe_ends[1], "!", 1);
    thread_.join();
  }

 private:
  void run() {
    for (char byte; ::read(pipe_ends[0], &byte, 1) < 0;) {
    }
    std::unique_lock lock(mutex_);
    if (changed_.wait_for(lock, kPatience, [&] { return ended_; })) return;
    if (is_done_()) return;
    abandon_whole_files();
    if (changed_.wait_for(lock, kPatienceWithLines, [&] { return ended_; })) return;  // frames whose files are there get their lines
    last_words_();
    std::fflush(stdout);
    ::_exit(kInterrupted);
  }

  std::function<bool()> is_done_;
  std::function<void()> last_words_;
  std::mutex mutex_;
  std::condition_variable changed_;
  bool ended_ = false;
  std::thread thread_;
};

Watch* watch = nullptr;

}  // namespace

void catch_interrupts(std::function<bool()> is_done, std::function<void()> last_words) {
  if (watch || ::pipe2(pipe_ends, O_CLOEXEC) != 0) return;
  watch = new Watch(std::move(is_done), std::move(last_words));
  struct sigaction action {};
  action.sa_handler = ask;
  action.sa_flags = SA_RESTART;
  sigemptyset(&action.sa_mask);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
    struct sigaction before {};
    // What the caller ignores (nohup) stays ignored.
    if (sigaction(signal, nullptr, &before) == 0 && before.sa_handler != SIG_IGN) sigaction(signal, &action, nullptr);
  }
  // Writes that cannot be made then fail with an error, and nothing is left half written.
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);
}

void end_interrupts() {
  if (!watch) return;
  watch->end();
  delete std::exchange(watch, nullptr);
}

bool interrupted() {
  return asked.load(std::memory_order_relaxed);
}

}  // namespace knead::app
