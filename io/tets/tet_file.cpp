#include "io/tets/tet_file.h"

#include <cmath>

#include "io/tets/tet_formats.h"

namespace knead {
namespace {

std::string extension_of(const std::string& path) {
  const size_t dot = path.find_last_of("./");
  std::string extension = dot == std::string::npos || path[dot] == '/' ? "" : path.substr(dot + 1);
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return extension;
}

void check_name(const std::string& path, const std::vector<std::string>& known, const char* doing) {
  const std::string extension = extension_of(path);
  if (std::find(known.begin(), known.end(), extension) != known.end()) return;
  std::string list;
  for (const std::string& name : known) list += (list.empty() ? "." : ", .") + name;
  throw Error(ErrorCode::kGraph, Where{{}, 0, 0, {}, "path"}, fmt::format("tet meshes are not {} '{}'", doing, path), "take one of " + list);
}

}  // namespace

namespace tets {

void take_vtk_cell(int type, std::span<const uint64_t> vertices, const std::string& path, Found& to) {
  const bool linear = type == 10, curved = type == 24 || type == 71 || type == 78;  // of any order: corners first
  if (!linear && !curved) {
    ++((type >= 1 && type <= 9) || (type >= 21 && type <= 23) || type == 34 ? to.flat : to.other);
    return;
  }
  if (vertices.size() < 4) fail(path, fmt::format("a tet has {} vertices", vertices.size()));
  to.curved += curved;
  std::array<uint32_t, 4> tet;
  for (size_t k = 0; k < 4; ++k) tet[k] = static_cast<uint32_t>(std::min<uint64_t>(vertices[k], UINT32_MAX));
  to.mesh.tets.push_back(tet);
}

}  // namespace tets

void check_readable_tet_name(const std::string& path) {
  check_name(path, {"vtu", "vtk", "msh", "ele", "node"}, "read from");
}

void check_writable_tet_name(const std::string& path) {
  check_name(path, {"vtu", "vtk", "msh"}, "written to");
}

TetFile read_tet_file(const std::string& path, std::vector<std::string>& warnings) {
  check_readable_tet_name(path);
  const std::string extension = extension_of(path);
  tets::Found found;
  if (extension == "ele" || extension == "node") {
    found = tets::read_tetgen(path);
  } else {
    const std::string bytes = read_whole_file(path);
    found = extension == "vtu" ? tets::read_vtu(bytes, path) : extension == "vtk" ? tets::read_vtk(bytes, path) : tets::read_msh(bytes, path);
  }
  TetFile& mesh = found.mesh;
  if (mesh.tets.empty())
    tets::fail(path, fmt::format("holds no tets ({} points, {} faces or edges, {} other cells)", mesh.points.size(), found.flat, found.other),
               "a helper mesh is of tetrahedra; mesh the volume, not the surface");
  for (size_t t = 0; t < mesh.tets.size(); ++t)
    for (const uint32_t v : mesh.tets[t])
      if (v >= mesh.points.size()) tets::fail(path, fmt::format("tet {} names a vertex that is not there, of {}", t, mesh.points.size()));
  for (size_t v = 0; v < mesh.points.size(); ++v)
    for (int k = 0; k < 3; ++k)
      if (!std::isfinite(mesh.points[v][k])) tets::fail(path, fmt::format("vertex {} is not finite", v));
  if (found.curved > 0) warnings.push_back(fmt::format("{} of {} tets are curved: their corners are taken", found.curved, mesh.tets.size()));
  if (found.other > 0) warnings.push_back(fmt::format("{} cells that are no tets (hexahedra, wedges, pyramids) are left out", found.other));
  return std::move(mesh);
}

void write_tet_file(const std::string& path, const TetFile& mesh, const std::vector<TetField>& fields) {
  check_writable_tet_name(path);
  const std::string extension = extension_of(path);
  write_whole_file(path, extension == "vtu"   ? tets::vtu_text(mesh, fields)
                         : extension == "vtk" ? tets::vtk_text(mesh, fields)
                                              : tets::msh_text(mesh, fields));
}

}  // namespace knead
