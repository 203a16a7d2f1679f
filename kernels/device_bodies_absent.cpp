// In builds without CUDA: no body has a launcher.
#include "kernels/device_bodies.h"

namespace knead {

template <class Body>
CudaCode cuda_code() {
  return {};
}
#define KNEAD_BODY(Body) template CudaCode cuda_code<Body>();
#define KNEAD_REDUCTION(Body) template CudaCode cuda_code<Reduction<Body>>();
#include "kernels/device_bodies.inl"

}  // namespace knead
