// One contact sample of the equilibrium's energy (method.md 4): kc/2 a min(0, phi - lambda)^2 for every collider, and its gradient. A sample is a
// point of M that rides in H: y = y_rest + sum w u, all in tet space. Each collider is a constraint of its own with its own memory lambda, so that a
// vertex between two is held by both.
#pragma once
#include <cstddef>
#include <cstdint>

#include "kernels/loop/collide_body.h"
#include "kernels/multigrid/multigrid_body.h"
#include "kernels/row4.h"

namespace knead {

struct ContactSum {
  double energy = 0;
  float deepest = 0;            // penetration, cells
  float change = 0;             // the largest change of a memory that an update would make, cells
  uint32_t active = 0;          // constraints that push
  float squares = 0, area = 0;  // of these changes, weighted with their samples' areas, and those areas; cells^4 and cells^2
};

struct ContactEnergy {
  static constexpr const char* kKernel = "contact_energy";
  static constexpr size_t kGrain = 64;  // a sample in contact costs a look at 27 voxels
  const Row4* u;                        // displacements of H, cells
  const uint32_t* offsets;              // [samples + 1] into indices and weights
  const uint32_t* indices;              // vertices of H
  const float* weights;
  const Vec3f* rest;    // y_rest, cells
  const float* area;    // cells^2
  const float* memory;  // [colliders][samples] lambda, cells
  float* distance;      // [colliders][samples] phi - margin, cells; kFar where it cannot matter
  const float*
      exits;    // [colliders][samples] how far along `entry` a sample that began inside leaves the collider, cells; negative: did not. Null later
  Row4* force;  // [samples] gradient by the sample's place
  const uint32_t* list;    // the samples that may come in contact; null: all, which those that may not leave at once
  const float* slack;      // [samples] how far they may move until then, cells
  const float* travelled;  // how far H has moved at most since the list was made, cells
  ContactSum* result;
  Vec3f entry[kMostColliders];  // unit, the way a collider came in
  ColliderView colliders[kMostColliders];
  uint32_t count;
  uint32_t samples;
  float margin;        // cells
  float stiffness;     // kc, per cell
  float gap;           // where a push begins, cells; 0: at touch
  float gentle;        // how steep the push is there, relative to `stiffness`
  float friction;      // the pull along the collider's surface, at most, over the push that is remembered; 0: none, then `stuck` and `began` are null
  uint32_t known;      // whether `distance` and `normal` are of this place already: only the memory is another
  Row4* normal;        // [colliders][samples] out of the collider, unit, where it pushes; its fourth is how long the distance's gradient is
  const Row4* stuck;   // [colliders][samples] `normal` when the memory was updated
  const float* began;  // [colliders][samples] how far along `entry` from rest the contact began, cells; negative: it is not known

  static constexpr float kFar = 1e30f;

  KNEAD_HD Vec3f moved(uint32_t s) const {
    Vec3f move{0, 0, 0};
    for (uint32_t e = offsets[s]; e < offsets[s + 1]; ++e) move += weights[e] * to_vec(u[indices[e]]);
    return move;
  }

  // The push p, a length, that goes with t = lambda - phi, and its integral over t. A contact at rest (p = lambda) obeys
  //   sqrt(p / (gentle gap)) + sqrt(phi / gap) = 1 while phi > 0: a push that grows from nothing as the gap closes, so that what a vertex does as it
  // meets a collider is smooth in time; any push once there is none left. For gap = 0 that is p = max(0, t), lambda >= 0, phi >= 0.
  struct Push {
    float push = 0, energy = 0, slope = 0;  // slope: dp / dt
  };
  KNEAD_HD Push push_of(float t) const {
    if (!(t > -gap)) return {};
    const float straight = gentle * gap;  // from there on p = t
    if (t >= straight) return {t, 0.5f * t * t + gap * straight / 6, 1};
    const float rise = 1 + t / gap, r = rise / (1 + sqrtf(fmaxf(0.0f, 1 + (gentle - 1) * rise)));
    return {straight * r * r, gap * straight * r * r * r * (0.5f * r * (gentle - 1) + 2.0f / 3), gentle * r / (gentle * r + 1 - r)};
  }

  static KNEAD_HD Vec3d to_index(const ColliderView& c, const Vec3d& y) {
    return {c.matrix[0] * y.x + c.matrix[1] * y.y + c.matrix[2] * y.z + c.offset.x,
            c.matrix[3] * y.x + c.matrix[4] * y.y + c.matrix[5] * y.z + c.offset.y,
            c.matrix[6] * y.x + c.matrix[7] * y.y + c.matrix[8] * y.z + c.offset.z};
  }

  // The pull of friction on a sample that is `away` from where its contact began: back there, along the collider's surface, like a spring as stiff as the
  // contact up to its bound (Coulomb's, with the push and the normal of the last update of the memory). Adds its gradient over kc a, returns its energy.
  KNEAD_HD float stick(const Vec3f& away, const Vec3f& n, float bound, Vec3f& gradient) const {
    const Vec3f slid = away - dot(away, n) * n;
    const float size = length(slid);
    if (size <= bound) {
      gradient += slid;
      return 0.5f * size * size;
    }
    gradient += (bound / size) * slid;
    return bound * size - 0.5f * bound * bound;
  }

  // How far H may travel without a push by any collider on sample s, to be on the safe side, cells.
  KNEAD_HD float room(uint32_t s) const {
    const Vec3f y = rest[s] + moved(s);
    float least = kFar, reach = 1;  // what H travels, a sample outside of it may go farther
    for (uint32_t e = offsets[s]; e < offsets[s + 1]; ++e) reach += weights[e] < 0 ? -2 * weights[e] : 0.0f;
    for (uint32_t k = 0; k < count; ++k) {
      const size_t at = static_cast<size_t>(k) * samples + s;
      if (memory[at] > 0 || (exits && exits[at] >= 0)) return 0;
      SdfSampler sampler(colliders[k].sdf);
      const float room = sampler.least(CollidePush::to_index(colliders[k], y)) * colliders[k].scale - margin - gap;
      least = room < least ? room : least;
    }
    return least > 0 ? least / reach : 0.0f;
  }

  // Sample s does not push.
  KNEAD_HD void leave_out(uint32_t s) const {
    force[s] = {0, 0, 0, 0};
    for (uint32_t k = 0; k < count; ++k) distance[static_cast<size_t>(k) * samples + s] = kFar;
  }

  KNEAD_HD ContactSum operator()(uint32_t place) const {
    const uint32_t s = list ? list[place] : place;
    ContactSum sum;
    if (slack[s] > *travelled) {
      leave_out(s);
      return sum;
    }
    const Vec3f move = moved(s);
    const Vec3d y = to_double(rest[s]) + to_double(move);
    Vec3f push{0, 0, 0};
    for (uint32_t k = 0; k < count; ++k) {
      const ColliderView& c = colliders[k];
      const size_t at = static_cast<size_t>(k) * samples + s;
      const float lambda = memory[at], to_cells = c.scale;
      float phi = kFar;
      Vec3f out{0, 0, 0};
      if (known) {
        phi = distance[at];
        out = normal[at].w * to_vec(normal[at]);
      } else if (exits && exits[at] >= 0) {
        phi = dot(entry[k], move) - exits[at];
        out = entry[k];
      } else {
        SdfSampler sampler(c.sdf);
        const Vec3d p = to_index(c, y);
        if (lambda > 0 || sampler.reaches(to_float(p), (gap + margin) / to_cells)) {
          Vec3f slope;
          phi = sampler.spline(p, slope) * to_cells - margin;
          out = to_cells * CollidePush::from_index(c, slope);
        }
      }
      distance[at] = phi;
      const Push next = push_of(lambda - phi);
      const float change = next.push > lambda ? next.push - lambda : lambda - next.push;
      sum.change = change > sum.change ? change : sum.change;
      if (next.push > 0 || lambda > 0) {
        sum.squares += area[s] * change * change;
        sum.area += area[s];
      }
      sum.deepest = -phi > sum.deepest ? -phi : sum.deepest;
      if (next.push > 0) {
        const float pull = stiffness * area[s] * next.push;
        sum.energy += static_cast<double>(stiffness * area[s]) * static_cast<double>(next.energy);
        ++sum.active;
        push -= pull * out;
        if (!known) {
          const float size = length(out);
          normal[at] = to_row((1 / (size > 1e-20f ? size : 1e-20f)) * out);
          normal[at].w = size;
        }
      }
      if (friction > 0 && lambda > 0 && began[at] >= 0) {
        Vec3f back{0, 0, 0};
        sum.energy += static_cast<double>(stiffness * area[s]) *
                      static_cast<double>(stick(move - began[at] * entry[k], to_vec(stuck[at]), friction * lambda, back));
        push += (stiffness * area[s]) * back;
      }
    }
    force[s] = to_row(push);
    return sum;
  }
  static KNEAD_HD ContactSum combine(const ContactSum& a, const ContactSum& b) {
    return {a.energy + b.energy,
            a.deepest < b.deepest ? b.deepest : a.deepest,
            a.change < b.change ? b.change : a.change,
            a.active + b.active,
            a.squares + b.squares,
            a.area + b.area};
  }
  KNEAD_HD void finish(const ContactSum& sum) const { *result = sum; }

  // Adds sample s's part of the second derivative by its own place, times `by`, to a block: pushes along the colliders' normals, and what friction holds.
  KNEAD_HD void add_block(uint32_t s, float by, float* block) const {
    for (uint32_t k = 0; k < count; ++k) {
      const size_t at = static_cast<size_t>(k) * samples + s;
      const float slope = push_of(memory[at] - distance[at]).slope;
      if (!(slope > 0)) continue;
      const float pull = by * stiffness * area[s] * slope;
      const float n[3] = {normal[at].x, normal[at].y, normal[at].z};
      for (uint32_t c = 0; c < 3; ++c)
        for (uint32_t r = 0; r < 3; ++r) block[3 * c + r] += pull * (friction > 0 ? (r == c ? 1.0f : 0.0f) : n[r] * n[c]);
    }
  }
};

// How far H may travel before a sample is in contact. Of those far from all colliders it is known from the last time.
struct ContactRoom {
  static constexpr const char* kKernel = "contact_list";
  ContactEnergy contact;
  float* slack;
  float skin, travelled;  // since the last time, at most; negative: colliders have moved since
  KNEAD_HD void operator()(uint32_t s) const {
    const float left = slack[s] - travelled;
    slack[s] = travelled >= 0 && left >= skin ? left : contact.room(s);
    if (!(slack[s] < skin)) contact.leave_out(s);
  }
};

// lambda <- the push, after ContactEnergy; none where the field is flat, beyond its band: there a push has no direction, and a memory would take long to
// fade. What friction pulls back to is where the collider is now.
struct ContactMemory {
  static constexpr const char* kKernel = "contact_memory";
  ContactEnergy contact;
  float *memory, *slack;
  Row4* stuck;  // null: no friction
  KNEAD_HD void operator()(uint32_t place) const {
    const uint32_t s = contact.list ? contact.list[place] : place;
    for (uint32_t k = 0; k < contact.count; ++k) {
      const size_t at = static_cast<size_t>(k) * contact.samples + s;
      const float push = contact.push_of(memory[at] - contact.distance[at]).push;
      memory[at] = push > 0 && contact.normal[at].w > 0 ? push : 0.0f;
      if (memory[at] > 0) slack[s] = 0;
      if (stuck) stuck[at] = contact.normal[at];
    }
  }
};

// What the samples that push add to the diagonal of a metric, lumped: a block by place of H.
struct ContactBlocks {
  static constexpr const char* kKernel = "contact_blocks";
  ContactEnergy contact;
  const uint32_t *back_offsets, *back_samples;  // by place
  const float *back_weights, *free;
  float* blocks;
  KNEAD_HD void operator()(uint32_t p) const {
    float* block = blocks + kBlock * static_cast<size_t>(p);
    for (uint32_t k = 0; k < kBlock; ++k) block[k] = 0;
    if (free[p] == 0) return;
    for (uint32_t e = back_offsets[p]; e < back_offsets[p + 1]; ++e) contact.add_block(back_samples[e], back_weights[e], block);
  }
};

struct ScaleFloats {
  static constexpr const char* kKernel = "scale_floats";
  float* values;
  float by;
  uint32_t unused = 0;
  KNEAD_HD void operator()(uint32_t i) const { values[i] *= by; }
};

// How far along the way in a sample must go from rest to be out of the collider again: the one that it began inside, or that it meets within `reach`. A
// sphere as wide as the distance is free of walls, so steps are that long.
struct ContactExit {
  static constexpr const char* kKernel = "contact_exit";
  ContactEnergy contact;
  uint32_t collider;
  float reach;   // cells
  float* exits;  // [samples] of this collider

  KNEAD_HD void operator()(uint32_t s) const {
    const ColliderView& c = contact.colliders[collider];
    const float to_cells = c.scale, least = 0.02f * c.sdf.voxel * to_cells;
    SdfSampler sampler(c.sdf);
    Vec3f y = contact.rest[s];
    bool inside = false;
    float gone = 0;
    for (int step = 0; step < 400; ++step) {
      const float phi = sampler.value(CollidePush::to_index(c, y)) * to_cells - contact.margin;
      if (phi >= 0 && (inside || gone >= reach)) break;
      inside = inside || phi < 0;
      const float size = phi < 0 ? -phi : phi, along = size > least ? size : least;
      gone += along;
      y += along * contact.entry[collider];
    }
    exits[s] = inside ? gone : -1.0f;
  }
};

// Where M's vertices are.
struct VertexPlaces {
  static constexpr const char* kKernel = "vertex_places";
  ContactEnergy contact;
  Row4* now;  // [vertices] cells

  KNEAD_HD void operator()(uint32_t v) const { now[v] = to_row(contact.rest[v] + contact.moved(v)); }
};

// kb/2 V0 (V/V0 - 1 + memory)^2 for M as a whole.
struct EnclosedVolume {
  double stiffness = 0;  // kb
  double rest = 0;       // V0; negative when M is inside out
  double error = 0, memory = 0, energy = 0;
  float push = 0;  // the energy's derivative by V

  KNEAD_HD void take(double volume) {
    if (rest == 0) rest = volume != 0 ? volume : 1e-30;  // the first time M is at rest
    error = volume / rest - 1;
    const double off = error + memory;
    push = static_cast<float>(stiffness * off * (rest < 0 ? -1 : 1));
    energy = 0.5 * stiffness * fabs(rest) * off * off;
  }
};

struct RememberVolume {
  static constexpr const char* kKernel = "remember_volume";
  EnclosedVolume* volume;
  KNEAD_HD void operator()(uint32_t) const { volume->memory += volume->error; }
};

// The volume that M encloses, as a function of its vertices: 6 V = sum over triangles of a . (b x c). A vertex's part of the gradient.
struct VolumeGradient {
  static constexpr const char* kKernel = "enclosed_volume";
  const Row4* now;          // [vertices] cells
  const uint32_t* offsets;  // [vertices + 1] into `pairs`
  const uint32_t* pairs;    // the other two corners of each triangle, in order
  Row4* gradient;           // [vertices]
  EnclosedVolume* result;

  // Its share of the volume: V is homogeneous of degree 3.
  KNEAD_HD double operator()(uint32_t v) const {
    Vec3f sum{0, 0, 0};
    for (uint32_t e = offsets[v]; e < offsets[v + 1]; ++e) sum += cross(to_vec(now[pairs[2 * e]]), to_vec(now[pairs[2 * e + 1]]));
    sum = sum * (1.0f / 6);
    gradient[v] = to_row(sum);
    return static_cast<double>(dot(sum, to_vec(now[v]))) / 3;
  }
  static KNEAD_HD double combine(double a, double b) { return a + b; }
  KNEAD_HD void finish(double volume) const { result->take(volume); }
};

// Adds the enclosed volume's push to a vertex's own.
struct VolumePush {
  static constexpr const char* kKernel = "volume_push";
  const Row4* gradient;
  const EnclosedVolume* volume;
  const float* slack;
  Row4* force;
  float skin;  // from there on a vertex has no push of its own
  uint32_t unused = 0;

  KNEAD_HD void operator()(uint32_t v) const {
    const Vec3f own = slack[v] < skin ? to_vec(force[v]) : Vec3f{0, 0, 0};
    force[v] = to_row(own + volume->push * to_vec(gradient[v]));
  }
};

// The gradient of the enclosed volume by place of H.
struct VolumeByPlace {
  static constexpr const char* kKernel = "volume_by_place";
  const Row4* gradient;  // [vertices]
  uint32_t vertices;     // samples beyond these are no vertices of M
  const uint32_t *back_offsets, *back_samples;
  const float *back_weights, *free;
  Row4* to;
  KNEAD_HD void operator()(uint32_t p) const {
    Vec3f sum{0, 0, 0};
    for (uint32_t e = back_offsets[p]; e < back_offsets[p + 1]; ++e)
      if (back_samples[e] < vertices) sum += back_weights[e] * to_vec(gradient[back_samples[e]]);
    to[p] = to_row(free[p] * sum);
  }
};

}  // namespace knead
