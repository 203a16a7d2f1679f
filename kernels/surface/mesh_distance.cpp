#include "kernels/surface/mesh_distance.h"

#include <embree3/rtcore.h>

#include <algorithm>
#include <array>
#include <string>
#include <tuple>
#include <vector>

#include "graph/error.h"
#include "kernels/parallel.h"
#include "kernels/surface/winding_number.h"

namespace knead {
namespace {

constexpr double kSlack = 1e-6;          // of the diagonal: covers Embree's float boxes around the double triangles
constexpr double kGrazing = 0.02;        // a point nearer than this (as a sine) to the tangent plane of an edge or corner asks the winding number
constexpr int kOverlapLevels = 4;        // how often a triangle that is partly inside the solid is quartered
constexpr double kOverlapOffset = 1e-3;  // of a triangle's size: how far below and above its face a triangle is tested
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

Vec3d unit_or_zero(const Vec3d& v) {
  const double size = length(v);
  return size > 0 ? v * (1 / size) : Vec3d{0, 0, 0};
}

double corner_angle(const Vec3d& at, const Vec3d& b, const Vec3d& c) {
  return std::atan2(length(cross(b - at, c - at)), dot(b - at, c - at));
}

RTCRayHit shoot(RTCScene scene, const Vec3d& origin, const Vec3d& direction, float near) {
  RTCRayHit hit{};
  hit.ray.org_x = static_cast<float>(origin.x);
  hit.ray.org_y = static_cast<float>(origin.y);
  hit.ray.org_z = static_cast<float>(origin.z);
  hit.ray.dir_x = static_cast<float>(direction.x);
  hit.ray.dir_y = static_cast<float>(direction.y);
  hit.ray.dir_z = static_cast<float>(direction.z);
  hit.ray.tnear = near;
  hit.ray.tfar = std::numeric_limits<float>::infinity();
  hit.ray.mask = 0xffffffffu;
  hit.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect1(scene, &context, &hit);
  return hit;
}

bool finite(const Vec3d& p) {
  return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z);
}

}  // namespace

TrianglePoint closest_point_on_triangle(const Vec3d& p, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  const Vec3d ab = b - a, ac = c - a, ap = p - a;
  const double d1 = dot(ab, ap), d2 = dot(ac, ap);
  if (d1 <= 0 && d2 <= 0) return {a, 0};
  const Vec3d bp = p - b;
  const double d3 = dot(ab, bp), d4 = dot(ac, bp);
  if (d3 >= 0 && d4 <= d3) return {b, 1};
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return {a + ab * (d1 / (d1 - d3)), 3};
  const Vec3d cp = p - c;
  const double d5 = dot(ab, cp), d6 = dot(ac, cp);
  if (d6 >= 0 && d5 <= d6) return {c, 2};
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return {a + ac * (d2 / (d2 - d6)), 5};
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) return {b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6))), 4};
  const double scale = 1 / (va + vb + vc);
  return {a + ab * (vb * scale) + ac * (vc * scale), 6};
}

struct MeshDistance::Impl {
  std::vector<Vec3d> points;
  std::vector<uint32_t> triangles;    // the surface: what distances are measured to
  std::vector<uint32_t> source;       // per triangle, its number in the mesh given
  std::vector<Vec3d> face_normals;    // unit, per triangle
  std::vector<Vec3d> corner_normals;  // unit pseudonormals, 3 per triangle
  std::vector<Vec3d> edge_normals;    // unit pseudonormals, 3 per triangle, edge k from corner k
  std::vector<uint8_t> doubtful;      // per triangle: bit k < 3 corner k, bit 3 + k edge k, bit 6 the face: the sign there needs the winding number
  std::unique_ptr<WindingNumber> solid;
  Vec3d lower, upper, centre;
  double diagonal = 0;
  bool closed = true, overlapping = false;
  RTCScene scene = nullptr;

  struct Piece {  // of a triangle
    std::array<Vec3d, 3> corners;
    uint32_t triangle;
    bool clean;  // on the surface all over
  };
  struct Nearest {
    const Impl* mesh;
    Vec3d p;
    double slack;  // in units of the diagonal
    double squared;
    TrianglePoint at{};
    uint32_t triangle = std::numeric_limits<uint32_t>::max();
  };

  ~Impl() {
    if (scene) rtcReleaseScene(scene);
  }
  void build(std::span<const Vec3d> all_points, std::span<const uint32_t> all_triangles, Executor& executor);
  void find_normals(const std::vector<uint32_t>& welded);
  void drop_overlaps(const std::vector<uint32_t>& welded, Executor& executor);
  bool quarter(const Piece& piece, int level, std::vector<Piece>& out) const;
  void make_scene();
  static bool improve(Nearest& best, uint32_t triangle);
  Nearest search(const Vec3d& p, double radius, uint32_t hint) const;
  SignedDistance with_sign(const Nearest& nearest) const;
  int ray_winding(const Vec3d& origin, const Vec3d& direction) const;
  const Vec3d& corner(size_t triangle, int k) const { return points[triangles[3 * triangle + k]]; }
  bool on_surface(const std::array<Vec3d, 3>& corners, const Vec3d& at) const;
};

namespace {

// Exactly equal positions share a number, so that a soup has the topology it looks like.
std::vector<uint32_t> weld(const std::vector<Vec3d>& points) {
  std::vector<uint32_t> order(points.size()), welded(points.size());
  for (uint32_t i = 0; i < order.size(); ++i) order[i] = i;
  auto key = [&](uint32_t i) { return std::tie(points[i].x, points[i].y, points[i].z); };
  std::sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) { return key(a) != key(b) ? key(a) < key(b) : a < b; });
  for (size_t k = 0; k < order.size(); ++k) welded[order[k]] = k > 0 && key(order[k]) == key(order[k - 1]) ? welded[order[k - 1]] : order[k];
  return welded;
}

struct HalfEdge {
  uint32_t low, high, slot;  // slot: 3 * triangle + k
  bool forward;              // from low to high
};

}  // namespace

void MeshDistance::Impl::build(std::span<const Vec3d> all_points, std::span<const uint32_t> all_triangles, Executor& executor) {
  points.assign(all_points.begin(), all_points.end());
  std::vector<uint32_t> whole, number;  // triangles with three finite corners
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
  const std::vector<uint32_t> welded = weld(points);
  std::vector<std::array<uint32_t, 3>> edges;
  for (size_t c = 0; c < whole.size(); ++c) {
    const uint32_t from = welded[whole[c]], to = welded[whole[c % 3 == 2 ? c - 2 : c + 1]];
    if (from != to) edges.push_back({std::min(from, to), std::max(from, to), from < to});
  }
  std::sort(edges.begin(), edges.end());
  for (size_t k = 0, net = 0; k < edges.size(); ++k) {
    net += edges[k][2] ? 1 : size_t(-1);
    if (k + 1 < edges.size() && edges[k + 1][0] == edges[k][0] && edges[k + 1][1] == edges[k][1]) continue;
    closed = closed && net == 0;
    net = 0;
  }
  solid = std::make_unique<WindingNumber>(points, whole, executor);
  find_normals(welded);
  make_scene();
  drop_overlaps(welded, executor);
}

void MeshDistance::Impl::find_normals(const std::vector<uint32_t>& welded) {
  const size_t count = triangles.size() / 3;
  face_normals.resize(count);
  corner_normals.resize(3 * count);
  edge_normals.resize(3 * count);
  doubtful.assign(count, 0);
  std::vector<Vec3d> at_vertex(points.size(), Vec3d{0, 0, 0});
  std::vector<HalfEdge> edges(3 * count);
  for (size_t t = 0; t < count; ++t) {
    face_normals[t] = unit_or_zero(cross(corner(t, 1) - corner(t, 0), corner(t, 2) - corner(t, 0)));
    for (int k = 0; k < 3; ++k) {
      const uint32_t from = welded[triangles[3 * t + k]], to = welded[triangles[3 * t + (k + 1) % 3]];
      at_vertex[from] += corner_angle(corner(t, k), corner(t, (k + 1) % 3), corner(t, (k + 2) % 3)) * face_normals[t];
      edges[3 * t + k] = {std::min(from, to), std::max(from, to), static_cast<uint32_t>(3 * t + k), from < to};
    }
  }
  std::sort(edges.begin(), edges.end(),
            [](const HalfEdge& a, const HalfEdge& b) { return std::tie(a.low, a.high, a.slot) < std::tie(b.low, b.high, b.slot); });
  std::vector<uint8_t> doubtful_vertex(points.size(), 0);
  for (size_t begin = 0; begin < edges.size();) {
    size_t end = begin;
    int forward = 0, backward = 0;
    Vec3d normal{0, 0, 0};
    for (; end < edges.size() && edges[end].low == edges[begin].low && edges[end].high == edges[begin].high; ++end) {
      ++(edges[end].forward ? forward : backward);
      normal += face_normals[edges[end].slot / 3];
    }
    const bool sure = forward == 1 && backward == 1;
    if (!sure) doubtful_vertex[edges[begin].low] = doubtful_vertex[edges[begin].high] = 1;
    for (size_t k = begin; k < end; ++k) {
      edge_normals[edges[k].slot] = unit_or_zero(normal);
      if (!sure) doubtful[edges[k].slot / 3] |= static_cast<uint8_t>(8u << edges[k].slot % 3);
    }
    begin = end;
  }
  for (size_t slot = 0; slot < 3 * count; ++slot) {
    corner_normals[slot] = unit_or_zero(at_vertex[welded[triangles[slot]]]);
    if (doubtful_vertex[welded[triangles[slot]]]) doubtful[slot / 3] |= static_cast<uint8_t>(1u << slot % 3);
  }
}

// The winding number as the crossings of a ray, ways out minus ways in: fast, but wrong where the ray grazes or meets an edge.
int MeshDistance::Impl::ray_winding(const Vec3d& origin, const Vec3d& direction) const {
  const Vec3d q = (origin - centre) * (1 / diagonal);
  int winding = 0;
  float near = 0;
  for (int hits = 0; hits < 64; ++hits) {
    const RTCRayHit hit = shoot(scene, q, direction, near);
    if (hit.hit.geomID == RTC_INVALID_GEOMETRY_ID) break;
    winding += dot(face_normals[hit.hit.primID], direction) > 0 ? 1 : -1;
    near = std::nextafter(hit.ray.tfar * (1 + 1e-6f), 2e9f);
  }
  return winding;
}

// True when the solid is just below `at` and not just above it, which is what makes a triangle part of the surface. Both are asked, since two walls may
// coincide.
bool MeshDistance::Impl::on_surface(const std::array<Vec3d, 3>& corners, const Vec3d& at) const {
  const Vec3d across = cross(corners[1] - corners[0], corners[2] - corners[0]), normal = unit_or_zero(across);
  const Vec3d offset = (kOverlapOffset * std::sqrt(length(across))) * normal;
  auto winding = [&](const Vec3d& p, double side) -> double {
    const int one = ray_winding(p, unit_or_zero(Vec3d{0.217, -0.131, 0.173} + side * normal));
    return one == (side < 0 ? 1 : 0) || one == ray_winding(p, unit_or_zero(Vec3d{-0.319, 0.273, -0.147} - side * normal)) ? one : solid->at(p);
  };
  const double below = winding(at - offset, -1);
  return below > 0.5 && below < 1.5 && winding(at + offset, 1) < 0.5;
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

MeshDistance::MeshDistance(std::span<const Vec3d> points, std::span<const uint32_t> triangles, Executor* executor) : impl_(std::make_unique<Impl>()) {
  impl_->build(points, triangles, executor ? *executor : *make_serial_executor());
}

MeshDistance::MeshDistance(std::span<const Vec3f> points, std::span<const uint32_t> triangles, Executor* executor) : impl_(std::make_unique<Impl>()) {
  std::vector<Vec3d> exact(points.size());
  std::transform(points.begin(), points.end(), exact.begin(), [](const Vec3f& p) { return to_double(p); });
  impl_->build(exact, triangles, executor ? *executor : *make_serial_executor());
}

MeshDistance::~MeshDistance() = default;

bool MeshDistance::Impl::improve(Nearest& best, uint32_t t) {
  const Impl& m = *best.mesh;
  const double to_plane = dot(best.p - m.corner(t, 0), m.face_normals[t]);  // deep inside a round body this settles most candidates
  if (to_plane * to_plane > best.squared * (1 + 1e-9)) return false;
  const TrianglePoint at = closest_point_on_triangle(best.p, m.corner(t, 0), m.corner(t, 1), m.corner(t, 2));
  const Vec3d away = best.p - at.point;
  const double squared = dot(away, away);
  if (!(squared < best.squared || (squared == best.squared && t < best.triangle))) return false;
  best.squared = squared;
  best.at = at;
  best.triangle = t;
  return true;
}

MeshDistance::Impl::Nearest MeshDistance::Impl::search(const Vec3d& p, double radius, uint32_t hint) const {
  const Vec3d q = (p - centre) * (1 / diagonal);
  const double reach = std::max({std::abs(q.x), std::abs(q.y), std::abs(q.z)});
  Nearest nearest{this, p, kSlack * (1 + reach), radius * radius};
  if (hint < source.size() && improve(nearest, hint)) radius = std::sqrt(nearest.squared) * (1 + kSlack);

  RTCPointQuery query;
  query.x = static_cast<float>(q.x);
  query.y = static_cast<float>(q.y);
  query.z = static_cast<float>(q.z);
  query.time = 0;
  query.radius = std::isfinite(radius) ? static_cast<float>(radius / diagonal + nearest.slack) : std::numeric_limits<float>::infinity();
  RTCPointQueryContext context;
  rtcInitPointQueryContext(&context);
  rtcPointQuery(
      scene, &query, &context,
      [](RTCPointQueryFunctionArguments* arguments) {
        Nearest& best = *static_cast<Nearest*>(arguments->userPtr);
        if (!improve(best, arguments->primID)) return false;
        const float shrunk = static_cast<float>(std::sqrt(best.squared) / best.mesh->diagonal * (1 + kSlack) + best.slack);
        if (!(shrunk < arguments->query->radius)) return false;
        arguments->query->radius = shrunk;
        return true;
      },
      &nearest);
  return nearest;
}

SignedDistance MeshDistance::Impl::with_sign(const Nearest& nearest) const {
  SignedDistance result;
  if (nearest.triangle == std::numeric_limits<uint32_t>::max()) return result;
  const uint32_t t = nearest.triangle;
  const int feature = nearest.at.feature;
  const Vec3d away = nearest.p - nearest.at.point;
  const double distance = std::sqrt(nearest.squared);
  Vec3d pseudo = face_normals[t];
  const bool doubt = doubtful[t] >> feature & 1;
  if (!doubt && feature < 3) pseudo = corner_normals[3 * t + feature];
  if (!doubt && feature >= 3 && feature < 6) pseudo = edge_normals[3 * t + feature - 3];
  const double above = dot(away, pseudo);
  bool inside = above < 0;
  if (distance > 1e-12 * diagonal && (doubt || (feature < 6 && std::abs(above) < kGrazing * distance))) inside = solid->at(nearest.p) > 0.5;
  result.distance = inside ? -distance : distance;
  result.point = nearest.at.point;
  result.normal = distance > 1e-9 * diagonal ? away * (1 / result.distance) : pseudo;
  result.triangle = source[t];
  return result;
}

SignedDistance MeshDistance::signed_distance(const Vec3d& p, double radius) const {
  return impl_->with_sign(impl_->search(p, radius, kNoHint));
}

SignedDistance MeshDistance::signed_distance_near(const Vec3d& p, uint32_t& hint) const {
  const Impl::Nearest nearest = impl_->search(p, std::numeric_limits<double>::infinity(), hint);
  hint = nearest.triangle;
  return impl_->with_sign(nearest);
}

double MeshDistance::winding_number(const Vec3d& p) const {
  return impl_->solid->at(p);
}

double MeshDistance::first_hit(const Vec3d& origin, const Vec3d& direction) const {
  const Vec3d q = (origin - impl_->centre) * (1 / impl_->diagonal);
  const RTCRayHit hit = shoot(impl_->scene, q, direction, 0);
  return hit.hit.geomID == RTC_INVALID_GEOMETRY_ID ? std::numeric_limits<double>::infinity() : hit.ray.tfar * impl_->diagonal;
}

bool MeshDistance::closed() const {
  return impl_->closed;
}
bool MeshDistance::overlapping() const {
  return impl_->overlapping;
}
double MeshDistance::diagonal() const {
  return impl_->diagonal;
}
Vec3d MeshDistance::lower() const {
  return impl_->lower;
}
Vec3d MeshDistance::upper() const {
  return impl_->upper;
}

}  // namespace knead
