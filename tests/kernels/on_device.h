// Values on a device, for tests that run on whatever device there is: a fake one always, CUDA where it is present. KNEAD_REQUIRE_CUDA=1 makes its
// absence a failure instead of a skip.
#pragma once
#include <gtest/gtest.h>

#include <cstdlib>
#include <memory>
#include <string>

#include "graph/value.h"
#include "tests/graph/fake_device.h"

namespace knead::on_device {

inline bool cuda_required() {
  const char* required = std::getenv("KNEAD_REQUIRE_CUDA");
  return required && std::string(required) != "0" && std::string(required) != "";
}

// Null where there is none; the test then ends with a skip or a failure.
inline std::unique_ptr<Executor> device_named(const std::string& name, bool graph_loops = true) {
  if (name == "fake") return std::make_unique<DeviceExecutor>(std::make_unique<fake_device::FakeBackend>());
  if (!cuda_devices().devices.empty()) return make_cuda_executor(cuda_devices().devices.front().index, graph_loops);
  if (cuda_required()) ADD_FAILURE() << "KNEAD_REQUIRE_CUDA is set, and there is no CUDA device: " << cuda_devices().missing;
  return nullptr;
}

#define KNEAD_NEEDS(executor) \
  if (!executor) GTEST_SKIP() << "no CUDA device: " << knead::cuda_devices().missing

inline DeviceFigures figures_of(const Executor& executor) {
  return dynamic_cast<const DeviceExecutor&>(executor).figures();
}

template <class T>
Buffer<T> there(Executor& device, const Buffer<T>& host) {
  if (!host) return {};
  Buffer<T> copy(host.size(), device.memory());
  device.copy(host.host().data(), {}, copy.data_for_write(), device.device(), host.bytes());
  device.synchronise();
  return copy;
}
template <class T>
std::vector<T> back(Executor& device, const Buffer<T>& buffer) {
  std::vector<T> copy(buffer.size());
  device.copy(buffer.view(device.device()).data(), device.device(), copy.data(), {}, buffer.bytes());
  device.synchronise();
  return copy;
}

// A value with all its buffers on the device.
template <class T>
T moved(Executor& device, T value) {
  PortTraits<T>::each_buffer(value, [&](auto& buffer) { buffer = there(device, buffer); });
  return value;
}

}  // namespace knead::on_device
