// VTK's legacy format, versions 2 to 5.1, text and binary (big-endian). Written as version 4.2 in text.
#include "io/tets/tet_formats.h"

namespace knead::tets {
namespace {

double read_value(Scanner& in, std::string_view type, bool binary) {
  if (!binary) return in.number();
  if (type == "double") return in.raw<double>(true);
  if (type == "float") return static_cast<double>(in.raw<float>(true));
  if (type == "int" || type == "vtktypeint32") return in.raw<int32_t>(true);
  if (type == "long" || type == "vtktypeint64" || type == "vtkIdType") return static_cast<double>(in.raw<int64_t>(true));
  if (type == "unsigned_char") return in.raw<uint8_t>();
  in.fail_here(fmt::format("numbers of type '{}' are not understood", type));
}

std::vector<uint64_t> read_indices(Scanner& in, uint64_t n, std::string_view type, bool binary) {
  std::vector<uint64_t> values(in.count(n));
  for (uint64_t& value : values) {
    const double read = read_value(in, type, binary);
    if (!(read >= 0 && read < 1e15)) in.fail_here("an index is negative or too large");
    value = static_cast<uint64_t>(read);
  }
  return values;
}

struct Cells {
  std::vector<uint64_t> offsets, corners;  // offsets: one more than cells
  std::vector<uint64_t> types;
};

// "CELLS cells numbers" with each cell's count before its vertices; since 5.0 "CELLS offsets corners" and two arrays with names.
void read_cells(Scanner& in, double version, bool binary, Cells& cells) {
  const auto first = in.number<uint64_t>(), second = in.number<uint64_t>();
  in.line();
  if (version >= 5) {
    for (std::vector<uint64_t>* to : {&cells.offsets, &cells.corners}) {
      in.word();
      const std::string_view type = in.word();
      in.line();
      *to = read_indices(in, to == &cells.offsets ? first : second, type, binary);
    }
    return;
  }
  const std::vector<uint64_t> numbers = read_indices(in, second, "int", binary);
  cells.offsets.assign(1, 0);
  for (size_t at = 0; at < numbers.size();) {
    const uint64_t n = numbers[at++];
    if (n > numbers.size() - at) in.fail_here("a cell's vertices run over the end of the cells");
    cells.corners.insert(cells.corners.end(), numbers.begin() + static_cast<ptrdiff_t>(at), numbers.begin() + static_cast<ptrdiff_t>(at + n));
    cells.offsets.push_back(cells.corners.size());
    at += n;
  }
  if (cells.offsets.size() != first + 1) in.fail_here(fmt::format("{} cells were promised, {} found", first, cells.offsets.size() - 1));
}

}  // namespace

Found read_vtk(const std::string& bytes, const std::string& path) {
  Scanner in(bytes, path);
  constexpr std::string_view kTitle = "# vtk DataFile Version";
  const std::string_view title = in.line();
  if (!title.starts_with(kTitle)) fail(path, "does not begin as a VTK file", "name it .vtk only if it is of VTK's legacy format");
  double version = 0;
  const std::string_view digits = title.substr(std::min(title.size(), title.find_first_not_of(' ', kTitle.size())));
  std::from_chars(digits.data(), digits.data() + digits.size(), version);
  in.line();
  const bool binary = in.word() == "BINARY";
  Found found;
  Cells cells;
  bool has_points = false;
  while ((!has_points || cells.offsets.empty() || cells.types.empty()) && !in.over()) {
    const std::string_view what = in.word();
    if (what == "DATASET") {
      const std::string_view kind = in.word();
      if (kind != "UNSTRUCTURED_GRID") fail(path, fmt::format("holds {}, not an unstructured grid", kind), "a tet mesh is an unstructured grid");
    } else if (what == "POINTS") {
      const auto n = in.number<uint64_t>();
      const std::string_view type = in.word();
      in.line();
      found.mesh.points.resize(in.count(n, 3));
      for (Vec3d& p : found.mesh.points)
        for (int k = 0; k < 3; ++k) p[k] = read_value(in, type, binary);
      has_points = true;
    } else if (what == "CELLS") {
      read_cells(in, version, binary, cells);
    } else if (what == "CELL_TYPES") {
      const auto n = in.number<uint64_t>();
      in.line();
      cells.types = read_indices(in, n, "int", binary);
    } else {
      in.line();
    }
  }
  if (!has_points || cells.offsets.size() != cells.types.size() + 1)
    fail(path, "its points, cells or types of cells are missing, or their numbers differ");
  for (size_t c = 0; c < cells.types.size(); ++c) {
    if (cells.offsets[c] > cells.offsets[c + 1] || cells.offsets[c + 1] > cells.corners.size()) fail(path, "the offsets of its cells are wrong");
    take_vtk_cell(static_cast<int>(cells.types[c]), std::span(cells.corners).subspan(cells.offsets[c], cells.offsets[c + 1] - cells.offsets[c]), path,
                  found);
  }
  return found;
}

std::string vtk_text(const TetFile& mesh, const std::vector<TetField>& fields) {
  std::string text = "# vtk DataFile Version 4.2\nKnead\nASCII\nDATASET UNSTRUCTURED_GRID\n";
  const auto to = std::back_inserter(text);
  fmt::format_to(to, "POINTS {} double\n", mesh.points.size());
  for (const Vec3d& p : mesh.points) fmt::format_to(to, "{} {} {}\n", p.x, p.y, p.z);
  fmt::format_to(to, "CELLS {} {}\n", mesh.tets.size(), 5 * mesh.tets.size());
  for (const auto& t : mesh.tets) fmt::format_to(to, "4 {} {} {} {}\n", t[0], t[1], t[2], t[3]);
  fmt::format_to(to, "CELL_TYPES {}\n", mesh.tets.size());
  for (size_t t = 0; t < mesh.tets.size(); ++t) text += "10\n";
  for (const bool by_tet : {false, true}) {
    bool first = true;
    for (const TetField& field : fields) {
      if (field.by_tet != by_tet) continue;
      if (first) fmt::format_to(to, "{} {}\n", by_tet ? "CELL_DATA" : "POINT_DATA", by_tet ? mesh.tets.size() : mesh.points.size());
      first = false;
      if (field.components == 3)
        fmt::format_to(to, "VECTORS {} double\n", field.name);
      else
        fmt::format_to(to, "SCALARS {} double 1\nLOOKUP_TABLE default\n", field.name);
      for (size_t i = 0; i < field.values.size(); ++i)
        fmt::format_to(to, "{}{}", field.values[i], (i + 1) % static_cast<size_t>(field.components) == 0 ? '\n' : ' ');
    }
  }
  return text;
}

}  // namespace knead::tets
