// OpenVDB's side of Sdf: building a sparse grid from any distance function, and level sets from and to .vdb and .nvdb files. The only place that knows
// OpenVDB; what leaves it is a NanoVDB blob. Safe inside any executor.
#pragma once
#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "graph/executor.h"
#include "kernels/port_types.h"

namespace knead {

struct SdfPlan {
  double voxel_size = 0;                      // local units
  Vec3d origin{0, 0, 0};                      // local position of index (0, 0, 0)
  Vec3d lower{0, 0, 0}, upper{0, 0, 0};       // box of the surface, local space
  double band = 4;                            // outside band, voxels; beyond it the grid holds +band * voxel_size
  uint64_t memory_limit = uint64_t{2} << 30;  // bytes that the build may take
  double world_scale = 1;                     // world units per local unit, for messages
  std::optional<std::array<Vec3d, 2>> only;   // lower and upper corner of a box, local space: nothing is built outside; none: all is
  std::vector<std::array<Vec3d, 2>> boxes;    // where true_distances are false: boxes outside which the function is the background; none: anywhere
  std::function<void()> check_cancelled;      // asked all along; null: never
  bool true_distances = true;                 // the function is a distance everywhere; false when it saturates beyond the band
};

// Signed distance at a local position, negative inside. `hint` is the function's own, kept from one position to the next near it (~0u at first), to speed
// up searches; it must not change the result.
using DistanceAt = FunctionRef<double(const Vec3d& local, uint32_t& hint)>;

// Samples `distance` into a grid that knows its whole inside and a band outside. Within about ten voxels of the surface every voxel is sampled; deeper, one
// in 64, where interpolation between those is good to 0.3 voxels. Leaves `placement` and `mesh` to the caller. Throws Error(kMemory) with the estimate and
// a voxel size that would fit, before it allocates. The same bits for any number of threads.
Sdf build_sdf(Executor& executor, const SdfPlan& plan, DistanceAt distance);

// An upper estimate of the bytes that build_sdf takes, by sampling coarsely. true_distances only.
uint64_t estimate_sdf_bytes(Executor& executor, const SdfPlan& plan, DistanceAt distance);

struct ReadSdf {
  Sdf sdf;
  std::vector<std::string> warnings;
};

// A level set from a .vdb or .nvdb file: the grid of that name, or the first level set that holds something when `name` is empty. The grid's transform becomes
// voxel_size and placement; it must be a similarity. A grid that only knows a narrow band inside is completed from its own surface, and what can be mended
// (level_set.cpp) is, with a warning. Throws Error(kFile).
ReadSdf read_sdf(const std::string& path, const std::string& name, Executor& executor, uint64_t memory_limit = uint64_t{2} << 30);

// Writes a level set in world units, whole or not at all; the extension chooses the format. The placement becomes the grid's transform.
void write_sdf(const std::string& path, const Sdf& sdf, const std::string& name);

}  // namespace knead
