#include "kernels/shapes/primitives.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <utility>

#include "graph/error.h"

namespace knead {

namespace {

struct Polygons {
  std::vector<Vec3f> points;
  std::vector<uint32_t> offsets{0};
  std::vector<uint32_t> corners;

  void quad(uint32_t a, uint32_t b, uint32_t c, uint32_t d) {
    corners.insert(corners.end(), {a, b, c, d});
    offsets.push_back(static_cast<uint32_t>(corners.size()));
  }
  Surface surface() { return make_surface(std::move(points), std::move(offsets), std::move(corners)); }
};

bool has_area(const std::vector<Vec3f>& points, uint32_t a, uint32_t b, uint32_t c) {
  if (a == b || b == c || c == a) return false;
  const Vec3d p = to_double(points[a]);
  const Vec3d area = cross(to_double(points[b]) - p, to_double(points[c]) - p);
  return dot(area, area) > 0;
}

void add_triangle(const std::vector<Vec3f>& points, MeshTopology& topology, size_t face, uint32_t a, uint32_t b, uint32_t c) {
  if (!has_area(points, a, b, c)) return;
  topology.triangles.insert(topology.triangles.end(), {a, b, c});
  topology.triangle_faces.push_back(static_cast<uint32_t>(face));
}

// The grid points on the surface of a box of `n` cells a side, and the quads between them, outward.
template <class Position>
Polygons box_grid(const std::array<int, 3>& n, Position position) {
  Polygons mesh;
  const auto index = [&](int i, int j, int k) { return (static_cast<size_t>(i) * (n[1] + 1) + j) * (n[2] + 1) + k; };
  std::vector<uint32_t> id(index(n[0], n[1], n[2]) + 1, 0);
  for (int i = 0; i <= n[0]; ++i)
    for (int j = 0; j <= n[1]; ++j)
      for (int k = 0; k <= n[2]; ++k) {
        if (i != 0 && i != n[0] && j != 0 && j != n[1] && k != 0 && k != n[2]) continue;
        id[index(i, j, k)] = static_cast<uint32_t>(mesh.points.size());
        mesh.points.push_back(to_float(position(i, j, k)));
      }
  for (int axis = 0; axis < 3; ++axis)
    for (int side = 0; side < 2; ++side) {
      const int u = (axis + 1) % 3, v = (axis + 2) % 3;
      for (int a = 0; a < n[u]; ++a)
        for (int b = 0; b < n[v]; ++b) {
          const auto at = [&](int du, int dv) {
            std::array<int, 3> g{};
            g[axis] = side ? n[axis] : 0;
            g[u] = a + du;
            g[v] = b + dv;
            return id[index(g[0], g[1], g[2])];
          };
          if (side)
            mesh.quad(at(0, 0), at(1, 0), at(1, 1), at(0, 1));
          else
            mesh.quad(at(0, 0), at(0, 1), at(1, 1), at(1, 0));
        }
    }
  return mesh;
}

int segments_for(double side, double spacing) {
  return std::max(1, static_cast<int>(std::lround(side / spacing)));
}

void require(bool good, const char* what, const char* hint) {
  if (!good) throw Error(ErrorCode::kInput, what, hint);
}

}  // namespace

Surface make_surface(std::vector<Vec3f> points, std::vector<uint32_t> face_offsets, std::vector<uint32_t> face_vertices) {
  require(!face_offsets.empty() && face_offsets.front() == 0 && face_offsets.back() == face_vertices.size(),
          "face offsets do not span the corner list", "they start with 0 and end with the number of corners");
  auto topology = std::make_shared<MeshTopology>();
  Vec3f lower{INFINITY, INFINITY, INFINITY}, upper{-INFINITY, -INFINITY, -INFINITY};
  for (uint32_t v : face_vertices) {
    require(v < points.size(), "a face names a vertex that does not exist", "indices count from 0");
    const Vec3f& p = points[v];
    if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z)) continue;
    for (int k = 0; k < 3; ++k) {
      lower[k] = std::min(lower[k], p[k]);
      upper[k] = std::max(upper[k], p[k]);
    }
  }
  for (size_t f = 0; f + 1 < face_offsets.size(); ++f) {
    require(face_offsets[f] <= face_offsets[f + 1], "face offsets fall", "each is the end of the face before");
    const uint32_t* c = face_vertices.data() + face_offsets[f];
    const uint32_t corners = face_offsets[f + 1] - face_offsets[f];
    require(corners == 3 || corners == 4, "a face has neither three nor four corners", "use triangles and quads");
    if (corners == 3) {
      add_triangle(points, *topology, f, c[0], c[1], c[2]);
      continue;
    }
    const Vec3d first = to_double(points[c[2]]) - to_double(points[c[0]]), second = to_double(points[c[3]]) - to_double(points[c[1]]);
    const int start = dot(second, second) < dot(first, first) * (1 - 1e-6) ? 1 : 0;  // a tie must not depend on rounding
    add_triangle(points, *topology, f, c[start], c[start + 1], c[start + 2]);
    add_triangle(points, *topology, f, c[start], c[start + 2], c[(start + 3) % 4]);
  }
  Surface surface;
  if (lower.x <= upper.x) {
    surface.lower = lower;
    surface.upper = upper;
  }
  surface.points = Buffer<Vec3f>(points);
  topology->face_offsets = std::move(face_offsets);
  topology->face_vertices = std::move(face_vertices);
  surface.topology = std::move(topology);
  return surface;
}

Surface make_triangle_surface(std::vector<Vec3f> points, std::vector<uint32_t> triangles) {
  std::vector<uint32_t> offsets(triangles.size() / 3 + 1);
  for (size_t f = 0; f < offsets.size(); ++f) offsets[f] = static_cast<uint32_t>(3 * f);
  return make_surface(std::move(points), std::move(offsets), std::move(triangles));
}

Surface make_sphere(double radius, int subdivisions) {
  require(radius > 0, "a sphere needs a positive radius", "in world units");
  require(subdivisions >= 0 && subdivisions <= 10, "a sphere takes 0 to 10 subdivisions", "10 is ten million vertices");
  const double g = std::numbers::phi;
  std::vector<Vec3d> points{{-1, g, 0},  {1, g, 0},  {-1, -g, 0}, {1, -g, 0}, {0, -1, g},  {0, 1, g},
                            {0, -1, -g}, {0, 1, -g}, {g, 0, -1},  {g, 0, 1},  {-g, 0, -1}, {-g, 0, 1}};
  std::vector<uint32_t> triangles{0, 11, 5, 0, 5, 1, 0, 1, 7, 0, 7, 10, 0, 10, 11, 1, 5, 9, 5, 11, 4,  11, 10, 2,  10, 7, 6, 7, 1, 8,
                                  3, 9,  4, 3, 4, 2, 3, 2, 6, 3, 6, 8,  3, 8,  9,  4, 9, 5, 2, 4,  11, 6,  2,  10, 8,  6, 7, 9, 8, 1};
  for (Vec3d& p : points) p = p * (1 / length(p));
  for (int level = 0; level < subdivisions; ++level) {
    std::map<std::pair<uint32_t, uint32_t>, uint32_t> middles;
    const auto middle = [&](uint32_t a, uint32_t b) {
      const auto [place, fresh] = middles.try_emplace(std::minmax(a, b), static_cast<uint32_t>(points.size()));
      if (fresh) {
        const Vec3d m = points[a] + points[b];
        points.push_back(m * (1 / length(m)));
      }
      return place->second;
    };
    std::vector<uint32_t> finer;
    finer.reserve(triangles.size() * 4);
    for (size_t t = 0; t < triangles.size(); t += 3) {
      const uint32_t a = triangles[t], b = triangles[t + 1], c = triangles[t + 2];
      const uint32_t ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      finer.insert(finer.end(), {a, ab, ca, b, bc, ab, c, ca, bc, ab, bc, ca});
    }
    triangles = std::move(finer);
  }
  std::vector<Vec3f> scaled;
  scaled.reserve(points.size());
  for (const Vec3d& p : points) scaled.push_back(to_float(p * radius));
  return make_triangle_surface(std::move(scaled), std::move(triangles));
}

Surface make_box(const Vec3d& size, int segments) {
  require(size.x > 0 && size.y > 0 && size.z > 0, "a box needs positive sides", "in world units");
  require(segments >= 1 && segments <= 2000, "a box takes 1 to 2000 segments a side", "2000 is 24 million vertices");
  const double spacing = std::max({size.x, size.y, size.z}) / segments;
  const std::array<int, 3> n{segments_for(size.x, spacing), segments_for(size.y, spacing), segments_for(size.z, spacing)};
  return box_grid(n,
                  [&](int i, int j, int k) {
                    return Vec3d{size.x * (static_cast<double>(i) / n[0] - 0.5), size.y * (static_cast<double>(j) / n[1] - 0.5),
                                 size.z * (static_cast<double>(k) / n[2] - 0.5)};
                  })
      .surface();
}

Surface make_capsule(double radius, double height, int segments) {
  require(radius > 0 && height > 0, "a capsule needs a positive radius and height", "in world units");
  require(segments >= 2 && segments <= 2000, "a capsule takes 2 to 2000 segments", "2000 is 24 million vertices");
  const int n = segments + segments % 2;
  const double straight = std::max(0.0, height - 2 * radius);
  const double spacing = std::numbers::pi / 2 * radius / n;  // of a quarter circle's worth of cells
  require(straight < 1e5 * spacing, "a capsule this long and thin would need too many quads", "fewer segments, or a larger radius");
  const int rows = straight > 0 ? segments_for(straight, spacing) : 0;
  const auto angle = [&](int i) { return std::tan(std::numbers::pi / 4 * (2.0 * i / n - 1)); };  // equal angles keep the quads alike
  return box_grid({n, n + rows, n},
                  [&](int i, int j, int k) {
                    const bool below = j <= n / 2, above = j >= n / 2 + rows;
                    const Vec3d cube{angle(i), below ? angle(j) : above ? angle(j - rows) : 0, angle(k)};
                    const double lift = rows == 0 ? 0 : straight * (below ? -0.5 : above ? 0.5 : static_cast<double>(j - n / 2) / rows - 0.5);
                    return cube * (radius / length(cube)) + Vec3d{0, lift, 0};
                  })
      .surface();
}

Surface make_torus(double radius, double tube, int segments) {
  require(tube > 0 && radius > tube, "a torus needs 0 < tube < radius", "radius is from the centre to the middle of the tube");
  require(segments >= 3 && segments <= 10000, "a torus takes 3 to 10000 segments", "around the ring");
  const int around = std::max(3, static_cast<int>(std::lround(segments * tube / radius)));
  Polygons mesh;
  for (int i = 0; i < segments; ++i)
    for (int j = 0; j < around; ++j) {
      const double u = 2 * std::numbers::pi * i / segments, v = 2 * std::numbers::pi * j / around;
      const double ring = radius + tube * std::cos(v);
      mesh.points.push_back(to_float({ring * std::cos(u), tube * std::sin(v), ring * std::sin(u)}));
    }
  const auto at = [&](int i, int j) { return static_cast<uint32_t>((i % segments) * around + j % around); };
  for (int i = 0; i < segments; ++i)
    for (int j = 0; j < around; ++j) mesh.quad(at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j));
  return mesh.surface();
}

}  // namespace knead
