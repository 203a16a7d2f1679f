#include "io/picture/scene.h"

#include <embree3/rtcore.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>
#include <numeric>
#include <string>
#include <utility>

#include "graph/error.h"

namespace knead {

namespace {

Vec3f unit_or(const Vec3f& v, const Vec3f& otherwise) {
  const float size = length(v);
  return size > 1e-30f ? v * (1 / size) : otherwise;
}

// For each vertex the first vertex that stands in the same place.
std::vector<uint32_t> places_of(std::span<const Vec3f> points) {
  std::vector<uint32_t> order(points.size()), place(points.size());
  std::iota(order.begin(), order.end(), 0u);
  const auto less = [&](uint32_t a, uint32_t b) {
    const Vec3f &p = points[a], &q = points[b];
    if (p.x != q.x) return p.x < q.x;
    if (p.y != q.y) return p.y < q.y;
    if (p.z != q.z) return p.z < q.z;
    return a < b;
  };
  const auto sortable = [&](uint32_t v) { return std::isfinite(points[v].x) && std::isfinite(points[v].y) && std::isfinite(points[v].z); };
  const auto end = std::stable_partition(order.begin(), order.end(), sortable);
  std::sort(order.begin(), end, less);
  std::iota(place.begin(), place.end(), 0u);
  for (auto i = order.begin(); i != end; ++i) {
    if (i == order.begin()) continue;
    const Vec3f &p = points[*(i - 1)], &q = points[*i];
    if (p.x == q.x && p.y == q.y && p.z == q.z) place[*i] = place[*(i - 1)];
  }
  return place;
}

}  // namespace

std::vector<Vec3f> smooth_corner_normals(std::span<const Vec3f> points, std::span<const uint32_t> triangles, double crease_degrees) {
  const std::vector<uint32_t> place = places_of(points);
  const size_t corners = triangles.size();
  std::vector<Vec3f> facets(corners / 3), weighted(corners);
  std::vector<uint32_t> offsets(points.size() + 1, 0), at(corners);
  for (size_t c = 0; c < corners; ++c) ++offsets[place[triangles[c]] + 1];
  std::partial_sum(offsets.begin(), offsets.end(), offsets.begin());
  std::vector<uint32_t> next(offsets.begin(), offsets.end() - 1);
  for (size_t c = 0; c < corners; ++c) at[next[place[triangles[c]]]++] = static_cast<uint32_t>(c);
  for (size_t t = 0; t < facets.size(); ++t) {
    Vec3f p[3];
    for (int c = 0; c < 3; ++c) p[c] = points[triangles[3 * t + c]];
    facets[t] = unit_or(cross(p[1] - p[0], p[2] - p[0]), {0, 0, 0});
    for (int c = 0; c < 3; ++c) {
      const Vec3f a = unit_or(p[(c + 1) % 3] - p[c], {0, 0, 0}), b = unit_or(p[(c + 2) % 3] - p[c], {0, 0, 0});
      weighted[3 * t + c] = facets[t] * std::acos(std::clamp(dot(a, b), -1.0f, 1.0f));
    }
  }
  const float cosine = static_cast<float>(std::cos(crease_degrees * std::numbers::pi / 180));
  std::vector<Vec3f> normals(corners);
  for (size_t c = 0; c < corners; ++c) {
    const Vec3f own = facets[c / 3];
    const bool flat = dot(own, own) == 0;
    const uint32_t v = place[triangles[c]];
    Vec3f sum{0, 0, 0};
    for (uint32_t i = offsets[v]; i < offsets[v + 1]; ++i)
      if (flat || dot(facets[at[i] / 3], own) >= cosine) sum += weighted[at[i]];
    normals[c] = unit_or(sum, own);
  }
  return normals;
}

struct RenderScene::Parts {
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;
  std::vector<RenderMesh> meshes;

  ~Parts() {
    if (scene) rtcReleaseScene(scene);
    if (device) rtcReleaseDevice(device);
  }
  void check() const {
    const RTCError error = rtcGetDeviceError(device);
    if (error == RTC_ERROR_NONE) return;
    const ErrorCode code = error == RTC_ERROR_OUT_OF_MEMORY ? ErrorCode::kMemory : ErrorCode::kInternal;
    throw Error(code, "the picture's ray tracer failed with Embree error " + std::to_string(static_cast<int>(error)), "a coarser mesh may do");
  }
};

RenderScene::RenderScene() : parts_(std::make_unique<Parts>()) {
  parts_->device = rtcNewDevice(nullptr);
  if (!parts_->device)
    throw Error(ErrorCode::kInternal, "Embree could not start", "pictures need an x86 processor with SSE2 or an ARM one with Neon");
  parts_->scene = rtcNewScene(parts_->device);
  rtcSetSceneFlags(parts_->scene, RTC_SCENE_FLAG_ROBUST);
}

RenderScene::~RenderScene() = default;

void RenderScene::add(RenderMesh mesh) {
  parts_->meshes.push_back(std::move(mesh));
}

bool RenderScene::empty() const {
  return std::all_of(parts_->meshes.begin(), parts_->meshes.end(), [](const RenderMesh& m) { return m.triangles.empty(); });
}

void RenderScene::commit() {
  for (unsigned id = 0; id < parts_->meshes.size(); ++id) {
    const RenderMesh& mesh = parts_->meshes[id];
    if (mesh.triangles.empty()) continue;
    RTCGeometry geometry = rtcNewGeometry(parts_->device, RTC_GEOMETRY_TYPE_TRIANGLE);
    void* points = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, sizeof(Vec3f), mesh.points.size());
    void* indices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 3 * sizeof(uint32_t), mesh.triangles.size() / 3);
    if (points && indices) {
      std::memcpy(points, mesh.points.data(), mesh.points.size() * sizeof(Vec3f));
      std::memcpy(indices, mesh.triangles.data(), mesh.triangles.size() * sizeof(uint32_t));
      rtcCommitGeometry(geometry);
      rtcAttachGeometryByID(parts_->scene, geometry, id);
    }
    rtcReleaseGeometry(geometry);
    parts_->check();
  }
  rtcCommitScene(parts_->scene);
  parts_->check();
}

RenderHit RenderScene::first_hit(const Vec3f& origin, const Vec3f& direction) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  RTCRayHit ray{};
  ray.ray = {origin.x, origin.y, origin.z, 0, direction.x, direction.y, direction.z, 0, std::numeric_limits<float>::infinity(), 0xffffffffu, 0, 0};
  ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  rtcIntersect1(parts_->scene, &context, &ray);
  RenderHit hit;
  if (ray.hit.geomID == RTC_INVALID_GEOMETRY_ID) return hit;
  const RenderMesh& mesh = parts_->meshes[ray.hit.geomID];
  hit.mesh = static_cast<int>(ray.hit.geomID);
  hit.distance = ray.ray.tfar;
  const float weights[3] = {1 - ray.hit.u - ray.hit.v, ray.hit.u, ray.hit.v};
  const uint32_t* corner = &mesh.triangles[3 * static_cast<size_t>(ray.hit.primID)];
  const Vec3f* normals = &mesh.corner_normals[3 * static_cast<size_t>(ray.hit.primID)];
  hit.facet = unit_or({ray.hit.Ng_x, ray.hit.Ng_y, ray.hit.Ng_z}, -direction);
  const float side = dot(hit.facet, direction) > 0 ? -1.0f : 1.0f;  // seen from inside: shade the inside
  for (int c = 0; c < 3; ++c) {
    hit.place += weights[c] * mesh.points[corner[c]];
    hit.normal += weights[c] * normals[c];
    if (!mesh.values.empty()) hit.value += weights[c] * mesh.values[corner[c]];
  }
  hit.facet = side * hit.facet;
  hit.normal = side * unit_or(hit.normal, side * hit.facet);
  for (int c = 0; c < 3; ++c) {
    const float below = std::min(0.0f, dot(hit.place - mesh.points[corner[c]], side * normals[c]));
    hit.lifted += weights[c] * (hit.place - below * side * normals[c]);
  }
  return hit;
}

uint32_t RenderScene::blocked(const Vec3f& origin, const Vec3f* directions, int count, float reach) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  alignas(64) RTCRay8 rays{};
  alignas(64) int valid[8];
  for (int i = 0; i < 8; ++i) {
    const Vec3f& d = directions[i < count ? i : 0];
    valid[i] = i < count ? -1 : 0;
    rays.org_x[i] = origin.x;
    rays.org_y[i] = origin.y;
    rays.org_z[i] = origin.z;
    rays.dir_x[i] = d.x;
    rays.dir_y[i] = d.y;
    rays.dir_z[i] = d.z;
    rays.tfar[i] = reach;
    rays.mask[i] = 0xffffffffu;
  }
  rtcOccluded8(valid, parts_->scene, &context, &rays);
  uint32_t bits = 0;
  for (int i = 0; i < count; ++i) bits |= rays.tfar[i] < 0 ? 1u << i : 0u;
  return bits;
}

}  // namespace knead
