// Small meshes and comparisons for the tests of io/mesh_*.
#pragma once
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <string>
#include <vector>

#include "graph/error.h"
#include "io/mesh/mesh_io.h"
#include "kernels/surface/volume.h"
#include "tests/paths.h"

namespace mesh_test_tools {

using knead::Surface;
using knead::Vec3d;

inline std::string shared_mesh(const std::string& name) {
  return shared_data() + "/" + name;
}

inline Surface parse(const std::string& bytes, const std::string& name, const knead::ReadMeshOptions& options = {}) {
  std::vector<std::string> warnings;
  return knead::parse_surface(bytes, name, options, warnings);
}

inline std::string format(const std::string& name, const Surface& surface, const knead::WriteMeshOptions& options = {}) {
  std::vector<std::string> notes;
  return knead::format_surface(name, surface, options, notes);
}

inline std::string short_text(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.4g", value);
  return text;
}

inline double volume_of(const Surface& surface) {
  const double volume = signed_volume(surface.points.host(), surface.topology->triangles, {0, 0, 0});
  return volume * std::pow(surface.placement.scale, 3);
}

inline bool same_bits(const Surface& a, const Surface& b) {
  const auto p = a.points.host(), q = b.points.host();
  return p.size() == q.size() && std::memcmp(p.data(), q.data(), p.size_bytes()) == 0 && a.placement == b.placement;
}

template <class F>
knead::Error error_of(F&& f) {
  try {
    f();
  } catch (const knead::Error& error) {
    return error;
  }
  ADD_FAILURE() << "nothing was thrown";
  return knead::Error(knead::ErrorCode::kInternal, "nothing was thrown");
}

inline bool mentions(const std::vector<std::string>& texts, const std::string& part) {
  for (const std::string& text : texts)
    if (text.find(part) != std::string::npos) return true;
  return false;
}

// A wavy closed tube of quads with five-cornered or larger caps: every kind of polygon, no two coordinates alike.
inline Surface wavy_tube(int around, int along, const Vec3d& offset = {0, 0, 0}, double size = 1) {
  std::vector<Vec3d> points;
  knead::MeshTopology polygons;
  polygons.face_offsets.push_back(0);
  const auto face = [&](const std::vector<uint32_t>& corners) {
    polygons.face_vertices.insert(polygons.face_vertices.end(), corners.begin(), corners.end());
    polygons.face_offsets.push_back(static_cast<uint32_t>(polygons.face_vertices.size()));
  };
  for (int k = 0; k <= along; ++k)
    for (int i = 0; i < around; ++i) {
      const double angle = 6.283185307179586 * i / around, radius = 1 + 0.2 * std::sin(1.3 * k) + 0.05 * std::cos(3 * angle);
      points.push_back(size * Vec3d{radius * std::cos(angle), radius * std::sin(angle), 0.37 * k} + offset);
    }
  const auto index = [&](int k, int i) { return static_cast<uint32_t>(k * around + i % around); };
  for (int k = 0; k < along; ++k)
    for (int i = 0; i < around; ++i) face({index(k, i), index(k, i + 1), index(k + 1, i + 1), index(k + 1, i)});
  std::vector<uint32_t> bottom, top;
  for (int i = 0; i < around; ++i) bottom.push_back(index(0, around - i)), top.push_back(index(along, i));
  face(bottom);
  face(top);
  std::vector<std::string> warnings;
  return knead::make_surface(points, polygons, {}, {}, "tube", warnings);
}

// The same with everything that a file can say: seams, hard edges, colours, names.
inline Surface decorated_tube(bool seams) {
  Surface surface = wavy_tube(7, 5);
  const knead::MeshTopology& topology = *surface.topology;
  knead::MeshAttributes a;
  const size_t n = surface.vertices();
  for (size_t i = 0; i < n; ++i) {
    a.vertex_colours.push_back({static_cast<float>(i % 256) / 255.0f, static_cast<float>(3 * i % 256) / 255.0f, 1.0f, 1.0f});
    a.normals.push_back({std::sin(0.1f * static_cast<float>(i)), std::cos(0.1f * static_cast<float>(i)), 0});
    a.texture_coordinates.push_back({0.001f * static_cast<float>(i), 0.5f + 0.0007f * static_cast<float>(i)});
  }
  for (size_t c = 0; c < topology.corners(); ++c) {
    a.corner_normal.push_back(static_cast<int32_t>(topology.face_vertices[c]));
    a.corner_texture.push_back(static_cast<int32_t>(topology.face_vertices[c]));
  }
  if (seams) {
    a.texture_coordinates.push_back({0.123456f, 0.987654f});
    a.normals.push_back({0, 0, -1});
    for (size_t c = topology.face_offsets[topology.faces() - 2]; c < topology.corners(); ++c) {
      a.corner_texture[c] = static_cast<int32_t>(n);
      a.corner_normal[c] = static_cast<int32_t>(n);
    }
  }
  a.groups = {"side wall", "caps"};
  a.objects = {"tube"};
  a.materials = {"skin", "lip stick"};
  a.material_library = "some file.mtl";
  for (size_t f = 0; f < topology.faces(); ++f) {
    a.face_group.push_back(f + 2 < topology.faces() ? 0 : 1);
    a.face_object.push_back(0);
    a.face_material.push_back(static_cast<int32_t>(f % 2));
  }
  const auto points = surface.points.host();
  a.normals_of = knead::Hasher().bytes(points.data(), points.size_bytes()).key();
  surface.attributes = std::make_shared<const knead::MeshAttributes>(std::move(a));
  return surface;
}

}  // namespace mesh_test_tools
