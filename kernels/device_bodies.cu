// Every body of the loop and of the multigrid cycle as a CUDA kernel, so that a change that would not compile for a device is found on machines without one. The CUDA executor, when it
// comes, launches these.
#include "kernels/collide_body.h"
#include "kernels/enforce_stiffness_body.h"
#include "kernels/hold_body.h"
#include "kernels/lattice_map_body.h"
#include "kernels/multigrid_body.h"
#include "kernels/restore_volume_body.h"

namespace knead {

template <class Body>
__global__ void run_body(Body body, uint32_t n) {
  const uint32_t i = blockIdx.x * blockDim.x + threadIdx.x;
  if (i < n) body(i);
}

template __global__ void run_body(RestoreVolume, uint32_t);
template __global__ void run_body(EnforceStiffness, uint32_t);
template __global__ void run_body(MapToTets, uint32_t);
template __global__ void run_body(MapToSurface, uint32_t);
template __global__ void run_body(Hold, uint32_t);
template __global__ void run_body(PaintToTets, uint32_t);
template __global__ void run_body(CollidePush, uint32_t);
template __global__ void run_body(AddDisplacement, uint32_t);
template __global__ void run_body(SmoothStart, uint32_t);
template __global__ void run_body(Smooth, uint32_t);
template __global__ void run_body(Residual, uint32_t);
template __global__ void run_body(Restrict, uint32_t);
template __global__ void run_body(Prolong, uint32_t);

}  // namespace knead
