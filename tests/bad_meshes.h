// Files that are damaged and meshes that are broken, written by our own code: tests of readers and of the program need no data beside the checkout.
#pragma once
#include <array>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "kernels/shapes/primitives.h"

namespace bad_meshes {

struct Mesh {
  std::vector<std::array<double, 3>> points;
  std::vector<std::array<uint32_t, 3>> faces;
};

// A closed egg of 642 vertices and 1,280 triangles, no symmetry planes but one.
inline Mesh egg() {
  const knead::Surface sphere = knead::make_sphere(1, 3);
  Mesh mesh;
  for (const knead::Vec3f& p : sphere.points.host()) mesh.points.push_back({0.45 * p.x, (0.9 + 0.2 * p.y) * p.y, 0.6 * p.z + 0.1 * p.y * p.y});
  const std::vector<uint32_t>& t = sphere.topology->triangles;
  for (size_t i = 0; i + 2 < t.size(); i += 3) mesh.faces.push_back({t[i], t[i + 1], t[i + 2]});
  return mesh;
}

inline Mesh moved(Mesh mesh, double scale, const std::array<double, 3>& by) {
  for (auto& p : mesh.points)
    for (size_t k = 0; k < 3; ++k) p[k] = scale * p[k] + by[k];
  return mesh;
}

inline double volume_of(const Mesh& mesh) {
  double sum = 0;
  for (const auto& f : mesh.faces) {
    const auto &a = mesh.points[f[0]], &b = mesh.points[f[1]], &c = mesh.points[f[2]];
    sum += a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0]);
  }
  return sum / 6;
}

inline double diagonal_of(const Mesh& mesh) {
  std::array<double, 3> low = mesh.points[0], high = low;
  for (const auto& p : mesh.points)
    for (size_t k = 0; k < 3; ++k) low[k] = std::min(low[k], p[k]), high[k] = std::max(high[k], p[k]);
  return std::hypot(high[0] - low[0], high[1] - low[1], high[2] - low[2]);
}

// Edges of one face, and edges whose two faces run along them in the same direction.
inline size_t boundary_edges(const Mesh& mesh) {
  std::multiset<std::pair<uint32_t, uint32_t>> edges;
  for (const auto& f : mesh.faces)
    for (size_t c = 0; c < 3; ++c) edges.insert(std::minmax(f[c], f[(c + 1) % 3]));
  size_t count = 0;
  for (auto at = edges.begin(); at != edges.end(); at = edges.upper_bound(*at)) count += edges.count(*at) == 1;
  return count;
}
inline size_t edges_in_disagreement(const Mesh& mesh) {
  std::multiset<std::pair<uint32_t, uint32_t>> directed;
  for (const auto& f : mesh.faces)
    for (size_t c = 0; c < 3; ++c) directed.insert({f[c], f[(c + 1) % 3]});
  size_t count = 0;
  for (auto at = directed.begin(); at != directed.end(); at = directed.upper_bound(*at)) count += directed.count(*at) == 2;
  return count;
}

// Vertex k (from 1) stands in line k + 2. `replaced`: texts instead of the first coordinate of vertices 101 and 501.
inline std::string obj(const Mesh& mesh, const std::array<std::string, 2>& replaced = {}) {
  std::ostringstream text;
  text.precision(17);
  text << "# a mesh\n# of our own\n";
  for (size_t i = 0; i < mesh.points.size(); ++i) {
    const std::string instead = i == 100 ? replaced[0] : i == 500 ? replaced[1] : "";
    text << "v ";
    if (instead.empty())
      text << mesh.points[i][0];
    else
      text << instead;
    text << ' ' << mesh.points[i][1] << ' ' << mesh.points[i][2] << '\n';
  }
  for (const auto& f : mesh.faces) text << "f " << f[0] + 1 << ' ' << f[1] + 1 << ' ' << f[2] + 1 << '\n';
  return text.str();
}

inline Mesh open_boundary() {  // without its foot
  Mesh mesh = egg();
  std::erase_if(mesh.faces, [&](const auto& f) { return mesh.points[f[0]][1] + mesh.points[f[1]][1] + mesh.points[f[2]][1] < -1.5; });
  std::set<uint32_t> used;
  for (const auto& f : mesh.faces) used.insert(f.begin(), f.end());
  std::vector<uint32_t> number(mesh.points.size());
  Mesh kept;
  for (const uint32_t v : used) number[v] = static_cast<uint32_t>(kept.points.size()), kept.points.push_back(mesh.points[v]);
  for (const auto& f : mesh.faces) kept.faces.push_back({number[f[0]], number[f[1]], number[f[2]]});
  return kept;
}

inline Mesh turned(bool all) {  // all faces, or every third
  Mesh mesh = egg();
  for (size_t i = 0; i < mesh.faces.size(); i += all ? 1 : 3) std::swap(mesh.faces[i][1], mesh.faces[i][2]);
  return mesh;
}

inline Mesh unreferenced() {
  Mesh mesh = egg();
  for (int i = 0; i < 100; ++i) mesh.points.push_back({10.0 * std::sin(i), 10.0 * std::cos(i), 0.1 * i});
  return mesh;
}

inline const char* cube_vertices() {
  return "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n";
}

template <class T>
void append(std::string& bytes, const T& value) {
  char raw[sizeof value];
  std::memcpy(raw, &value, sizeof value);
  bytes.append(raw, sizeof value);
}

// Cut at 60 %, in the list of faces: face 522 (from 0) of 1,280 is the first that is not whole.
inline std::string truncated_ply() {
  const Mesh mesh = egg();
  std::string bytes = "ply\nformat binary_little_endian 1.0\nelement vertex 642\nproperty float x\nproperty float y\nproperty float z\n";
  bytes += "element face 1280\nproperty list uchar int vertex_indices\nend_header\n";
  for (const auto& p : mesh.points)
    for (const double x : p) append(bytes, static_cast<float>(x));
  for (size_t i = 0; i < 522; ++i) {
    append(bytes, static_cast<uint8_t>(3));
    for (const uint32_t v : mesh.faces[i]) append(bytes, v);
  }
  append(bytes, static_cast<uint8_t>(3));
  return bytes + "\1\2\3";
}

// The header announces 1,280 facets; the file ends in facet 826 (from 0).
inline std::string truncated_stl() {
  std::string bytes(80, ' ');
  append(bytes, uint32_t{1280});
  return bytes + std::string(826 * 50 + 20, '\0');
}

// Writes all of them into an empty folder: "malformed" is refused, "problem" is read.
inline void write_all(const std::filesystem::path& folder) {
  const auto put = [&](const std::string& name, const std::string& text) {
    std::filesystem::create_directories((folder / name).parent_path());
    std::ofstream(folder / name, std::ios::binary) << text;
  };
  const std::string cube = cube_vertices(), faces = "f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\n";
  put("malformed/truncated_binary.ply", truncated_ply());
  put("malformed/truncated_binary.stl", truncated_stl());
  put("malformed/index_out_of_range.obj", cube + faces + "f 4 1 5 99\n");
  put("malformed/index_negative_out_of_range.obj", cube + faces + "f 4 1 5 -9\n");
  put("malformed/index_zero.obj", cube + faces + "f 0 1 5 8\n");
  put("malformed/text_garbage.obj", "v 0 0 0\nv 1 0 0\nv one 2 3\nv 1 2\nlorem ipsum\nf a b c\n");
  put("malformed/empty.obj", "");
  put("malformed/comments_only.obj", "# nothing\n# but comments\n");
  put("malformed/zero_faces.obj", cube);
  put("malformed/header_only.ply",
      "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
      "property list uchar int vertex_indices\nend_header\n");
  put("malformed/ply_missing_end_header.ply", "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n");
  put("malformed/not_a_mesh.ply", "This is a letter, and no mesh of any kind.\n");
  put("problem/open_boundary.obj", obj(open_boundary()));
  put("problem/nan_vertex.obj", obj(egg(), {"nan", "NaN"}));
  put("problem/inf_vertex.obj", obj(egg(), {"inf", "-inf"}));
  put("problem/inside_out.obj", obj(turned(true)));
  put("problem/mixed_orientation.obj", obj(turned(false)));
  put("problem/unreferenced_vertices.obj", obj(unreferenced()));
  put("problem/offset_1e6.obj", obj(moved(egg(), 1, {1e6, -1e6, 1e6})));
  put("problem/scale_1e-4.obj", obj(moved(egg(), 1e-4 / diagonal_of(egg()), {0, 0, 0})));
  put("problem/scale_1e6.obj", obj(moved(egg(), 1e6 / diagonal_of(egg()), {0, 0, 0})));
}

// Of the meshes beside the checkout, those that are broken in ways that take more than a few lines to make.
inline constexpr const char* kSharedProblems[] = {"nonmanifold_edge.obj",        "nonmanifold_vertex.obj",      "self_intersecting.obj",
                                                  "duplicate_vertices_soup.obj", "degenerate_faces.obj",        "multi_component.obj",
                                                  "ngons_hex_pent.obj",          "ngons_concave_star_prism.obj"};

}  // namespace bad_meshes
