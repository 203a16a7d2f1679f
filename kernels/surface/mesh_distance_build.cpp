#include <embree3/rtcore.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "graph/error.h"
#include "kernels/parallel.h"
#include "kernels/surface/edges.h"
#include "kernels/surface/mesh_distance_impl.h"
#include "kernels/surface/weld.h"

namespace knead {
namespace {

constexpr int kOverlapLevels = 4;        // how often a triangle that is partly inside the solid is quartered
constexpr double kOverlapOffset = 1e-3;  // of a triangle's size: how far below and above its face a triangle is tested, at most
constexpr float kCoincident = 2e-6f;     // of the diagonal: sheets that are no further apart are one, as far as rays in float can tell
constexpr double kSliver = 1e-6;         // of the diagonal: a triangle less high than this has no normal worth the name; its neighbours cover it

RTCDevice embree_device() {
  struct Owner {
    RTCDevice device = rtcNewDevice("ignore_config_files=1,verbose=0");
    ~Owner() { rtcReleaseDevice(device); }
  };
  static Owner owner;
  if (!owner.device) throw Error(ErrorCode::kDevice, "Embree could not start", "is the libembree3 package whole?");
  return owner.device;
}

double corner_angle(const Vec3d& at, const Vec3d& b, const Vec3d& c) {
  return std::atan2(length(cross(b - at, c - at)), dot(b - at, c - at));
}

bool finite(const Vec3d& p) {
  return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z);
}

// The corners by their vertices' new numbers.
std::vector<uint32_t> renamed(const std::vector<uint32_t>& triangles, const std::vector<uint32_t>& names) {
  std::vector<uint32_t> corners(triangles.size());
  for (size_t c = 0; c < corners.size(); ++c) corners[c] = names[triangles[c]];
  return corners;
}

}  // namespace

void MeshDistance::Impl::keep_finite(std::span<const uint32_t> all_triangles, std::vector<uint32_t>& whole, std::vector<uint32_t>& number) {
  lower = {1e300, 1e300, 1e300};
  upper = {-1e300, -1e300, -1e300};
  for (size_t t = 0; t + 2 < all_triangles.size(); t += 3) {
    bool good = true;
    for (int k = 0; k < 3; ++k) {
      if (all_triangles[t + k] >= points.size())
        throw Error(
            ErrorCode::kInput,
            "triangle " + std::to_string(t / 3) + " uses vertex " + std::to_string(all_triangles[t + k]) + " of " + std::to_string(points.size()),
            "the mesh is damaged; export it again");
      good = good && finite(points[all_triangles[t + k]]);
    }
    if (!good) continue;
    number.push_back(static_cast<uint32_t>(t / 3));
    for (int k = 0; k < 3; ++k) {
      whole.push_back(all_triangles[t + k]);
      for (int axis = 0; axis < 3; ++axis) {
        lower[axis] = std::min(lower[axis], points[whole.back()][axis]);
        upper[axis] = std::max(upper[axis], points[whole.back()][axis]);
      }
    }
  }
}

void MeshDistance::Impl::build(std::span<const Vec3d> all_points, std::span<const uint32_t> all_triangles, Executor& executor) {
  points.assign(all_points.begin(), all_points.end());
  std::vector<uint32_t> whole, number;  // triangles with three finite corners
  keep_finite(all_triangles, whole, number);
  centre = (lower + upper) * 0.5;
  diagonal = length(upper - lower);
  for (const double least : {kSliver, 0.0}) {
    for (size_t t = 0; t < whole.size() && (least > 0 || source.empty()); t += 3) {
      const Vec3d &a = points[whole[t]], &b = points[whole[t + 1]], &c = points[whole[t + 2]];
      const double longest = std::sqrt(std::max({dot(b - a, b - a), dot(c - b, c - b), dot(a - c, a - c)}));
      if (!(length(cross(b - a, c - a)) > least * diagonal * longest)) continue;
      triangles.insert(triangles.end(), {whole[t], whole[t + 1], whole[t + 2]});
      source.push_back(number[t / 3]);
    }
  }
  if (triangles.empty()) throw Error(ErrorCode::kInput, "the mesh has no triangle with an area", "distances need a surface");
  const std::vector<uint32_t> welded = first_at_same_place(std::span<const Vec3d>(points));
  closed = EdgeUses(points.size(), renamed(whole, welded), &executor).closed();
  solid = std::make_unique<WindingNumber>(points, whole, executor);
  find_normals(welded, executor);
  make_scene();
  drop_overlaps(welded, executor);
}

void MeshDistance::Impl::find_normals(const std::vector<uint32_t>& welded, Executor& executor) {
  const size_t count = triangles.size() / 3;
  face_normals.resize(count);
  corner_normals.resize(3 * count);
  edge_normals.resize(3 * count);
  doubtful.assign(count, 0);
  std::vector<Vec3d> at_vertex(points.size(), Vec3d{0, 0, 0});
  for (size_t t = 0; t < count; ++t) {
    face_normals[t] = unit_or_zero(cross(corner(t, 1) - corner(t, 0), corner(t, 2) - corner(t, 0)));
    for (int k = 0; k < 3; ++k) {
      const double angle = corner_angle(corner(t, k), corner(t, (k + 1) % 3), corner(t, (k + 2) % 3));
      at_vertex[welded[triangles[3 * t + k]]] += angle * face_normals[t];
    }
  }
  std::vector<uint8_t> doubtful_vertex(points.size(), 0);
  EdgeUses(points.size(), renamed(triangles, welded), &executor).each_edge([&](uint32_t low, std::span<const EdgeUse> uses) {
    Vec3d normal{0, 0, 0};
    for (const EdgeUse& use : uses) normal += face_normals[use.triangle()];
    const bool sure = uses.size() == 2 && net_use(uses) == 0;
    if (!sure) doubtful_vertex[low] = doubtful_vertex[uses[0].high] = 1;
    for (const EdgeUse& use : uses) {
      edge_normals[use.corner] = unit_or_zero(normal);
      if (!sure) doubtful[use.triangle()] |= static_cast<uint8_t>(8u << use.corner % 3);
    }
  });
  for (size_t slot = 0; slot < 3 * count; ++slot) {
    corner_normals[slot] = unit_or_zero(at_vertex[welded[triangles[slot]]]);
    if (doubtful_vertex[welded[triangles[slot]]]) doubtful[slot / 3] |= static_cast<uint8_t>(1u << slot % 3);
  }
}

// How far from a place on the surface the solid is tested along a unit direction: a part of the triangle's size, but never past the middle of the way to the
// next sheet, however large the triangles of a thin wall are.
double MeshDistance::Impl::test_offset(const Vec3d& at, const Vec3d& direction, double size) const {
  const std::optional<Hit> next = hit_after(kCoincident, (at - centre) * (1 / diagonal), direction);
  return next ? std::min(kOverlapOffset * size, 0.5 * static_cast<double>(next->distance) * diagonal) : kOverlapOffset * size;
}

// True when the solid is just below `at` and not just above it, which is what makes a triangle part of the surface. Both are asked, since two walls
// may coincide.
bool MeshDistance::Impl::on_surface(const std::array<Vec3d, 3>& corners, const Vec3d& at) const {
  const Vec3d across = cross(corners[1] - corners[0], corners[2] - corners[0]), normal = unit_or_zero(across);
  const double size = std::sqrt(length(across));
  auto winding = [&](const Vec3d& p, double side) -> double {
    const int one = ray_winding(p, unit_or_zero(Vec3d{0.217, -0.131, 0.173} + side * normal));
    return one == (side < 0 ? 1 : 0) || one == ray_winding(p, unit_or_zero(Vec3d{-0.319, 0.273, -0.147} - side * normal)) ? one : solid->at(p);
  };
  const double below = winding(at - test_offset(at, -normal, size) * normal, -1);
  return below > 0.5 && below < 1.5 && winding(at + test_offset(at, normal, size) * normal, 1) < 0.5;
}

// Adds the parts of a piece that are on the surface; false when it does not come out as it went in.
bool MeshDistance::Impl::quarter(const Piece& piece, int level, std::vector<Piece>& out) const {
  const auto& [a, b, c] = piece.corners;
  const Vec3d centroid = (a + b + c) * (1.0 / 3);
  int kept = on_surface(piece.corners, centroid);
  for (const Vec3d& corner : piece.corners) kept += on_surface(piece.corners, corner + 0.05 * (centroid - corner));
  if (kept == 0) return false;
  if (kept == 4 || level == 0) {
    out.push_back({piece.corners, piece.triangle, kept == 4});
    return kept == 4;
  }
  const Vec3d ab = (a + b) * 0.5, bc = (b + c) * 0.5, ca = (c + a) * 0.5;
  for (const auto& part : {std::array{a, ab, ca}, std::array{ab, b, bc}, std::array{ca, bc, c}, std::array{ab, bc, ca}})
    quarter({part, piece.triangle, true}, level - 1, out);
  return false;
}

void MeshDistance::Impl::drop_overlaps(const std::vector<uint32_t>& welded, Executor& executor) {
  if (!closed) return;
  const size_t count = triangles.size() / 3;
  std::vector<uint8_t> inner(count, 0);
  parallel_for(executor, count, "mesh_distance_overlaps", [&](uint32_t t) {
    inner[t] = !on_surface({corner(t, 0), corner(t, 1), corner(t, 2)}, (corner(t, 0) + corner(t, 1) + corner(t, 2)) * (1.0 / 3));
  });
  overlapping = std::find(inner.begin(), inner.end(), 1) != inner.end();
  if (!overlapping) return;

  std::vector<std::vector<Piece>> parts(count);
  parallel_for(
      executor, count, "mesh_distance_pieces",
      [&](uint32_t t) {
        inner[t] = !quarter({{corner(t, 0), corner(t, 1), corner(t, 2)}, t, true}, kOverlapLevels, parts[t]);
      },
      16);
  std::vector<uint8_t> torn(points.size(), 0);  // vertices where the surface is no longer the mesh's
  for (size_t t = 0; t < count; ++t)
    for (int k = 0; k < 3; ++k)
      if (inner[t]) torn[welded[triangles[3 * t + k]]] = 1;
  std::vector<Vec3d> new_points, new_faces, new_corners, new_edges;
  std::vector<uint32_t> new_source;
  std::vector<uint8_t> new_doubt;
  for (size_t t = 0; t < count; ++t)
    for (const Piece& piece : parts[t]) {
      new_points.insert(new_points.end(), piece.corners.begin(), piece.corners.end());
      new_faces.push_back(face_normals[t]);
      new_source.push_back(source[t]);
      uint8_t doubt = inner[t] ? 0x3f : doubtful[t];
      if (!piece.clean) doubt = 0x7f;
      for (int k = 0; k < 3; ++k) {
        const bool here = torn[welded[triangles[3 * t + k]]], next = torn[welded[triangles[3 * t + (k + 1) % 3]]];
        doubt |= static_cast<uint8_t>((here ? 1u << k : 0u) | (here && next ? 8u << k : 0u));
        new_corners.push_back(corner_normals[3 * t + k]);
        new_edges.push_back(edge_normals[3 * t + k]);
      }
      new_doubt.push_back(doubt);
    }
  if (new_source.empty()) {  // no volume at all, a closed sheet: keep it as it is
    overlapping = false;
    doubtful.assign(count, 0x7f);
    return;
  }
  points = std::move(new_points);
  source = std::move(new_source);
  face_normals = std::move(new_faces);
  corner_normals = std::move(new_corners);
  edge_normals = std::move(new_edges);
  doubtful = std::move(new_doubt);
  triangles.resize(points.size());
  for (uint32_t k = 0; k < triangles.size(); ++k) triangles[k] = k;
  make_scene();
}

void MeshDistance::Impl::make_scene() {
  RTCDevice device = embree_device();
  if (scene) rtcReleaseScene(scene);
  scene = rtcNewScene(device);
  rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
  RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
  auto* vertices =
      static_cast<float*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float), points.size()));
  auto* indices = static_cast<unsigned*>(
      rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 3 * sizeof(unsigned), triangles.size() / 3));
  if (!vertices || !indices) {
    rtcReleaseGeometry(geometry);
    throw Error(ErrorCode::kMemory, "no memory for the distance search of " + std::to_string(triangles.size() / 3) + " triangles");
  }
  for (size_t i = 0; i < points.size(); ++i) {
    const Vec3d q = finite(points[i]) ? (points[i] - centre) * (1 / diagonal) : Vec3d{0, 0, 0};
    for (int k = 0; k < 3; ++k) vertices[3 * i + k] = static_cast<float>(q[k]);
  }
  std::copy(triangles.begin(), triangles.end(), indices);
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(scene, geometry);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(scene);
  if (rtcGetDeviceError(device) != RTC_ERROR_NONE) throw Error(ErrorCode::kMemory, "Embree could not build the distance search");
}

MeshDistance::Impl::~Impl() {
  if (scene) rtcReleaseScene(scene);
}

}  // namespace knead
