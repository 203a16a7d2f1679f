#include "io/files.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <map>
#include <mutex>
#include <new>
#include <set>
#include <utility>

namespace knead {
namespace fs = std::filesystem;

namespace {

constexpr size_t kWriteChunk = size_t{1} << 20;

std::string reason(int error) {
  switch (error) {
    case EACCES:
    case EPERM: return "permission denied";
    case ENOSPC: return "no space left on the device";
    case EDQUOT: return "the disk quota is used up";
    case EFBIG: return "the file would be larger than this process may write";
    case EROFS: return "the file system is read-only";
    case ENOTDIR: return "a part of the path is a file, not a folder";
    case EISDIR: return "it is a folder";
    case ENAMETOOLONG: return "the name is too long";
    case EMFILE:
    case ENFILE: return "too many files are open";
    case ENOENT: return "no such file or folder";
    case EIO: return "input/output error";
  }
  return "system error " + std::to_string(error);
}

std::string remedy_for_writing(int error) {
  switch (error) {
    case EACCES:
    case EPERM:
    case EROFS: return "choose a folder that you may write to";
    case ENOSPC:
    case EDQUOT: return "free some space or choose another disk";
    case EFBIG: return "raise the limit (ulimit -f)";
  }
  return "check the path";
}

[[noreturn]] void throw_missing(const std::string& path) {
  const fs::path wanted(path);
  const fs::path folder = wanted.parent_path().empty() ? fs::path(".") : wanted.parent_path();
  std::error_code ignored;
  if (!fs::is_directory(folder, ignored))
    throw Error(ErrorCode::kFile, in_file(path), "no such file: there is no folder '" + folder.string() + "'",
                "relative paths count from the graph file's folder");
  std::vector<std::string> names;
  for (fs::directory_iterator it(folder, ignored), end; !ignored && it != end; it.increment(ignored)) names.push_back(it->path().filename().string());
  std::sort(names.begin(), names.end());
  const std::string nearest = nearest_name(wanted.filename().string(), names);
  throw Error(ErrorCode::kFile, in_file(path), "no such file", nearest.empty() ? "check the path" : "did you mean '" + nearest + "'?");
}

[[noreturn]] void throw_unreadable(const std::string& path, int error) {
  if (error == ENOENT) throw_missing(path);
  throw Error(ErrorCode::kFile, in_file(path), "cannot be read: " + reason(error),
              error == EISDIR ? "name a file inside it" : "check the path and its permissions");
}

class OpenFile {
 public:
  explicit OpenFile(const std::string& path) : file_(::open(path.c_str(), O_RDONLY | O_CLOEXEC)) {
    if (file_ < 0) throw_unreadable(path, errno);
    if (::fstat(file_, &status_) != 0) throw_unreadable(path, errno);
    if (S_ISDIR(status_.st_mode)) throw_unreadable(path, EISDIR);
  }
  ~OpenFile() {
    if (file_ >= 0) ::close(file_);
  }
  OpenFile(const OpenFile&) = delete;
  int get() const { return file_; }
  const struct stat& status() const { return status_; }

 private:
  int file_;
  struct stat status_ {};
};

struct FileStamp {
  int64_t seconds = 0, nanoseconds = 0;
  uint64_t size = 0, inode = 0, device = 0;
  friend bool operator==(const FileStamp&, const FileStamp&) = default;
};

FileStamp stamp_of(const struct stat& status) {
  return {status.st_mtim.tv_sec, status.st_mtim.tv_nsec, static_cast<uint64_t>(status.st_size), static_cast<uint64_t>(status.st_ino),
          static_cast<uint64_t>(status.st_dev)};
}

std::string read_all(const OpenFile& file, const std::string& path) {
  std::string bytes;
  try {
    size_t used = 0;
    bytes.resize(S_ISREG(file.status().st_mode) ? static_cast<size_t>(file.status().st_size) + 1 : kWriteChunk);
    for (;;) {
      if (used == bytes.size()) bytes.resize(bytes.size() * 2);
      const ssize_t got = ::read(file.get(), bytes.data() + used, bytes.size() - used);
      if (got < 0 && errno == EINTR) continue;
      if (got < 0) throw_unreadable(path, errno);
      if (got == 0) break;
      used += static_cast<size_t>(got);
    }
    bytes.resize(used);
  } catch (const std::bad_alloc&) {
    throw Error(ErrorCode::kMemory, in_file(path), "is too large to be read (" + std::to_string(file.status().st_size) + " bytes)");
  }
  return bytes;
}

bool is_escaped_hash(const std::string& path, size_t at) {
  return path.compare(at, 2, "\\#") == 0;
}

size_t name_start(const std::string& path) {
  const size_t slash = path.rfind('/');
  return slash == std::string::npos ? 0 : slash + 1;
}

}  // namespace

bool has_frame_pattern(const std::string& path) {
  for (size_t at = name_start(path); at < path.size(); ++at) {
    if (path[at] == '#') return true;
    if (is_escaped_hash(path, at)) ++at;
  }
  return false;
}

std::string frame_path(const std::string& path, int frame) {
  const std::string digits = std::to_string(std::llabs(static_cast<long long>(frame)));
  size_t at = name_start(path);
  std::string result = path.substr(0, at);
  while (at < path.size()) {
    if (path[at] != '#') {
      at += is_escaped_hash(path, at);
      result += path[at++];
      continue;
    }
    const size_t run = std::min(path.find_first_not_of('#', at), path.size()) - at;
    if (frame < 0) result += '-';
    if (digits.size() < run) result.append(run - digits.size(), '0');
    result += digits;
    at += run;
  }
  return result;
}

std::string path_in_frame(const std::string& path, const Context& context) {
  return frame_path(path, has_frame_pattern(path) ? context.frame() : 0);
}

std::string read_whole_file(const std::string& path) {
  return read_all(OpenFile(path), path);
}

Key file_content_key(const std::string& path) {
  static std::mutex mutex;
  static std::map<std::string, std::pair<FileStamp, Key>> known;
  // Inputs are read once for their key and once for their contents, which a pipe cannot give; opening one without a writer would wait for ever.
  if (struct stat status{}; ::stat(path.c_str(), &status) == 0 && (S_ISFIFO(status.st_mode) || S_ISSOCK(status.st_mode)))
    throw Error(ErrorCode::kFile, in_file(path), "cannot be read: it is a pipe", "save what it gives as a file");
  const OpenFile file(path);
  const FileStamp stamp = stamp_of(file.status());
  const bool regular = S_ISREG(file.status().st_mode);
  if (regular) {
    const std::lock_guard lock(mutex);
    const auto it = known.find(path);
    if (it != known.end() && it->second.first == stamp) return it->second.second;
  }
  const std::string bytes = read_all(file, path);
  const Key key = Hasher().add(bytes).key();
  struct stat after {};
  // A file that changes while it is read, or that was written within the clock's grain of now, is hashed again next time.
  if (regular && ::fstat(file.get(), &after) == 0 && stamp_of(after) == stamp) {
    struct timespec now {};
    ::clock_gettime(CLOCK_REALTIME, &now);
    const double age = static_cast<double>(now.tv_sec - stamp.seconds) + 1e-9 * static_cast<double>(now.tv_nsec - stamp.nanoseconds);
    const std::lock_guard lock(mutex);
    if (age > 0.05) known[path] = {stamp, key};
  }
  return key;
}

namespace {

// Temporary names of files that are being written.
class Unfinished {
 public:
  void add(const std::string& path) {
    const std::lock_guard lock(mutex_);
    paths_.insert(path);
  }
  void remove(const std::string& path) {
    const std::lock_guard lock(mutex_);
    paths_.erase(path);
  }
  bool publish(const std::string& path, const std::string& target) {
    const std::lock_guard lock(mutex_);
    paths_.erase(path);
    return ::rename(path.c_str(), target.c_str()) == 0;
  }
  void abandon() {
    mutex_.lock();  // and never unlocked
    for (const std::string& path : paths_) ::unlink(path.c_str());
  }

 private:
  std::mutex mutex_;
  std::set<std::string> paths_;
};

Unfinished& unfinished() {
  static Unfinished* const files = new Unfinished;  // outlives the files that others keep to the end of the process
  return *files;
}

}  // namespace

void abandon_whole_files() {
  unfinished().abandon();
}

WholeFile::WholeFile(std::string path) : path_(std::move(path)) {
  static std::atomic<uint64_t> counter{0};
  std::error_code error;
  const fs::path wanted(path_);
  if (path_.empty()) throw Error(ErrorCode::kFile, "a file to be written has no name", "give a path");
  if (!wanted.has_filename()) fail("written", EISDIR);
  const fs::file_status status = fs::status(wanted, error);
  if (fs::is_directory(status)) fail("written", EISDIR);
  if (fs::exists(status) && !fs::is_regular_file(status)) {
    file_ = ::open(path_.c_str(), O_WRONLY | O_CLOEXEC);
    if (file_ < 0) fail("opened for writing", errno);
    return;
  }
  // Writing through a symbolic link replaces what it points to, not the link.
  const fs::path target = fs::is_symlink(fs::symlink_status(wanted, error)) && fs::exists(status) ? fs::canonical(wanted, error) : wanted;
  if (const fs::path folder = target.parent_path(); !folder.empty()) {
    fs::create_directories(folder, error);
    if (error) fail("written: its folder cannot be made", error.value());
  }
  const std::string suffix =
      std::string(".") + std::to_string(::getpid()) + std::string(".") + std::to_string(counter.fetch_add(1)) + std::string(".part");
  temporary_ = (target.parent_path() / (std::string(".") + target.filename().string().substr(0, 200) + suffix)).string();
  unfinished().add(temporary_);
  file_ = ::open(temporary_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  if (file_ < 0) {
    const int reason_number = errno;
    unfinished().remove(temporary_);
    temporary_.clear();
    fail("written", reason_number);
  }
}

WholeFile::~WholeFile() {
  if (file_ >= 0) ::close(file_);
  if (!committed_ && !temporary_.empty()) ::unlink(temporary_.c_str());
  if (!committed_ && !temporary_.empty()) unfinished().remove(temporary_);
}

void WholeFile::fail(const char* doing, int error) const {
  throw Error(ErrorCode::kFile, in_file(path_), std::string("cannot be ") + doing + ": " + reason(error), remedy_for_writing(error));
}

void WholeFile::flush() {
  size_t done = 0;
  while (done < pending_.size()) {
    const ssize_t put = ::write(file_, pending_.data() + done, pending_.size() - done);
    if (put < 0 && errno == EINTR) continue;
    if (put <= 0) fail("written", put < 0 ? errno : EIO);
    done += static_cast<size_t>(put);
  }
  pending_.clear();
}

void WholeFile::write(std::string_view bytes) {
  if (file_ < 0) throw Error(ErrorCode::kInternal, in_file(path_), "is written to after it was closed");
  while (!bytes.empty()) {
    const size_t part = std::min(bytes.size(), kWriteChunk - std::min(pending_.size(), kWriteChunk));
    pending_.append(bytes.substr(0, part));
    bytes.remove_prefix(part);
    if (pending_.size() >= kWriteChunk) flush();
  }
}

void WholeFile::close() {
  if (file_ < 0) return;
  flush();
  if (::close(std::exchange(file_, -1)) != 0) fail("written", errno);
}

void WholeFile::commit() {
  if (committed_) return;
  close();
  if (!temporary_.empty()) {
    const int again = ::open(temporary_.c_str(), O_RDONLY | O_CLOEXEC);  // what was written through another descriptor is synced as well
    if (again < 0) fail("written", errno);
    const bool synced = ::fsync(again) == 0;
    const int sync_error = errno;
    ::close(again);
    if (!synced) fail("written", sync_error);
    std::error_code ignored;
    const bool through_link = fs::is_symlink(fs::symlink_status(path_, ignored)) && fs::exists(path_, ignored);
    const std::string target = through_link ? fs::canonical(path_, ignored).string() : path_;
    if (!unfinished().publish(temporary_, target)) fail("written", errno);
    const std::string folder = fs::path(target).parent_path().string();
    const int directory = ::open(folder.empty() ? "." : folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (directory >= 0) {
      ::fsync(directory);  // best effort: some file systems refuse it for folders
      ::close(directory);
    }
  }
  committed_ = true;
}

void write_whole_file(const std::string& path, std::string_view bytes) {
  WholeFile file(path);
  file.write(bytes);
  file.commit();
}

}  // namespace knead
