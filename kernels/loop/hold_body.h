// The lanes of hold, and the sums of its rigid fit; see hold.h.
#pragma once
#include "kernels/loop/lattice_map_body.h"

namespace knead {

// What takes a moved body back: x + turn (x - centre) + shift, with turn = R^T - 1 and shift = rest centre - centre, so that small motions stay
// accurate.
struct RigidMotion {
  float turn[9] = {};  // row-major
  Vec3f centre{0, 0, 0}, shift{0, 0, 0};
  bool moved = false;
};

// Sums over the vertices of H, each weighted by the volume w of its tets, of its rest position r and its displacement u: what a rigid fit needs. They
// are taken of u and not of x, so that float32 is accurate to the displacement.
struct RigidSums {
  static constexpr int kSums = 23;  // w, w u.u, w u, w r, w u r^T, w r r^T (upper triangle)
  const Vec3f *now, *rest;
  const uint32_t* order;  // the lanes of vertex_tets
  const float* volumes;   // per lane, 0 in padding lanes

  template <class F>
  KNEAD_HD void lane(uint32_t t, F* sums) const {
    using L = Lane<F>;
    const F w = L::load(volumes + t);
    const Vec3<F> r = L::rows(rest, order + t), u = L::rows(now, order + t) - r;
    const Vec3<F> wu = u * w, wr = r * w;
    const F terms[kSums] = {w,          dot(wu, u), wu.x,       wu.y,       wu.z,       wr.x,       wr.y,       wr.z,
                            wu.x * r.x, wu.x * r.y, wu.x * r.z, wu.y * r.x, wu.y * r.y, wu.y * r.z, wu.z * r.x, wu.z * r.y,
                            wu.z * r.z, wr.x * r.x, wr.x * r.y, wr.x * r.z, wr.y * r.y, wr.y * r.z, wr.z * r.z};
    for (int k = 0; k < kSums; ++k) sums[k] = sums[k] + terms[k];
  }
};

struct Hold {
  static constexpr const char* kKernel = "hold";
  const Vec3f* from;  // x, tet space
  const Vec3f* rest;  // x_rest
  Vec3f* to;
  const uint32_t* order;  // the lanes of vertex_tets
  uint32_t lanes;
  const float* weights;  // of the strength, per vertex of H; may be null
  const float* pins;     // 0 free to 1 pinned, per vertex of H; may be null
  float strength;
  const RigidMotion* rigid;  // undone first; may be null

  template <class F>
  KNEAD_HD void lane(uint32_t t) const {
    using L = Lane<F>;
    const uint32_t* j = order + t;
    const Vec3<F> r = L::rows(rest, j);
    Vec3<F> x = L::rows(from, j);
    if (const RigidMotion back = rigid ? *rigid : RigidMotion{}; back.moved) {
      const F dx = x.x - back.centre.x, dy = x.y - back.centre.y, dz = x.z - back.centre.z;
      x.x = x.x + (back.turn[0] * dx + back.turn[1] * dy + back.turn[2] * dz + back.shift.x);
      x.y = x.y + (back.turn[3] * dx + back.turn[4] * dy + back.turn[5] * dz + back.shift.y);
      x.z = x.z + (back.turn[6] * dx + back.turn[7] * dy + back.turn[8] * dz + back.shift.z);
    }
    const F pull = weights ? L::gather(weights, j) * strength : L::all(strength);
    x = moved(x, (r - x) * pull);
    if (pins) {
      const F pin = L::gather(pins, j), one = L::all(1.0f);
      x = moved(x, (r - x) * pin);
      x = {pin >= one ? r.x : x.x, pin >= one ? r.y : x.y, pin >= one ? r.z : x.z};
    }
    L::put_rows(to, j, lanes - t, x);
  }
  KNEAD_HD void operator()(uint32_t t) const { lane<float>(t); }
};

// A lane is a vertex of H that M influences: the largest or the mean weight of those vertices of M.
struct PaintToTets {
  static constexpr const char* kKernel = "paint_to_tets";
  const float* paint;  // per vertex of M
  float* to;
  LaneTable gather;
  bool largest;

  KNEAD_HD void operator()(uint32_t t) const {
    if (gather.valence[t] == 0) return;
    float sum = 0, most = 0;
    for (uint32_t k = 0; k < gather.valence[t]; ++k) {
      const float w = paint[gather.indices[gather.entry(t, k)]];
      sum += gather.values[gather.entry(t, k)] * w;
      most = w > most ? w : most;
    }
    to[gather.order[t]] = largest ? most : sum;
  }
};

}  // namespace knead
