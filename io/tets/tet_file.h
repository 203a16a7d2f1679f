// Tet meshes from and to files: VTK (.vtu, .vtk), Gmsh (.msh) and, for reading, TetGen (.ele with .node). The readers and writers are our own: VTK from Debian
// takes 200 MB to install for four arrays, and Gmsh's library is GPL.
#pragma once
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "kernels/vec.h"

namespace knead {

struct TetFile {
  std::vector<Vec3d> points;
  std::vector<std::array<uint32_t, 4>> tets;
};

// Values by vertex or by tet.
struct TetField {
  std::string name;
  bool by_tet = false;
  int components = 1;  // or 3
  std::vector<double> values;
};

// Of a curved tet the corners are taken, and what is no tet is left out; both are said in `warnings`. Throws Error(kFile) with the place of what is wrong.
TetFile read_tet_file(const std::string& path, std::vector<std::string>& warnings);

// Whole or not at all; the extension chooses the format.
void write_tet_file(const std::string& path, const TetFile& mesh, const std::vector<TetField>& fields);

// Throw Error(kGraph) about the parameter `path` for an extension that is not known.
void check_readable_tet_name(const std::string& path);
void check_writable_tet_name(const std::string& path);

}  // namespace knead
