// What the benchmarks work on: a capsule in H at four sizes, gently bent and pressed from the side, on whatever device an executor has.
#pragma once
#include <memory>
#include <string>
#include <vector>

#include "graph/executor.h"
#include "kernels/port_types.h"

namespace knead::bench {

struct Body {
  std::string size;  // "50k"
  TetMesh tets;
  Lattice lattice;
  Points points;  // H, bent
  Surface bent;   // M with it
  Points push;    // a displacement of M
  Sdf solid;      // a ball that overlaps the bent body
};

struct Size {
  const char* name;
  int segments;  // of the capsule
  int depth;
};
inline constexpr Size kSizes[] = {{"5k", 6, 8}, {"50k", 21, 9}, {"500k", 54, 10}, {"5M", 187, 11}};

// Built once, on the host.
const Body& host_body(const Size& size);

// "serial", "cpu" or, in builds that have one, another executor's name. Throws Error(kDevice) for what is not there.
std::unique_ptr<Executor> make_executor(const std::string& device, int threads);

// A copy of the value whose buffers live where the executor works; the value itself where that is the host.
template <class T>
T on_device(Executor& executor, T value) {
  if (executor.device() != Device{})
    PortTraits<T>::each_buffer(value, [&]<class E>(Buffer<E>& buffer) {
      if (!buffer) return;
      Buffer<E> moved(buffer.size(), executor.memory());
      executor.copy(buffer.host().data(), Device{}, moved.data_for_write(), executor.device(), buffer.bytes());
      buffer = std::move(moved);
    });
  return value;
}

}  // namespace knead::bench
