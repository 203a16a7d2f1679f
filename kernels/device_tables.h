// Tables that the host has made, where an executor's kernels can read them: on the host they are the tables themselves, which must stay; on a device
// copies, which live as long as this. Each is a transfer of its own: for what is made once and used by many frames.
#pragma once
#include <span>
#include <vector>

#include "graph/buffer.h"
#include "graph/executor.h"

namespace knead {

template <class T>
Buffer<T> device_copy(Executor& executor, std::span<const T> values) {
  Buffer<T> there(values.size(), executor.memory());
  executor.copy(values.data(), Device{}, there.data_for_write(), executor.device(), values.size_bytes());
  return there;
}

class DeviceTables {
 public:
  template <class T>
  const T* operator()(Executor& executor, std::span<const T> values) {
    if (executor.device() == Device{}) return values.data();
    const Buffer<T> there = device_copy(executor, values);
    kept_.push_back(there.template as<std::byte>());
    return there.view(executor.device()).data();
  }
  template <class T>
  const T* operator()(Executor& executor, const std::vector<T>& values) {
    return (*this)(executor, std::span<const T>(values));
  }
  double bytes() const {
    double sum = 0;
    for (const Buffer<std::byte>& one : kept_) sum += static_cast<double>(one.bytes());
    return sum;
  }

 private:
  std::vector<Buffer<std::byte>> kept_;
};

}  // namespace knead
