// VTK's XML format for unstructured grids: numbers as text, as base64 between the tags or appended (raw too), plain or packed by zlib. Written as base64.
#include <zlib.h>

#include "io/tets/tet_formats.h"

namespace knead::tets {
namespace {

constexpr std::string_view kDigits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

// Groups of four digits, three bytes each; padding may stand between two streams that follow each other.
std::string from_base64(std::string_view text) {
  static const std::array<int8_t, 256> value = [] {
    std::array<int8_t, 256> made;
    made.fill(-1);
    for (size_t n = 0; n < kDigits.size(); ++n) made[static_cast<uint8_t>(kDigits[n])] = static_cast<int8_t>(n);
    return made;
  }();
  std::string bytes;
  bytes.reserve(text.size() / 4 * 3);
  uint32_t group = 0;
  int digits = 0, padding = 0;
  for (const char c : text) {
    const int8_t v = value[static_cast<uint8_t>(c)];
    if (v < 0 && c != '=') continue;
    padding += c == '=';
    group = group << 6 | static_cast<uint32_t>(std::max<int8_t>(v, 0));
    if (++digits < 4) continue;
    for (int k = 0; k < 3 - std::min(padding, 3); ++k) bytes += static_cast<char>(group >> (16 - 8 * k) & 0xff);
    group = 0, digits = 0, padding = 0;
  }
  return bytes;
}

std::string to_base64(std::string_view bytes) {
  std::string text;
  text.reserve(bytes.size() / 3 * 4 + 4);
  for (size_t at = 0; at < bytes.size(); at += 3) {
    uint32_t group = 0;
    for (size_t k = 0; k < 3; ++k) group = group << 8 | (at + k < bytes.size() ? static_cast<uint8_t>(bytes[at + k]) : 0u);
    for (size_t k = 0; k < 4; ++k) text += at + k > bytes.size() ? '=' : kDigits[group >> (18 - 6 * k) & 63];
  }
  return text;
}

// An element's start tag: its name and what stands behind.
struct Tag {
  std::string_view text;  // between < and >
  size_t end = 0;         // behind >
  std::string attribute(std::string_view name) const {
    for (size_t at = text.find(name); at != std::string_view::npos; at = text.find(name, at + 1)) {
      const size_t after = at + name.size();
      if (at == 0 || (text[at - 1] != ' ' && text[at - 1] != '\n' && text[at - 1] != '\t')) continue;
      if (after + 1 >= text.size() || text[after] != '=') continue;
      const char quote = text[after + 1];
      const size_t close = text.find(quote, after + 2);
      if (close != std::string_view::npos) return std::string(text.substr(after + 2, close - after - 2));
    }
    return {};
  }
};

class VtuReader {
 public:
  VtuReader(std::string_view bytes, const std::string& path) : bytes_(bytes), path_(path) {
    Tag file;
    if (!next_tag("VTKFile", 0, bytes.size(), file) || file.attribute("type") != "UnstructuredGrid")
      fail(path, "is no unstructured grid of VTK", "a tet mesh is an unstructured grid (.vtu)");
    swapped_ = file.attribute("byte_order") == "BigEndian";
    wide_ = file.attribute("header_type") == "UInt64";
    const std::string packer = file.attribute("compressor");
    packed_ = packer == "vtkZLibDataCompressor";
    if (!packed_ && !packer.empty()) fail(path, "is packed by " + packer + ", which is not understood", "write it with zlib or without compression");
    Tag appended;
    if (next_tag("AppendedData", 0, bytes.size(), appended)) {
      raw_ = appended.attribute("encoding") == "raw";
      appended_ = bytes.find('_', appended.end) + 1;
    }
  }

  Found read() {
    Found found;
    Tag piece;
    const size_t over = appended_ == 0 ? bytes_.size() : appended_;
    for (size_t at = 0; next_tag("Piece", at, over, piece); at = piece.end) {
      const size_t end = std::min(bytes_.find("</Piece", piece.end), over);
      const size_t first = found.mesh.points.size();
      Tag points, array;
      if (!next_tag("Points", piece.end, end, points) || !next_tag("DataArray", points.end, end, array)) fail(path_, "a piece has no points");
      const std::vector<double> places = values(array);
      for (size_t i = 0; i + 2 < places.size(); i += 3) found.mesh.points.push_back({places[i], places[i + 1], places[i + 2]});
      std::vector<double> corners, offsets, types;
      Tag cells;
      if (!next_tag("Cells", piece.end, end, cells)) fail(path_, "a piece has no cells");
      const size_t cells_end = std::min(bytes_.find("</Cells", cells.end), end);
      for (size_t from = cells.end; next_tag("DataArray", from, cells_end, array); from = array.end) {
        const std::string name = array.attribute("Name");
        if (name == "connectivity") corners = values(array);
        if (name == "offsets") offsets = values(array);
        if (name == "types") types = values(array);
      }
      take_cells(corners, offsets, types, first, found);
    }
    return found;
  }

 private:
  bool next_tag(std::string_view name, size_t from, size_t to, Tag& tag) const {
    for (size_t at = bytes_.find('<', from); at < to; at = bytes_.find('<', at + 1)) {
      const std::string_view after = bytes_.substr(at + 1, name.size() + 1);
      if (after.size() <= name.size() || !after.starts_with(name) || std::isalnum(static_cast<unsigned char>(after.back()))) continue;
      const size_t close = bytes_.find('>', at);
      if (close == std::string_view::npos) return false;
      tag = {bytes_.substr(at + 1, close - at - 1), close + 1};
      return true;
    }
    return false;
  }

  void take_cells(const std::vector<double>& corners, const std::vector<double>& offsets, const std::vector<double>& types, size_t first,
                  Found& found) const {
    if (offsets.size() != types.size()) fail(path_, fmt::format("has {} cells and {} types of cells", offsets.size(), types.size()));
    std::vector<uint64_t> vertices;
    double begin = 0;
    for (size_t c = 0; c < types.size(); begin = offsets[c++]) {
      if (!(offsets[c] >= begin && offsets[c] <= static_cast<double>(corners.size()))) fail(path_, "the offsets of its cells are wrong");
      vertices.clear();
      for (size_t i = static_cast<size_t>(begin); i < static_cast<size_t>(offsets[c]); ++i) {
        if (!(corners[i] >= 0 && corners[i] < 4e9)) fail(path_, "a cell names a vertex that is not there");
        vertices.push_back(first + static_cast<uint64_t>(corners[i]));
      }
      take_vtk_cell(static_cast<int>(types[c]), vertices, path_, found);
    }
  }

  std::vector<double> values(const Tag& array) const {
    const std::string format = array.attribute("format"), type = array.attribute("type");
    const std::string_view inside = bytes_.substr(array.end, bytes_.find('<', array.end) - array.end);
    if (format == "ascii") {
      std::vector<double> numbers;
      for (Scanner in(inside, path_); !in.over();) numbers.push_back(in.number());
      return numbers;
    }
    std::string decoded;
    std::string_view stored;
    if (format == "appended") {
      size_t offset = 0;
      const std::string text = array.attribute("offset");
      std::from_chars(text.data(), text.data() + text.size(), offset);
      if (appended_ == 0 || offset > bytes_.size() - appended_) fail(path_, "its appended data is missing");
      stored = bytes_.substr(appended_ + offset);
      if (!raw_) stored = stored.substr(0, stored.find('<'));
    } else {
      stored = inside;
    }
    if (format != "appended" || !raw_) {
      decoded = from_base64(stored);
      stored = decoded;
    }
    return numbers_of(payload(stored), type);
  }

  uint64_t header(Scanner& in) const { return wide_ ? in.raw<uint64_t>(swapped_) : in.raw<uint32_t>(swapped_); }

  std::string payload(std::string_view stored) const {
    Scanner in(stored, path_);
    if (!packed_) {
      const uint64_t size = header(in);
      return std::string(stored.substr(in.at(), in.count(size)));
    }
    const uint64_t blocks = header(in), block = header(in), last = header(in);
    std::vector<uint64_t> sizes(in.count(blocks, wide_ ? 8 : 4));
    for (uint64_t& size : sizes) size = header(in);
    std::string bytes;
    for (size_t n = 0; n < sizes.size(); ++n) {
      uLongf size = n + 1 == sizes.size() && last != 0 ? last : block;
      const std::string_view from = stored.substr(in.at(), in.count(sizes[n]));
      if (size / 2000 > from.size()) fail(path_, "its zlib compression is damaged");
      const size_t at = bytes.size();
      bytes.resize(at + size);
      if (uncompress(reinterpret_cast<Bytef*>(bytes.data() + at), &size, reinterpret_cast<const Bytef*>(from.data()), from.size()) != Z_OK)
        fail(path_, "its zlib compression is damaged");
      bytes.resize(at + size);
      in.go_to(in.at() + from.size());
    }
    return bytes;
  }

  template <class T>
  std::vector<double> as_doubles(const std::string& bytes) const {
    Scanner in(bytes, path_);
    std::vector<double> numbers(bytes.size() / sizeof(T));
    for (double& number : numbers) number = static_cast<double>(in.raw<T>(swapped_));
    return numbers;
  }
  std::vector<double> numbers_of(const std::string& bytes, const std::string& type) const {
    if (type == "Float64") return as_doubles<double>(bytes);
    if (type == "Float32") return as_doubles<float>(bytes);
    if (type == "Int64") return as_doubles<int64_t>(bytes);
    if (type == "UInt64") return as_doubles<uint64_t>(bytes);
    if (type == "Int32") return as_doubles<int32_t>(bytes);
    if (type == "UInt32") return as_doubles<uint32_t>(bytes);
    if (type == "UInt8") return as_doubles<uint8_t>(bytes);
    if (type == "Int8") return as_doubles<int8_t>(bytes);
    fail(path_, "numbers of type '" + type + "' are not understood");
  }

  std::string_view bytes_;
  const std::string& path_;
  bool swapped_ = false, wide_ = false, packed_ = false, raw_ = false;
  size_t appended_ = 0;  // where the appended data begins; 0: there is none
};

template <class T>
void write_array(std::string& text, const char* type, const std::string& name, int components, const std::vector<T>& values) {
  const uint64_t size = sizeof(T) * values.size();
  std::string bytes(reinterpret_cast<const char*>(&size), sizeof size);
  bytes.append(reinterpret_cast<const char*>(values.data()), size);
  fmt::format_to(std::back_inserter(text), "<DataArray type=\"{}\" Name=\"{}\" NumberOfComponents=\"{}\" format=\"binary\">\n{}\n</DataArray>\n",
                 type, name, components, to_base64(bytes));
}

}  // namespace

Found read_vtu(const std::string& bytes, const std::string& path) {
  return VtuReader(bytes, path).read();
}

std::string vtu_text(const TetFile& mesh, const std::vector<TetField>& fields) {
  std::string text =
      "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n";
  fmt::format_to(std::back_inserter(text), "<UnstructuredGrid>\n<Piece NumberOfPoints=\"{}\" NumberOfCells=\"{}\">\n<Points>\n", mesh.points.size(),
                 mesh.tets.size());
  std::vector<double> places;
  for (const Vec3d& p : mesh.points) places.insert(places.end(), {p.x, p.y, p.z});
  write_array(text, "Float64", "Points", 3, places);
  std::vector<int64_t> corners, offsets;
  for (const auto& tet : mesh.tets) {
    corners.insert(corners.end(), tet.begin(), tet.end());
    offsets.push_back(static_cast<int64_t>(corners.size()));
  }
  text += "</Points>\n<Cells>\n";
  write_array(text, "Int64", "connectivity", 1, corners);
  write_array(text, "Int64", "offsets", 1, offsets);
  write_array(text, "UInt8", "types", 1, std::vector<uint8_t>(mesh.tets.size(), 10));
  text += "</Cells>\n";
  for (const bool by_tet : {false, true}) {
    text += by_tet ? "<CellData>\n" : "<PointData>\n";
    for (const TetField& field : fields)
      if (field.by_tet == by_tet) write_array(text, "Float64", field.name, field.components, field.values);
    text += by_tet ? "</CellData>\n" : "</PointData>\n";
  }
  return text + "</Piece>\n</UnstructuredGrid>\n</VTKFile>\n";
}

}  // namespace knead::tets
