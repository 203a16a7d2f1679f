#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <utility>

#include "io/files.h"
#include "io/stats.h"

namespace knead {
namespace {

bool is_among(const WrittenFile& file, const std::vector<WrittenFile>& files) {
  return std::any_of(files.begin(), files.end(), [&](const WrittenFile& other) { return other.path == file.path; });
}

bool replaces(const FrameRecord& newer, const FrameRecord& older) {
  if (newer.frame != older.frame) return false;
  if (older.version == 0 || (newer.graph == older.graph && newer.only == older.only)) return true;
  return !older.files.empty() &&
         std::all_of(older.files.begin(), older.files.end(), [&](const WrittenFile& file) { return is_among(file, newer.files); });
}

struct Line {
  std::string text;
  FrameRecord record;
};

// The whole lines of a text without those that later ones replace, by frame; what is no line of ours stands first.
std::vector<Line> lines_of(const std::string& text) {
  std::vector<Line> foreign, lines;
  for (size_t start = 0; start < text.size();) {
    const size_t end = std::min(text.find('\n', start), text.size());
    Line line{text.substr(start, end - start), {}};
    start = end + 1;
    if (read_stats_line(line.text, line.record)) {
      std::erase_if(lines, [&](const Line& older) { return replaces(line.record, older.record); });
      lines.push_back(std::move(line));
    } else if (end < text.size() && !line.text.empty() && line.text.front() == '{' && line.text.back() == '}') {
      foreign.push_back(std::move(line));
    }
  }
  std::stable_sort(lines.begin(), lines.end(), [](const Line& a, const Line& b) { return a.record.frame < b.record.frame; });
  foreign.insert(foreign.end(), std::make_move_iterator(lines.begin()), std::make_move_iterator(lines.end()));
  return foreign;
}

}  // namespace

// Keeps other processes out of the file. `finish` gives the name to another file, so that whoever waited for the old one looks again. On a file
// system without locks the appended lines are still whole, for each is one write.
class StatsFile::Lock {
 public:
  explicit Lock(StatsFile& stats) : stats_(stats) {
    if (!stats.is_regular_) return;
    for (;;) {
      int result;
      do result = ::flock(stats.file_, LOCK_EX);
      while (result != 0 && errno == EINTR);
      struct stat mine {
      }, named{};
      if (::fstat(stats.file_, &mine) != 0) stats.fail("read", errno);
      if (::stat(stats.path_.c_str(), &named) == 0 && named.st_ino == mine.st_ino && named.st_dev == mine.st_dev) return;
      ::close(std::exchange(stats.file_, -1));
      stats.open();
    }
  }
  ~Lock() {
    if (stats_.is_regular_ && stats_.file_ >= 0) ::flock(stats_.file_, LOCK_UN);
  }
  Lock(const Lock&) = delete;

 private:
  StatsFile& stats_;
};

StatsFile::StatsFile(std::string path) : path_(std::move(path)) {
  namespace fs = std::filesystem;
  std::error_code failed;
  const fs::path folder = fs::path(path_).parent_path();
  if (!folder.empty()) fs::create_directories(folder, failed);
  if (failed) fail("written", failed.value());
  if (fs::is_regular_file(path_, failed))
    for (Line& line : lines_of(read_whole_file(path_))) earlier_.push_back(std::move(line.record));
  open();
  struct stat status {};
  is_regular_ = ::fstat(file_, &status) == 0 && S_ISREG(status.st_mode);
}

StatsFile::~StatsFile() {
  if (file_ >= 0) ::close(file_);
}

void StatsFile::open() {
  file_ = ::open(path_.c_str(), O_RDWR | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
  if (file_ < 0) file_ = ::open(path_.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666);  // a pipe or a device may be for writing alone
  if (file_ < 0) fail("written", errno);
}

void StatsFile::fail(const char* doing, int error) const {
  throw Error(ErrorCode::kFile, in_file(path_), std::string("the figures cannot be ") + doing + ": " + std::strerror(error),
              "name another file with --stats");
}

std::vector<FrameRecord> StatsFile::earlier(int frame) const {
  std::vector<FrameRecord> records;
  std::copy_if(earlier_.begin(), earlier_.end(), std::back_inserter(records),
               [&](const FrameRecord& record) { return record.frame == frame && record.version > 0; });
  return records;
}

void StatsFile::add(const std::string& line) {
  const Lock lock(*this);
  const off_t before = is_regular_ ? ::lseek(file_, 0, SEEK_END) : 0;
  char last = '\n';
  if (before > 0 && ::pread(file_, &last, 1, before - 1) != 1) last = '\n';
  const std::string whole = (last == '\n' ? "" : "\n") + line + '\n';  // a line that a crash cut short must not join this one
  ssize_t written;
  do written = ::write(file_, whole.data(), whole.size());
  while (written < 0 && errno == EINTR);
  if (written == static_cast<ssize_t>(whole.size())) return;
  const int error = written < 0 ? errno : ENOSPC;
  if (is_regular_ && ::ftruncate(file_, before) != 0) fail("shortened", errno);
  fail("written", error);
}

void StatsFile::finish() {
  if (!is_regular_) return;
  const Lock lock(*this);
  std::string all;
  for (const Line& line : lines_of(read_whole_file(path_))) all += line.text + '\n';
  write_whole_file(path_, all);
}

}  // namespace knead
