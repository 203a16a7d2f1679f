// .vdb files. OpenVDB reads a file as a whole or not at all: one grid of an unknown type, and nothing can be had of the others. So the directory of the file
// is read here, and OpenVDB is shown one grid at a time.
#include <openvdb/io/Stream.h>

#include <map>
#include <sstream>

#include "graph/cancel.h"
#include "io/vdb/file_grids.h"

namespace knead::openvdb_side {
namespace {

constexpr uint32_t kOldest = openvdb::OPENVDB_FILE_VERSION_NODE_MASK_COMPRESSION;  // whose directory is understood here
constexpr uint32_t kNewest = openvdb::OPENVDB_FILE_VERSION;

struct Directory {
  uint32_t version = 0;
  std::string head;  // up to the count of grids, with a version that OpenVDB takes without a word of its own
  int32_t count = 0;
  size_t first = 0;  // where the grids begin
};

Directory read_directory(std::string_view bytes) {
  ByteReader reader(bytes);
  Directory directory;
  if (reader.take<int64_t>() != openvdb::OPENVDB_MAGIC) throw std::runtime_error("not a VDB file");
  directory.version = reader.take<uint32_t>();
  if (directory.version < kOldest) return directory;
  reader.take(2 * sizeof(uint32_t) + 1 + 36);  // the library's version, whether positions follow, a UUID
  const uint32_t metadata = reader.take<uint32_t>();
  for (uint32_t n = 0; n < metadata; ++n) {
    reader.text();
    reader.text();
    reader.text();  // name, type, value
  }
  directory.head = std::string(bytes.substr(0, reader.at()));
  const uint32_t taken = std::min(directory.version, kNewest);
  directory.head.replace(sizeof(int64_t), sizeof taken, reinterpret_cast<const char*>(&taken), sizeof taken);
  directory.count = reader.take<int32_t>();
  directory.first = reader.at();
  return directory;
}

// "tool" for the first grid of that name, "tool[1]" for the next.
std::string shown_name(const std::string& unique) {
  const size_t at = unique.find('\x1e');
  return at == std::string::npos ? unique : unique.substr(0, at) + "[" + unique.substr(at + 1) + "]";
}

void take_grid(const openvdb::GridBase::Ptr& grid, FileGrid& to) {
  if (auto same = openvdb::gridPtrCast<openvdb::FloatGrid>(grid)) {
    to.grid = same;
  } else if (auto wide = openvdb::gridPtrCast<openvdb::DoubleGrid>(grid)) {
    to.grid = std::make_shared<openvdb::FloatGrid>(*wide);
  } else {
    to.refusal = fmt::format("holds {}, not float or double", grid->valueType());
  }
}

// OpenVDB knows no interrupter for reading: what it reads from says that nobody waits for it any more.
class CancellableBytes : public std::stringbuf {
 public:
  explicit CancellableBytes(std::string bytes) : std::stringbuf(std::move(bytes), std::ios::in) {}

 protected:
  std::streamsize xsgetn(char* to, std::streamsize count) override {
    check_cancelled();
    return std::stringbuf::xsgetn(to, count);
  }
};

openvdb::GridPtrVecPtr grids_of(std::istream& stream) {
  stream.exceptions(std::ios::badbit);  // else it keeps the buffer's exceptions to itself
  return openvdb::io::Stream(stream, false).getGrids();
}

class GridsInTurn {
 public:
  GridsInTurn(std::string_view bytes, Directory directory) : bytes_(bytes), directory_(std::move(directory)), next_(directory_.first) {}

  FileGrids read() {
    FileGrids file;
    for (int32_t n = 0; n < directory_.count && next_ != 0; ++n) file.grids.push_back(read_next());
    if (next_ == 0 && file.grids.size() < static_cast<size_t>(directory_.count))
      file.warnings.push_back(fmt::format("what follows grid '{}' cannot be reached: the file does not say where it begins", file.grids.back().name));
    return file;
  }

 private:
  FileGrid read_next() {
    const size_t begin = next_;
    ByteReader reader(bytes_, begin);
    const std::string unique = reader.text();
    std::string type = reader.text();
    const std::string parent = reader.text();
    reader.take(2 * sizeof(int64_t));
    const int64_t end = reader.take<int64_t>();
    const bool ends = end > static_cast<int64_t>(reader.at()) && static_cast<uint64_t>(end) <= bytes_.size();
    next_ = ends ? static_cast<size_t>(end) : 0;
    if (ends) parts_[unique] = bytes_.substr(begin, next_ - begin);
    FileGrid found;
    found.name = shown_name(unique);
    constexpr std::string_view kHalf = "_HalfFloat";
    if (type.ends_with(kHalf)) type.resize(type.size() - kHalf.size());
    if (!openvdb::GridBase::isRegistered(type)) {
      found.refusal = fmt::format("is of a type that is unknown here ({})", type);
      found.strange = true;
      return found;
    }
    const bool scalar = type == openvdb::FloatGrid::gridType() || type == openvdb::DoubleGrid::gridType();
    if (!scalar && ends) {
      found.refusal = fmt::format("holds {}, not float or double", openvdb::GridBase::createGrid(type)->valueType());
      return found;
    }
    read_with_openvdb(begin, unique, parent, found);
    return found;
  }

  void read_with_openvdb(size_t begin, const std::string& unique, const std::string& parent, FileGrid& found) {
    const bool shares = !parent.empty() && parts_.count(parent) != 0;
    std::string shown = directory_.head;
    const int32_t count = shares ? 2 : 1;
    shown.append(reinterpret_cast<const char*>(&count), sizeof count);
    if (shares) shown += parts_[parent];
    const size_t before = shown.size();
    shown += bytes_.substr(begin, next_ == 0 ? std::string_view::npos : next_ - begin);
    CancellableBytes buffer(std::move(shown));
    std::istream stream(&buffer);
    try {
      const openvdb::GridPtrVecPtr grids = grids_of(stream);
      take_grid(grids->back(), found);
      if (next_ == 0 && stream.good()) next_ = begin + (static_cast<size_t>(stream.tellg()) - before);
      parts_[unique] = bytes_.substr(begin, next_ - begin);
    } catch (const Error&) {
      throw;
    } catch (const std::exception& e) {
      found.refusal = std::string("cannot be read: ") + e.what();
      found.strange = true;
    }
  }

  std::string_view bytes_;
  Directory directory_;
  size_t next_;                                    // where the next grid begins; 0: nobody knows
  std::map<std::string, std::string_view> parts_;  // by unique name: other grids may share their trees
};

FileGrids read_old(std::string bytes) {
  CancellableBytes buffer(std::move(bytes));
  std::istream stream(&buffer);
  FileGrids file;
  const openvdb::GridPtrVecPtr grids = grids_of(stream);
  for (const openvdb::GridBase::Ptr& grid : *grids) {
    file.grids.push_back({grid->getName(), nullptr, {}});
    take_grid(grid, file.grids.back());
  }
  return file;
}

}  // namespace

FileGrids read_openvdb_file(const std::string& path) {
  std::string bytes = read_whole_file(path);
  uint32_t version = 0;
  try {
    Directory directory = read_directory(bytes);
    version = directory.version;
    if (version < kOldest) return read_old(std::move(bytes));
    FileGrids file = GridsInTurn(bytes, std::move(directory)).read();
    if (version > kNewest)
      file.warnings.push_back(fmt::format("the file's format is {}, newer than the {} that is known: read as if it were that", version, kNewest));
    return file;
  } catch (const Error&) {
    throw;
  } catch (const std::exception& e) {
    fail(path, std::string("not a readable .vdb file: ") + e.what(),
         fmt::format("write it again; format {} and older is understood, which OpenVDB 10 to 13 write", kNewest));
  }
}

}  // namespace knead::openvdb_side
