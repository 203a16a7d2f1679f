// In builds without CUDA: no body has a launcher.
#include "kernels/device_bodies.h"

namespace knead {

template <class Body>
CudaLauncher cuda_launcher() {
  return nullptr;
}
#define KNEAD_BODY(Body) template CudaLauncher cuda_launcher<Body>();
#define KNEAD_REDUCTION(Body) template CudaLauncher cuda_launcher<Reduction<Body>>();
#include "kernels/device_bodies.inl"

}  // namespace knead
