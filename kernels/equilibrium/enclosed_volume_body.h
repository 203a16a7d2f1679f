// The volume that M encloses as a whole, as a part of the equilibrium's energy with a multiplier of its own.
#pragma once
#include "kernels/equilibrium/contact_body.h"

namespace knead {

// Positions of M's vertices.
struct VertexPositions {
  static constexpr const char* kKernel = "vertex_positions";
  ContactEnergy contact;
  Row4* now;  // [vertices] cells

  KNEAD_HD void operator()(uint32_t v) const { now[v] = to_row(contact.rest[v] + contact.moved(v)); }
};

// kb/2 V0 (V/V0 - 1 + multiplier)^2 for M as a whole.
struct EnclosedVolume {
  double stiffness = 0;  // kb
  double rest = 0;       // V0; negative when M is inside out
  double error = 0;      // V/V0 - 1
  double multiplier = 0;
  double energy = 0;
  float pressure = 0;  // the energy's derivative by V

  KNEAD_HD void take(double volume) {
    if (rest == 0) rest = volume != 0 ? volume : 1e-30;  // The first evaluation is of M at rest.
    error = volume / rest - 1;
    const double off = error + multiplier;
    pressure = static_cast<float>(stiffness * off * (rest < 0 ? -1 : 1));
    energy = 0.5 * stiffness * fabs(rest) * off * off;
  }
};

struct UpdateVolumeMultiplier {
  static constexpr const char* kKernel = "volume_multiplier";
  EnclosedVolume* volume;
  KNEAD_HD void operator()(uint32_t) const { volume->multiplier += volume->error; }
};

// The enclosed volume as a function of M's vertices: 6 V = sum over triangles of a . (b x c). An index is a vertex and its part of the gradient.
struct VolumeGradient {
  static constexpr const char* kKernel = "enclosed_volume";
  const Row4* now;          // [vertices] cells
  const uint32_t* offsets;  // [vertices + 1] into `pairs`
  const uint32_t* pairs;    // the other two corners of each triangle, in order
  Row4* gradient;           // [vertices]
  EnclosedVolume* result;

  // The vertex's share of the volume: V is homogeneous of degree 3.
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

// Adds the force of the enclosed volume's pressure to a vertex's contact force.
struct AddVolumeForce {
  static constexpr const char* kKernel = "volume_force";
  const Row4* gradient;
  const EnclosedVolume* volume;
  const float* slack;
  Row4* force;
  float skin;  // Vertices with this much slack or more have no contact force.
  uint32_t unused = 0;

  KNEAD_HD void operator()(uint32_t v) const {
    const Vec3f own = slack[v] < skin ? to_vec(force[v]) : Vec3f{0, 0, 0};
    force[v] = to_row(own + volume->pressure * to_vec(gradient[v]));
  }
};

// The gradient of the enclosed volume by permuted vertex of H.
struct VolumeGradientOfH {
  static constexpr const char* kKernel = "volume_gradient_of_h";
  const Row4* gradient;  // [vertices]
  uint32_t vertices;     // Samples from this number on are no vertices of M.
  const uint32_t *transpose_offsets, *transpose_samples;
  const float *transpose_weights, *free;
  Row4* to;
  KNEAD_HD void operator()(uint32_t p) const {
    Vec3f sum{0, 0, 0};
    for (uint32_t e = transpose_offsets[p]; e < transpose_offsets[p + 1]; ++e)
      if (transpose_samples[e] < vertices) sum += transpose_weights[e] * to_vec(gradient[transpose_samples[e]]);
    to[p] = to_row(free[p] * sum);
  }
};

}  // namespace knead
