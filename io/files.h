// Files: numbered names, whole reads with clear errors, and writes that are complete or absent.
#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "graph/error.h"
#include "graph/hash.h"
#include "graph/node.h"

namespace knead {

inline Where in_file(const std::string& path, int line = 0, int column = 0) {
  return {path, line, column, {}, {}};
}

// '#'s in the last component of `path` stand for the frame: each run of n becomes the frame padded with zeros to n digits ("a.####.obj", 7:
// "a.0007.obj"; -7: "a.-0007.obj"; more digits than '#'s are kept). `\#` stands for the character '#' itself: "take\#2.##.obj" is "take#2.07.obj" in
// frame 7. Folders are never touched, so that "C#/a.obj" is no pattern.
KNEAD_API std::string frame_path(const std::string& path, int frame);
KNEAD_API bool has_frame_pattern(const std::string& path);

// The path that `path` stands for in the context's frame. Asks for the frame only where the path depends on it.
std::string path_in_frame(const std::string& path, const Context& context);

// The bytes of a file. Throws Error(kFile) that names the path: missing (with the nearest existing name), unreadable, or a directory.
KNEAD_API std::string read_whole_file(const std::string& path);

// Hash of a file's bytes, remembered by path, time, size and inode, so that asking again costs one stat. Thread-safe. Throws as read_whole_file.
KNEAD_API Key file_content_key(const std::string& path);

// A file that appears under its name when `commit` is called, and not before: it is written under a temporary name in the same folder, synced and
// renamed. Without commit nothing is left behind. Missing folders are made. Every failure (no permission, full disk) throws Error(kFile) that names
// the path. Devices and pipes (/dev/stdout) are written to directly.
class KNEAD_API WholeFile {
 public:
  explicit WholeFile(std::string path);
  ~WholeFile();
  WholeFile(const WholeFile&) = delete;
  WholeFile& operator=(const WholeFile&) = delete;

  void write(std::string_view bytes);
  void commit();
  const std::string& path() const { return path_; }
  // Where the bytes go until then, for libraries that open files by themselves (they must write to this name and close it; call `close` first).
  const std::string& temporary_path() const { return temporary_; }
  void close();

 private:
  [[noreturn]] void fail(const char* doing, int error) const;
  void flush();

  std::string path_;
  std::string temporary_;  // empty when writing to a device
  std::string pending_;
  int file_ = -1;
  bool committed_ = false;
};

// Removes what every WholeFile of this process has written and not yet committed. For a process that ends at once: any use of a WholeFile afterwards
// waits for ever.
KNEAD_API void abandon_whole_files();

// A file made whole in one call.
KNEAD_API void write_whole_file(const std::string& path, std::string_view bytes);

}  // namespace knead
