// The loop's kernels compiled per instruction set: loop_simd.inl is included by one source per level, which CMake compiles with that level's flags
// (simd_sources.cmake). Only plain bodies go in there, so that no inline function of a header can be linked in with instructions the processor lacks.
#pragma once
#include <cstdint>

#include "graph/executor.h"
#include "kernels/loop/enforce_stiffness_body.h"
#include "kernels/loop/hold_body.h"
#include "kernels/loop/lattice_map_body.h"
#include "kernels/loop/restore_volume_body.h"

namespace knead {

// Each runs a body over the lanes [begin, end); begin is a multiple of NeighbourTable::kLaneBlock.
struct LoopSimd {
  void (*restore_volume)(const RestoreVolume&, uint32_t begin, uint32_t end);
  void (*enforce_stiffness)(const EnforceStiffness&, uint32_t begin, uint32_t end);
  void (*map_to_tets)(const MapToTets&, uint32_t begin, uint32_t end);
  void (*map_to_surface)(const MapToSurface&, uint32_t begin, uint32_t end);
  void (*hold)(const Hold&, uint32_t begin, uint32_t end);
  void (*rigid_sums)(const RigidSums&, uint32_t begin, uint32_t end, double* sums);  // sums[RigidSums::kSums] of these lanes alone
};

// Null when the level is not in this build.
const LoopSimd* loop_simd_scalar();
const LoopSimd* loop_simd_baseline();
const LoopSimd* loop_simd_avx2();
const LoopSimd* loop_simd_avx512();

// Those of the executor's simd_level.
const LoopSimd& loop_simd(const Executor& executor);

inline constexpr size_t kLanesPerPiece = 512;

// Runs one of them over all lanes in fixed pieces; on a device, the body itself.
template <DeviceBody Body>
void run_lanes(Executor& executor, uint32_t lanes, const Body& body, void (*run)(const Body&, uint32_t, uint32_t)) {
  if (executor.device() != Device{}) return executor.launch(body, lanes);
  executor.parallel_ranges(lanes, kLanesPerPiece,
                           [&](size_t begin, size_t end) { run(body, static_cast<uint32_t>(begin), static_cast<uint32_t>(end)); });
}

}  // namespace knead
