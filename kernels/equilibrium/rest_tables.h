// The tables behind kernels/equilibrium/equilibrium.h. All of H's vertices are numbered by their places in an order that suits the metric.
#pragma once
#include <memory>
#include <mutex>
#include <vector>

#include "kernels/device_tables.h"
#include "kernels/equilibrium/equilibrium.h"
#include "kernels/equilibrium/hessian_body.h"
#include "kernels/multigrid/multigrid.h"
#include "kernels/surface/mesh_distance.h"

namespace knead {

// Points of M that are kept outside the colliders, M's vertices first, as combinations of H's vertices; and the other way round for the vertices.
struct SampleTable {
  uint32_t vertices = 0;
  std::vector<uint32_t> offsets, indices;  // by sample
  std::vector<float> weights;
  std::vector<Vec3f> rest;                           // tet space
  std::vector<float> area;                           // cells^2
  std::vector<Vec3f> outward;                        // area vectors at rest, out of the body, cells^2
  std::vector<uint32_t> back_offsets, back_samples;  // by place; of M's vertices, on a device of all samples
  std::vector<float> back_weights;
  size_t size() const { return area.size(); }
};

// The tables that kernels read, in the memory of the executor that they run on; the names are those of EquilibriumRest and SampleTable.
struct RestTables {
  const uint32_t *corners, *slot_offsets, *slots, *offsets, *indices, *back_offsets, *back_samples, *fan_offsets, *fans, *vertex_at;
  const float *shape, *mu, *lambda, *hold, *free, *weights, *area, *back_weights;
  const uint16_t* slot_places;
  const Vec3f *rest, *sample_rest;
};

// The second derivative as it follows a frame's shape, and what tells where that has changed since.
struct ShapeHessian {
  Hessian now;
  Buffer<float> gradients;                // of TetGradients
  Buffer<uint8_t> changed_tets, changed;  // by tet, by row
};

class EquilibriumRest {
 public:
  Device device;    // where it is for
  RestTables on{};  // there
  ElasticTerm term;
  uint32_t places = 0;              // vertices of H
  uint32_t rows = 0;                // places, padded to a multiple of 16
  Buffer<Vec3f> rest;               // x_rest in H's own numbering, on the device
  std::vector<uint32_t> vertex_at;  // by place
  size_t tets = 0, stride = 0;      // stride: tets, padded to lanes
  Buffer<uint32_t> corners;         // [4][stride]
  Buffer<float> shape, mu, lambda;
  std::vector<uint32_t> slot_offsets, slots;  // by place: which rows of the tets' forces act on it
  std::vector<uint16_t> slot_places;          // [slots][4] as HessianRow has them
  std::vector<float> hold;                    // by place, cells^-2 times cells^3
  std::vector<float> free;                    // 1, or 0 for a pinned place
  bool any_pinned = false;
  SampleTable samples;                                       // M's vertices first
  std::vector<uint32_t> fan_offsets, fans;                   // by vertex of M: the other two corners of its triangles; empty for an open surface
  double stiffness = 0;                                      // sum of mu V0
  double bulk = 0;                                           // Lame's first parameter over the body, for the enclosed volume
  double diagonal = 0;                                       // of M, cells
  Similarity to_local;                                       // tet space to M's local space
  Surface surface;                                           // M
  const MeshDistance& searchable(Executor& executor) const;  // M, for ray casts: made when it is first asked for
  double contact_scale = 1;                                  // kc of `contact` = 1, per cell
  std::unique_ptr<MultigridGrids> grids;
  Hessian hessian;  // at rest
  RestFigures figures;

  // With H displaced by u, in the executor's memory. The first time `shape` is empty.
  void follow(Executor& executor, const Row4* u, ShapeHessian& shape) const;

  void make_device_tables(Executor& executor);
  void make_rest_hessian(Executor& executor);

 private:
  TetGradients gradients_at(const Row4* u, float* to, uint8_t* changed) const;
  HessianRow rows_of(const float* gradients, float* entries, float* diagonal, const uint8_t* changed_tets, uint8_t* changed) const;
  DeviceTables device_tables_;
  mutable std::once_flag searchable_once_;
  mutable std::unique_ptr<MeshDistance> searchable_;
};

// Samples of the surface that `lattice` binds, in places of the metric's order: `steps` subdivisions of a triangle's sides, below 2 vertices only.
// `gathers`: the way back holds all of them.
SampleTable make_samples(const Lattice& lattice, const std::vector<uint32_t>& place, int steps, bool gathers);

}  // namespace knead
