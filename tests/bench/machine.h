// What the machine can do at best, measured beside the kernels.
#pragma once
#include <cstddef>
#include <string>

#include "graph/executor.h"

namespace knead::bench {

std::string processor_name();

// Copies `bytes` from one place to another in pieces; both ends were written before.
class Copy {
 public:
  explicit Copy(size_t bytes);
  void run(Executor& executor);
  size_t bytes() const { return from_.bytes(); }

 private:
  Buffer<std::byte> from_, to_;
};

// Independent multiplications and additions in registers, in the widest vectors that the benchmark was compiled for. Returns how many there were.
double multiply_and_add(Executor& executor);

}  // namespace knead::bench
