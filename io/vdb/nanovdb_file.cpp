// .nvdb files of every NanoVDB 32. Its minor versions lay grids out alike and differ in how they sign them: magic numbers ("NanoVDB0" everywhere; since 32.6
// "NanoVDB1" for a grid, "NanoVDB2" for a file) and what the checksums are of. NanoVDB's reader here takes its own signs only, so files are read by the
// format's description (NanoVDB.h), checked here in every way that is known, and signed anew.
#include <blosc.h>
#include <nanovdb/util/NanoToOpenVDB.h>
#include <zlib.h>

#include <array>
#include <cstring>

#include "graph/buffer.h"
#include "io/vdb/file_grids.h"

namespace knead::openvdb_side {
namespace {

constexpr uint64_t kMagicOfAll = 0x304244566f6e614eull;   // "NanoVDB0"
constexpr uint64_t kMagicOfGrid = 0x314244566f6e614eull;  // "NanoVDB1"
constexpr uint64_t kMagicOfFile = 0x324244566f6e614eull;  // "NanoVDB2"
constexpr uint64_t kUnsigned = ~uint64_t{0};              // a checksum that is not there
constexpr uint32_t kUnsignedPart = ~0u;
constexpr size_t kChunk = size_t{1} << 30;  // what Blosc is given at a time
constexpr size_t kBlock = 4096;             // bytes under one sum
constexpr size_t kSigned = 16;              // where what is signed begins: behind the magic number and the checksum

struct Header {  // of a segment of a file
  uint64_t magic;
  uint32_t version;
  uint16_t grids, codec;
};

struct Entry {  // of a grid in a segment
  uint64_t size, bytes, name_hash, voxels;
  uint32_t type, grid_class;
  double world_box[6];
  int32_t index_box[6];
  double voxel_size[3];
  uint32_t name_bytes, nodes[4], tiles[3];
  uint16_t codec, padding;
  uint32_t version;
};
static_assert(sizeof(Header) == 16 && sizeof(Entry) == 176);

std::string version_text(uint32_t version) {
  return fmt::format("{}.{}.{}", version >> 21, version >> 10 & 0x7ff, version & 0x3ff);
}
bool is_32(uint32_t version) {
  return version >> 21 == NANOVDB_MAJOR_VERSION_NUMBER;
}

void check_version(uint32_t version) {
  if (!is_32(version))
    throw std::runtime_error(fmt::format("it is of NanoVDB {}, whose grids are laid out in another way than those of {}.x, which is read here",
                                         version_text(version), NANOVDB_MAJOR_VERSION_NUMBER));
}

// The bytes of the nodes level by level, upper ones first, in the order of their parents' tables; and whether all of them lie where they may.
class Nodes {
 public:
  template <class Build>
  bool find(const nanovdb::NanoGrid<Build>& grid, size_t size) {
    using Tree = nanovdb::NanoTree<Build>;
    const char* const begin = reinterpret_cast<const char*>(&grid);
    const uint64_t root_at = grid.tree().data()->mNodeOffset[3];
    constexpr size_t kRootsLeast = sizeof(nanovdb::GridData) + sizeof(nanovdb::TreeData<3>);
    if (size < kRootsLeast + sizeof(typename Tree::RootType) || root_at < sizeof(nanovdb::TreeData<3>) || root_at % 32 != 0 ||
        root_at > size - sizeof(nanovdb::GridData) - sizeof(typename Tree::RootType))
      return false;
    const auto* root = grid.tree().root().data();
    using RootData = std::remove_cv_t<std::remove_pointer_t<decltype(root)>>;
    root_end_ = sizeof(nanovdb::GridData) + root_at + sizeof(RootData);
    if (root->mTableSize > (size - root_end_) / sizeof(typename RootData::Tile)) return false;
    root_end_ += root->mTableSize * sizeof(typename RootData::Tile);
    begin_ = begin;
    size_ = size;
    std::vector<const typename Tree::Node2*> uppers;
    for (uint32_t n = 0; n < root->mTableSize; ++n)
      if (root->tile(n)->isChild() && !take(uppers, root, root->tile(n)->child, 2)) return false;
    std::vector<const typename Tree::Node1*> lowers;
    std::vector<const typename Tree::Node0*> leaves;
    return children(uppers, lowers, 1) && children(lowers, leaves, 0);
  }
  size_t root_end() const { return root_end_; }

  // The sum over the nodes' own sums, each as a word of so many bytes.
  uint32_t sum(size_t word) const {
    std::string sums;
    for (size_t level = 3; level-- > 0;)
      for (const std::string_view node : levels_[level]) {
        const uint64_t of_node = crc32_z(0, reinterpret_cast<const Bytef*>(node.data()), node.size());
        sums.append(reinterpret_cast<const char*>(&of_node), word);
      }
    return static_cast<uint32_t>(crc32_z(0, reinterpret_cast<const Bytef*>(sums.data()), sums.size()));
  }

 private:
  template <class Parent, class Node>
  bool take(std::vector<const Node*>& nodes, const Parent* parent, int64_t offset, size_t level) {
    const int64_t at = reinterpret_cast<const char*>(parent) - begin_ + offset;
    if (at < static_cast<int64_t>(root_end_) || at % 32 != 0 || at > static_cast<int64_t>(size_ - std::min(size_, sizeof(Node)))) return false;
    const Node* node = reinterpret_cast<const Node*>(begin_ + at);
    size_t bytes = sizeof(Node);
    if constexpr (std::is_same_v<typename Node::BuildType, nanovdb::FpN> && Node::LEVEL == 0) bytes = node->data()->memUsage();
    if (bytes > size_ - static_cast<size_t>(at)) return false;
    levels_[level].push_back({begin_ + at, bytes});
    nodes.push_back(node);
    return levels_[level].size() <= size_ / sizeof(Node);  // no more than there is room for: nodes may not be shared
  }
  template <class Parent, class Node>
  bool children(const std::vector<const Parent*>& parents, std::vector<const Node*>& nodes, size_t level) {
    for (const Parent* parent : parents)
      for (auto child = parent->data()->mChildMask.beginOn(); child; ++child)
        if (!take(nodes, parent->data(), parent->data()->mTable[*child].child, level)) return false;
    return true;
  }

  const char* begin_ = nullptr;
  size_t size_ = 0, root_end_ = 0;
  std::array<std::vector<std::string_view>, 3> levels_;
};

uint32_t sum_of(std::string_view bytes) {
  return static_cast<uint32_t>(crc32_z(0, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

// Of sums over blocks of 4096 bytes, of which the last one takes what is left.
uint32_t sum_of_blocks(std::string_view bytes) {
  std::vector<uint32_t> sums(bytes.size() / kBlock);
  for (size_t n = 0; n < sums.size(); ++n) sums[n] = sum_of(bytes.substr(n * kBlock, n + 1 == sums.size() ? std::string_view::npos : kBlock));
  return sum_of({reinterpret_cast<const char*>(sums.data()), sizeof(uint32_t) * sums.size()});
}

// Up to 32.6.0 the first sum is of grid, tree and root, and the second one of the nodes' sums (as words of the writer's machine); later the first is of grid
// and tree, and the second of all the rest.
bool is_signed_right(std::string_view grid, const Nodes& nodes) {
  constexpr size_t kHead = sizeof(nanovdb::GridData) + sizeof(nanovdb::TreeData<3>);
  uint64_t both;
  std::memcpy(&both, grid.data() + sizeof(uint64_t), sizeof both);
  if (both == kUnsigned || both == 0) return true;
  const uint32_t head = static_cast<uint32_t>(both), tail = static_cast<uint32_t>(both >> 32);
  const bool late = head == sum_of(grid.substr(kSigned, kHead - kSigned));
  if (!late && head != sum_of(grid.substr(kSigned, nodes.root_end() - kSigned))) return false;
  if (tail == kUnsignedPart) return true;
  return (late && tail == sum_of_blocks(grid.substr(kHead))) || tail == nodes.sum(sizeof(uint32_t)) || tail == nodes.sum(sizeof(uint64_t));
}

template <class Build>
openvdb::FloatGrid::Ptr converted(nanovdb::GridData& data, std::string_view bytes) {
  const auto& grid = reinterpret_cast<const nanovdb::NanoGrid<Build>&>(data);
  Nodes nodes;
  if (!nodes.find(grid, bytes.size()) || !is_signed_right(bytes, nodes)) throw std::runtime_error("its checksum or its structure is wrong");
  data.setLongGridNameOn(false);  // the file's directory has the name
  data.mGridName[nanovdb::GridData::MaxNameSize - 1] = 0;
  if (data.mGridClass >= nanovdb::GridClass::Staggered) data.mGridClass = nanovdb::GridClass::Unknown;
  const auto open = nanovdb::nanoToOpenVDB(grid);
  if (auto same = openvdb::gridPtrCast<openvdb::FloatGrid>(open)) return same;
  using Open = typename std::decay_t<decltype(*open)>;
  return std::make_shared<openvdb::FloatGrid>(static_cast<const Open&>(*open));
}

void read_grid(std::string_view bytes, FileGrid& to) {
  if (bytes.size() < sizeof(nanovdb::GridData) + sizeof(nanovdb::TreeData<3>)) throw std::runtime_error("it ends too soon");
  Buffer<std::byte> aligned(bytes.size());
  std::memcpy(aligned.data_for_write(), bytes.data(), bytes.size());
  auto& data = *reinterpret_cast<nanovdb::GridData*>(aligned.data_for_write());
  if (data.mMagic != kMagicOfAll && data.mMagic != kMagicOfGrid) throw std::runtime_error("it does not begin as a NanoVDB grid");
  check_version(data.mVersion.id());
  if (data.mGridSize > bytes.size()) throw std::runtime_error("it ends too soon");
  const std::string_view whole(reinterpret_cast<const char*>(&data), data.mGridSize);
  const auto type = static_cast<uint32_t>(data.mGridType);
  using nanovdb::GridType;
  switch (data.mGridType) {
    case GridType::Float: to.grid = converted<float>(data, whole); break;
    case GridType::Double: to.grid = converted<double>(data, whole); break;
    case GridType::Fp4: to.grid = converted<nanovdb::Fp4>(data, whole); break;
    case GridType::Fp8: to.grid = converted<nanovdb::Fp8>(data, whole); break;
    case GridType::Fp16: to.grid = converted<nanovdb::Fp16>(data, whole); break;
    case GridType::FpN: to.grid = converted<nanovdb::FpN>(data, whole); break;
    default:
      to.strange = data.mGridType >= GridType::End;
      to.refusal = to.strange ? fmt::format("is of a type that is unknown here (number {} of NanoVDB {})", type, version_text(data.mVersion.id()))
                              : fmt::format("holds {}, not float or double", nanovdb::toStr(data.mGridType));
  }
}

std::string unpacked(ByteReader& reader, const Entry& entry) {
  if (entry.size > uint64_t{64} << 30 || entry.size / 4096 > reader.left())
    throw std::runtime_error("the file ends too soon");  // no codec packs tighter
  std::string bytes(entry.size, '\0');
  for (size_t at = 0; at < bytes.size();) {
    const std::string_view packed = reader.take(reader.take<uint64_t>());
    if (entry.codec == 1) {
      uLongf size = bytes.size();
      if (uncompress(reinterpret_cast<Bytef*>(bytes.data()), &size, reinterpret_cast<const Bytef*>(packed.data()), packed.size()) != Z_OK ||
          size != bytes.size())
        throw std::runtime_error("its ZIP compression is damaged");
      return bytes;
    }
    const size_t chunk = std::min(kChunk, bytes.size() - at);
    size_t size = 0;
    if (blosc_cbuffer_validate(packed.data(), packed.size(), &size) != 0 || size != chunk ||
        blosc_decompress_ctx(packed.data(), bytes.data() + at, chunk, 1) != static_cast<int>(chunk))
      throw std::runtime_error("its Blosc compression is damaged");
    at += chunk;
  }
  return bytes;
}

void note_refusal(const std::exception& e, FileGrid& to) {
  to.grid = nullptr;
  to.refusal = std::string("is damaged or cannot be read: ") + e.what();
  to.strange = true;
}

void read_segment(ByteReader& reader, FileGrids& file) {
  const auto header = reader.take<Header>();
  if (header.magic != kMagicOfAll && header.magic != kMagicOfFile) throw std::runtime_error("it does not begin as a NanoVDB file");
  check_version(header.version);
  std::vector<Entry> entries;
  for (uint16_t n = 0; n < header.grids; ++n) {
    entries.push_back(reader.take<Entry>());
    std::string name(reader.take(entries.back().name_bytes));
    name.resize(std::min(name.size(), name.find('\0')));
    file.grids.push_back({name, nullptr, {}});
  }
  for (size_t n = 0; n < entries.size(); ++n) {
    const Entry& entry = entries[n];
    FileGrid& to = file.grids[file.grids.size() - entries.size() + n];
    const std::string_view stored = reader.take(entry.bytes);
    try {
      if (entry.codec > 2) throw std::runtime_error(fmt::format("its compression (codec {}) is unknown here", entry.codec));
      ByteReader inside(stored);
      if (entry.codec == 0)
        read_grid(stored, to);
      else
        read_grid(unpacked(inside, entry), to);
    } catch (const std::exception& e) {
      note_refusal(e, to);
    }
  }
}

// Grids one after the other without a directory, as they lie in memory.
void read_bare_grids(std::string_view bytes, FileGrids& file) {
  for (size_t at = 0; at < bytes.size();) {
    nanovdb::GridData data;
    if (bytes.size() - at < sizeof data) throw std::runtime_error("the file ends too soon");
    std::memcpy(static_cast<void*>(&data), bytes.data() + at, sizeof data);
    if (data.mGridSize < sizeof data || data.mGridSize > bytes.size() - at) throw std::runtime_error("the file ends too soon");
    const std::string_view name(data.mGridName, nanovdb::GridData::MaxNameSize);
    file.grids.push_back({std::string(name.substr(0, name.find('\0'))), nullptr, {}});
    try {
      read_grid(bytes.substr(at, data.mGridSize), file.grids.back());
    } catch (const std::exception& e) {
      note_refusal(e, file.grids.back());
    }
    at += data.mGridSize;
  }
}

bool begins_with_a_grid(std::string_view bytes) {
  if (bytes.size() < sizeof(nanovdb::GridData)) return false;
  ByteReader reader(bytes);
  const auto magic = reader.take<uint64_t>();
  const auto as_file = reader.take<uint32_t>();
  reader.take<uint32_t>();
  return magic == kMagicOfGrid || (magic == kMagicOfAll && !is_32(as_file) && is_32(reader.take<uint32_t>()));
}

}  // namespace

FileGrids read_nanovdb_file(const std::string& path) {
  const std::string bytes = read_whole_file(path);
  FileGrids file;
  try {
    if (begins_with_a_grid(bytes)) {
      read_bare_grids(bytes, file);
      return file;
    }
    ByteReader reader(bytes);
    do read_segment(reader, file);
    while (reader.left() > 0);
  } catch (const Error&) {
    throw;
  } catch (const std::exception& e) {
    fail(path, std::string("not a readable .nvdb file: ") + e.what(), "write it again with NanoVDB 32 (OpenVDB 9 or later), or as .vdb");
  }
  return file;
}

}  // namespace knead::openvdb_side
