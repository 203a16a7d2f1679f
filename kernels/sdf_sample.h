// Sampling of a NanoVDB level set, one body for host and device. Positions are in index space, where voxel centres are whole numbers and the distance
// between two of them is one voxel; values come back in the grid's own units. Outside the grid every value is the positive background.
//
// For energies there is `spline`: value and gradient of the quadratic B-spline of the 27 voxels around p, which belong together and are both
// continuous. Where the field is curved it lies a fraction of a voxel off: h^2 / 8 times the Laplacian.
//
// Two other gradients: that of the trilinear interpolant is consistent with the value but jumps where a voxel ends; the smooth one interpolates
// central differences, is continuous, and is what pushes use, so that a slow motion of the collider turns normals slowly. It looks at 32 voxels
// instead of 8.
#pragma once
#include <nanovdb/NanoVDB.h>

#include "kernels/vec.h"

namespace knead {

struct SdfView {
  const nanovdb::NanoGrid<float>* grid = nullptr;
  Vec3f lower{0, 0, 0}, upper{0, 0, 0};  // outside this box (index space) every sample is the background
  float voxel = 3.4e38f;                 // a voxel's width in the values' units; only `reaches` and `least` ask
};

// One per thread: it remembers the last path through the tree.
class SdfSampler {
 public:
  KNEAD_HD explicit SdfSampler(const SdfView& view) : view_(view), accessor_(view.grid->tree().root()) {}

  KNEAD_HD float background() { return accessor_.root().background(); }

  KNEAD_HD float value(const Vec3f& p) {
    if (!within(p)) return accessor_.root().background();
    Cell cell;
    read(p, cell);
    return interpolate(cell.corners, cell.u, cell.v, cell.w);
  }

  KNEAD_HD float value_and_gradient(const Vec3f& p, Vec3f& gradient) {
    gradient = {0, 0, 0};
    if (!within(p)) return accessor_.root().background();
    Cell cell;
    read(p, cell);
    const float* c = cell.corners;
    const float u = cell.u, v = cell.v, w = cell.w;
    gradient.x = mix(mix(c[4] - c[0], c[5] - c[1], w), mix(c[6] - c[2], c[7] - c[3], w), v);
    gradient.y = mix(mix(c[2] - c[0], c[3] - c[1], w), mix(c[6] - c[4], c[7] - c[5], w), u);
    gradient.z = mix(mix(c[1] - c[0], c[3] - c[2], v), mix(c[5] - c[4], c[7] - c[6], v), u);
    return interpolate(c, u, v, w);
  }

  // Trilinear interpolation of the central differences at the eight voxels around p, per voxel.
  KNEAD_HD Vec3f smooth_gradient(const Vec3f& p) {
    if (!within(p)) return {0, 0, 0};
    const float fx = std::floor(p.x), fy = std::floor(p.y), fz = std::floor(p.z);
    const Block block(accessor_, static_cast<int>(fx) - 1, static_cast<int>(fy) - 1, static_cast<int>(fz) - 1);
    const float u = p.x - fx, v = p.y - fy, w = p.z - fz;
    Vec3f sum{0, 0, 0};
    for (int n = 0; n < 8; ++n) {
      const int a = n >> 2, b = n >> 1 & 1, c = n & 1;
      const float weight = 0.5f * (a ? u : 1 - u) * (b ? v : 1 - v) * (c ? w : 1 - w);
      sum.x += weight * (block.at(a + 2, b + 1, c + 1) - block.at(a, b + 1, c + 1));
      sum.y += weight * (block.at(a + 1, b + 2, c + 1) - block.at(a + 1, b, c + 1));
      sum.z += weight * (block.at(a + 1, b + 1, c + 2) - block.at(a + 1, b + 1, c));
    }
    return sum;
  }

  // In double up to the voxel: the place in a voxel is all that counts, and energies see its rounding.
  KNEAD_HD float spline(const Vec3d& p, Vec3f& gradient) {
    gradient = {0, 0, 0};
    if (!within(to_float(p))) return accessor_.root().background();
    const double fx = std::floor(p.x + 0.5), fy = std::floor(p.y + 0.5), fz = std::floor(p.z + 0.5);
    const Block block(accessor_, static_cast<int>(fx) - 1, static_cast<int>(fy) - 1, static_cast<int>(fz) - 1);
    const Quadratic x(static_cast<float>(p.x - fx)), y(static_cast<float>(p.y - fy)), z(static_cast<float>(p.z - fz));
    float value = 0;
    for (int a = 0; a < 3; ++a)
      for (int b = 0; b < 3; ++b) {
        const float c0 = block.at(a, b, 0), c1 = block.at(a, b, 1), c2 = block.at(a, b, 2);
        const float along = z.weight[0] * c0 + z.weight[1] * c1 + z.weight[2] * c2;
        const float xy = x.weight[a] * y.weight[b];
        value += xy * along;
        gradient.x += x.slope[a] * y.weight[b] * along;
        gradient.y += x.weight[a] * y.slope[b] * along;
        gradient.z += xy * (z.slope[0] * c0 + z.slope[1] * c1 + z.slope[2] * c2);
      }
    return value;
  }

  // False when the spline at p is certainly above `value`: one voxel is looked at instead of 27. A distance grows by at most 1 a voxel's width.
  KNEAD_HD bool reaches(const Vec3f& p, float value) { return within(p) && least(p) < value; }

  // The spline at p is not below this; outside the box it grows with the distance from it.
  KNEAD_HD float least(const Vec3f& p) {
    if (!within(p)) return accessor_.root().background() + view_.voxel * length(Vec3f{beyond(p.x, 0), beyond(p.y, 1), beyond(p.z, 2)});
    const float near =
        at(static_cast<int>(std::floor(p.x + 0.5f)), static_cast<int>(std::floor(p.y + 0.5f)), static_cast<int>(std::floor(p.z + 0.5f)));
    constexpr float kReach = 2.7f;  // voxels to the farthest of the 27, and then some for a field that is not quite a distance
    return near - kReach * view_.voxel;
  }

 private:
  struct Quadratic {
    float weight[3], slope[3];
    KNEAD_HD explicit Quadratic(float t)  // t from -0.5 to 0.5
        : weight{0.5f * (0.5f - t) * (0.5f - t), 0.75f - t * t, 0.5f * (0.5f + t) * (0.5f + t)}, slope{t - 0.5f, -2 * t, t + 0.5f} {}
  };
  using Grid = nanovdb::NanoGrid<float>;
  struct Cell {
    float corners[8];  // 4 x + 2 y + z
    float u, v, w;
  };

  // The 4 x 4 x 4 voxels from (x, y, z): they lie in one leaf, two, four or eight, which are looked up once each.
  struct Block {
    const float* values[8];  // of a leaf, or the one of a tile,
    uint32_t mask[8];        // where every offset is 0
    float tiles[8];
    int x, y, z;

    KNEAD_HD Block(nanovdb::DefaultReadAccessor<float>& accessor, int first_x, int first_y, int first_z) : x(first_x), y(first_y), z(first_z) {
      const int last_x = (x & 7) > 4, last_y = (y & 7) > 4, last_z = (z & 7) > 4;
      for (int a = 0; a <= last_x; ++a)
        for (int b = 0; b <= last_y; ++b)
          for (int c = 0; c <= last_z; ++c) {
            const nanovdb::Coord corner(x + 3 * a, y + 3 * b, z + 3 * c);
            const int n = 4 * a + 2 * b + c;
            const nanovdb::NanoLeaf<float>* leaf = accessor.probeLeaf(corner);
            if (!leaf) tiles[n] = accessor.getValue(corner);
            values[n] = leaf ? leaf->data()->mValues : tiles + n;
            mask[n] = leaf ? ~0u : 0u;
          }
    }
    Block(const Block&) = delete;
    Block& operator=(const Block&) = delete;
    KNEAD_HD float at(int a, int b, int c) const {
      const int i = (x & 7) + a, j = (y & 7) + b, k = (z & 7) + c;
      const int n = (i >> 3) * 4 + (j >> 3) * 2 + (k >> 3);
      return values[n][static_cast<uint32_t>((i & 7) << 6 | (j & 7) << 3 | (k & 7)) & mask[n]];
    }
  };

  // False for NaN too.
  KNEAD_HD bool within(const Vec3f& p) const {
    return p.x > view_.lower.x && p.y > view_.lower.y && p.z > view_.lower.z && p.x < view_.upper.x && p.y < view_.upper.y && p.z < view_.upper.z;
  }
  KNEAD_HD float beyond(float at, int axis) const {
    const float below = view_.lower[axis] - at, above = at - view_.upper[axis];
    return below > 0 ? below : above > 0 ? above : 0.0f;
  }
  static KNEAD_HD float mix(float a, float b, float t) { return a + t * (b - a); }
  static KNEAD_HD float interpolate(const float* c, float u, float v, float w) {
    return mix(mix(mix(c[0], c[1], w), mix(c[2], c[3], w), v), mix(mix(c[4], c[5], w), mix(c[6], c[7], w), v), u);
  }
  KNEAD_HD float at(int x, int y, int z) { return accessor_.getValue(nanovdb::Coord(x, y, z)); }

  KNEAD_HD void read(const Vec3f& p, Cell& cell) {
    const float fx = std::floor(p.x), fy = std::floor(p.y), fz = std::floor(p.z);
    const int i = static_cast<int>(fx), j = static_cast<int>(fy), k = static_cast<int>(fz);
    cell.u = p.x - fx;
    cell.v = p.y - fy;
    cell.w = p.z - fz;
    if ((i & 7) != 7 && (j & 7) != 7 && (k & 7) != 7) {  // all eight in one leaf
      if (const auto* leaf = accessor_.probeLeaf(nanovdb::Coord(i, j, k))) {
        const uint32_t first = static_cast<uint32_t>((i & 7) << 6 | (j & 7) << 3 | (k & 7));
        for (uint32_t n = 0; n < 8; ++n) cell.corners[n] = leaf->getValue(first + (n >> 2) * 64 + (n >> 1 & 1) * 8 + (n & 1));
        return;
      }
      const float tile = at(i, j, k);
      for (float& corner : cell.corners) corner = tile;
      return;
    }
    for (int n = 0; n < 8; ++n) cell.corners[n] = at(i + (n >> 2), j + (n >> 1 & 1), k + (n & 1));
  }

  SdfView view_;
  nanovdb::DefaultReadAccessor<float> accessor_;
};

}  // namespace knead
