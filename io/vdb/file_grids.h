// Internal to io/vdb. What a .vdb or .nvdb file holds, grid by grid, before one of them is chosen: a grid that cannot be read does not refuse its file.
#pragma once
#include <fmt/format.h>
#include <openvdb/openvdb.h>

#include <string>
#include <vector>

#include "graph/error.h"
#include "io/files.h"

namespace knead::openvdb_side {

struct FileGrid {
  std::string name;              // as a user writes it; of a second grid called 'tool': 'tool[1]'
  openvdb::FloatGrid::Ptr grid;  // null where `refusal` says why
  std::string refusal;           // "holds vec3s, not float or double", as the rest of a sentence about the grid
  bool strange = false;          // of a kind that is unknown or damaged: whoever steps over this grid says so
};

struct FileGrids {
  std::vector<FileGrid> grids;        // in the file's order
  std::vector<std::string> warnings;  // about the file
};

// Both throw Error(kFile) where the file as a whole cannot be understood.
FileGrids read_openvdb_file(const std::string& path);
FileGrids read_nanovdb_file(const std::string& path);

// A level set ready to be sampled: the right grid of `file`, with signs, a band and voxels numbered from near 0.
struct LevelSet {
  openvdb::FloatGrid::Ptr grid;
  openvdb::Vec3d shift{0, 0, 0};  // what was taken off every voxel's index
  double band = 0;                // outside, world units; the background may be wider
};
LevelSet choose_level_set(FileGrids file, const std::string& path, const std::string& name, std::vector<std::string>& warnings);

[[noreturn]] inline void fail(const std::string& path, const std::string& message, const std::string& hint = {}) {
  throw Error(ErrorCode::kFile, in_file(path), message, hint);
}

// A file's bytes from front to back. Throws std::runtime_error where they end too soon.
class ByteReader {
 public:
  explicit ByteReader(std::string_view bytes, size_t at = 0) : bytes_(bytes), at_(at) {}
  template <class T>
  T take() {
    T value;
    const std::string_view from = take(sizeof value);
    std::copy(from.begin(), from.end(), reinterpret_cast<char*>(&value));
    return value;
  }
  std::string_view take(size_t size) {
    if (at_ > bytes_.size() || size > bytes_.size() - at_) throw std::runtime_error("the file ends too soon");
    at_ += size;
    return bytes_.substr(at_ - size, size);
  }
  std::string text() { return std::string(take(take<uint32_t>())); }  // as OpenVDB writes it
  size_t at() const { return at_; }
  size_t left() const { return bytes_.size() - at_; }

 private:
  std::string_view bytes_;
  size_t at_;
};

}  // namespace knead::openvdb_side
