// The tables behind kernels/equilibrium/equilibrium.h. H's vertices are permuted to an order that suits the metric; a *permuted vertex* is a vertex by its
// number in that order.
#pragma once
#include <memory>
#include <mutex>
#include <vector>

#include "kernels/device_tables.h"
#include "kernels/equilibrium/equilibrium.h"
#include "kernels/equilibrium/floating_parts.h"
#include "kernels/equilibrium/hessian_body.h"
#include "kernels/equilibrium/samples.h"
#include "kernels/multigrid/multigrid.h"
#include "kernels/surface/mesh_distance.h"

namespace knead {

// The tables that kernels read, in the memory of the executor that they run on; the names are those of EquilibriumRest.
struct RestTables {
  const uint32_t *corners, *incident_offsets, *incident_corners, *link_offsets, *link_edges, *vertex_at, *ghost_offsets, *ghosts, *part_of, *members;
  const float *shape, *mu, *lambda, *hold, *free, *guard, *ghost_values, *mass;
  const uint16_t *incident_entries, *ghost_entries;
  const Vec3f* rest;
  SamplesThere samples;
  const Row4* arms;
  const double* part_inverse;
  const uint32_t* part_tree[FloatingParts::kMostRows];
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
  uint32_t vertices = 0;            // of H
  uint32_t rows = 0;                // vertices, padded to a multiple of 16
  Buffer<Vec3f> rest;               // x_rest in H's own numbering, on the device
  std::vector<uint32_t> vertex_at;  // by permuted vertex: its number in H
  size_t tets = 0, stride = 0;      // stride: tets, padded to lanes
  Buffer<uint32_t> corners;         // [4][stride]
  Buffer<float> shape, mu, lambda;
  std::vector<float> guard;                                  // as ElasticTets has it; the next two are empty where H is flesh throughout
  SparseRows ghosts;                                         // of ghost_penalty.h, by permuted vertex
  std::vector<uint16_t> ghost_entries;                       // [ghosts] as HessianRow has them
  std::vector<uint32_t> incident_offsets, incident_corners;  // by permuted vertex: the corners of tets that it is, as rows of the tets' forces
  std::vector<uint16_t> incident_entries;                    // [incident corners][4] as HessianRow has them
  std::vector<float> hold;                                   // by permuted vertex, cells^-2 times cells^3
  std::vector<float> free;                                   // 1, or 0 for a pinned vertex
  bool any_pinned = false;
  FloatingParts floating;  // none where the body does not keep its place by itself
  SampleTable samples;     // M's vertices first
  std::vector<uint32_t> link_offsets,
      link_edges;        // by vertex of M, its link: the other two corners of each of its triangles; empty for an open surface
  double stiffness = 0;  // sum of mu V0
  double lame = 0;       // Lame's first parameter over the body, for the enclosed volume
  double diagonal = 0;   // of M, cells
  Similarity to_local;   // tet space to M's local space
  Surface surface;       // M
  const MeshDistance& searchable(Executor& executor) const;  // M, for ray casts: made when it is first asked for
  double contact_scale = 1;                                  // kc of `contact` = 1, per cell
  std::unique_ptr<MultigridGrids> grids;
  Hessian hessian;  // at rest
  RestFigures figures;

  // The Hessian with H displaced by u, in the executor's memory. The first time `shape` is empty. `tolerance`: as TetGradients has it.
  void follow(Executor& executor, const Row4* u, float tolerance, ShapeHessian& shape) const;

  void make_device_tables(Executor& executor);
  void make_rest_hessian(Executor& executor);

 private:
  TetGradients gradients_at(const Row4* u, float* to, uint8_t* changed, float tolerance) const;
  HessianRow rows_of(const float* gradients, float* entries, float* diagonal, const uint8_t* changed_tets, uint8_t* changed) const;
  DeviceTables device_tables_;
  mutable std::once_flag searchable_once_;
  mutable std::unique_ptr<MeshDistance> searchable_;
};

}  // namespace knead
