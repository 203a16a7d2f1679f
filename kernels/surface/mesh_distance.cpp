#include "kernels/surface/mesh_distance.h"

#include <embree3/rtcore.h>

#include <algorithm>
#include <cmath>

#include "kernels/surface/mesh_distance_impl.h"

namespace knead {
namespace {

constexpr double kSlack = 1e-6;    // of the diagonal: covers Embree's float boxes around the double triangles
constexpr double kGrazing = 0.02;  // a point nearer than this (as a sine) to the tangent plane of an edge or corner asks the winding number

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

std::optional<MeshDistance::Impl::Hit> MeshDistance::Impl::hit_after(float near, const Vec3d& origin, const Vec3d& direction) const {
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
  if (hit.hit.geomID == RTC_INVALID_GEOMETRY_ID) return {};
  return Hit{hit.hit.primID, hit.ray.tfar};
}

// The winding number as the crossings of a ray, ways out minus ways in: fast, but wrong where the ray grazes or meets an edge.
int MeshDistance::Impl::ray_winding(const Vec3d& origin, const Vec3d& direction) const {
  const Vec3d q = (origin - centre) * (1 / diagonal);
  int winding = 0;
  float near = 0;
  for (int hits = 0; hits < 64; ++hits) {
    const std::optional<Hit> hit = hit_after(near, q, direction);
    if (!hit) break;
    winding += dot(face_normals[hit->triangle], direction) > 0 ? 1 : -1;
    near = std::nextafter(hit->distance * (1 + 1e-6f), 2e9f);
  }
  return winding;
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
  const std::optional<Impl::Hit> hit = impl_->hit_after(0, q, direction);
  return hit ? hit->distance * impl_->diagonal : std::numeric_limits<double>::infinity();
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
