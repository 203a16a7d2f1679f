// How a kernel's body reaches a device. A body is a trivially copyable struct of pointers and constants, marked by its kernel's name:
//
//   struct Scale {
//     static constexpr const char* kKernel = "scale";
//     float* values;
//     float by;
//     KNEAD_HD void operator()(uint32_t i) const { values[i] *= by; }
//   };
//
// Executors of devices launch it by its type: kernel_of<Scale>() holds the code for the host, which a fake device runs, and for CUDA, which a .cu
// file instantiates. No header of CUDA is needed here.
#pragma once
#include <cstddef>
#include <cstdint>
#include <type_traits>

#if defined(__CUDACC__)
#define KNEAD_HD __host__ __device__ __forceinline__
#else
#define KNEAD_HD inline __attribute__((always_inline))
#endif

namespace knead {

template <class Body>
concept DeviceBody = requires {
  Body::kKernel;
};

// How CUDA runs a body over [0, n): alone, or those of several frames at once, which lie side by side in device memory; frames that are not `running`
// are left out. Null in a build without CUDA.
struct CudaCode {
  void (*one)(const void* body, uint32_t n, void* stream) = nullptr;
  void (*many)(const void* bodies, const uint32_t* running, uint32_t frames, uint32_t n, void* stream) = nullptr;
};

// Instantiated for every body in kernels/device_bodies.* and graph/loop_bodies.inl.
template <class Body>
CudaCode cuda_code();

struct Kernel {
  const char* name;
  size_t body_bytes;
  void (*host)(const void* body, uint32_t n);  // every index, on the calling thread, with the bits of the serial executor
  CudaCode cuda;
};

template <DeviceBody Body>
const Kernel& kernel_of() {
  static_assert(std::is_trivially_copyable_v<Body> && sizeof(Body) <= 4000);  // kernel parameters, on every device
  static const Kernel kernel{Body::kKernel, sizeof(Body),
                             [](const void* body, uint32_t n) {
                               for (uint32_t i = 0; i < n; ++i) (*static_cast<const Body*>(body))(i);
                             },
                             cuda_code<Body>()};
  return kernel;
}

}  // namespace knead
