// Vectors of the equilibrium solver: a row of four floats per vertex of H, zero to begin with, in the executor's memory.
#pragma once
#include "graph/buffer.h"
#include "graph/executor.h"
#include "graph/loop.h"
#include "kernels/parallel.h"
#include "kernels/row4.h"

namespace knead {

// Storage in the executor's memory, of which every word is `word`.
template <class T>
Buffer<T> filled(Executor& executor, size_t n, uint32_t word = 0) {
  Buffer<T> made(n, executor.memory());
  parallel_for(executor, made.bytes() / sizeof word, FillWords{reinterpret_cast<uint32_t*>(made.data_for_write()), word}, size_t{1} << 16);
  return made;
}

// The same buffer with room for `size`: what is new has words `word`.
template <class T>
void grow(Executor& executor, Buffer<T>& buffer, size_t size, uint32_t word = 0) {
  Buffer<T> larger = filled<T>(executor, size, word);
  const CopyWords old{reinterpret_cast<const uint32_t*>(buffer.view(executor.device()).data()), reinterpret_cast<uint32_t*>(larger.data_for_write())};
  parallel_for(executor, buffer.bytes() / sizeof word, old, size_t{1} << 16);
  buffer = std::move(larger);
}

class Rows {
 public:
  Rows(Executor& executor, size_t n) : buffer_(filled<Row4>(executor, n)) {}
  Row4* data() { return buffer_.data_for_write(); }

 private:
  Buffer<Row4> buffer_;
};

}  // namespace knead
