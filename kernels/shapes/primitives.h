// Closed, manifold, outward-oriented meshes made from a few numbers, so that examples and tests need no files. y is up. Everything is deterministic.
#pragma once
#include <cstdint>
#include <vector>

#include "kernels/port_types.h"

namespace knead {

// A Surface from points (local space) and polygons, given as offsets into a corner list (faces + 1 entries). Triangles and quads only: a quad is cut
// along its shorter diagonal, triangles without area keep their polygon but are left out of `triangles`. Throws Error(kInput) when offsets or indices
// are out of range. Fills topology and the box; placement is the identity and there are no attributes.
KNEAD_API Surface make_surface(std::vector<Vec3f> points, std::vector<uint32_t> face_offsets, std::vector<uint32_t> face_vertices);
KNEAD_API Surface make_triangle_surface(std::vector<Vec3f> points, std::vector<uint32_t> triangles);

// Icosahedron, each triangle split in four `subdivisions` times: 10 * 4^s + 2 vertices, 20 * 4^s triangles, all on the sphere about the origin.
KNEAD_API Surface make_sphere(double radius, int subdivisions);

// Quads on the six faces of a box about the origin; the longest side has `segments`, the others as many as keep the spacing (a, b, c, at least 1):
// 2 (ab + bc + ca) + 2 vertices. A cube has 6 s^2 + 2.
KNEAD_API Surface make_box(const Vec3d& size, int segments);

// Axis y, `height` from tip to tip (never below 2 radius), no poles: a cube's grid wrapped on the caps. With e = segments made even and m rows on the
// straight part (as many as keep the spacing): 6 e^2 + 4 e m + 2 vertices, quads.
KNEAD_API Surface make_capsule(double radius, double height, int segments);

// Axis y, quads: `segments` around the ring times max(3, round(segments * tube / radius)) around the tube. Throws Error(kInput) unless 0 < tube <
// radius.
KNEAD_API Surface make_torus(double radius, double tube, int segments);

// Shapes contoured from smooth implicit functions: triangles of near-uniform size, exactly `vertices` of them, genus 0 (primitives_organic.cpp).
KNEAD_API Surface make_blob(double size, int vertices);    // a lumpy body about the origin, about `size` wide
KNEAD_API Surface make_head(double height, int vertices);  // head and neck, face towards +z, neck cut at the bottom, `height` along y, centred
KNEAD_API Surface make_fist(double size, int vertices);    // right fist about `size` wide, knuckles towards +y, palm towards +z, wrist at the bottom

}  // namespace knead
