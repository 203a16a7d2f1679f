// The volume that M encloses, as a part of the equilibrium's energy (kernels/equilibrium.h), and its gradient.
#pragma once
#include "kernels/contact_body.h"

namespace knead {

// Where M's vertices are.
struct VertexPlaces {
  static constexpr const char* kKernel = "vertex_places";
  ContactEnergy contact;
  Row4* now;  // [vertices] cells

  KNEAD_HD void operator()(uint32_t v) const { now[v] = to_row(contact.rest[v] + contact.moved(v)); }
};

// kb/2 V0 (V/V0 - 1 + memory)^2 for M as a whole.
struct EnclosedVolume {
  double stiffness = 0;                    // kb
  double rest = 0;                         // V0; negative when M is inside out
  double error = 0, memory = 0, energy = 0;
  float push = 0;                          // the energy's derivative by V

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
