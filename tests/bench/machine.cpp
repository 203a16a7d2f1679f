#include "tests/bench/machine.h"

#include <algorithm>
#include <cstring>
#include <fstream>

#include "kernels/pack.h"

namespace knead::bench {
namespace {

#if defined(__AVX512F__)
constexpr int kWidth = 16;
#elif defined(__AVX2__)
constexpr int kWidth = 8;
#else
constexpr int kWidth = 4;
#endif
constexpr int kChains = 12, kRounds = 20000;  // as many chains as hide an addition's latency on two units

typedef float Vector __attribute__((vector_size(4 * kWidth)));

float chains(float seed) {
  Vector a[kChains], factor = Vector{} + 0.5f, term = Vector{} + seed;
  for (int k = 0; k < kChains; ++k) a[k] = term + static_cast<float>(k);
  for (int round = 0; round < kRounds; ++round)
    for (int k = 0; k < kChains; ++k) a[k] = a[k] * factor + term;
  Vector sum = a[0];
  for (int k = 1; k < kChains; ++k) sum = sum + a[k];
  return sum[0];
}

}  // namespace

std::string processor_name() {
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);)
    if (line.starts_with("model name")) return line.substr(line.find(':') + 2);
  return "unknown processor";
}

Copy::Copy(size_t bytes) : from_(bytes), to_(bytes) {
  std::memset(from_.data_for_write(), 1, bytes);
  std::memset(to_.data_for_write(), 2, bytes);
}

void Copy::run(Executor& executor) {
  const std::byte* from = from_.host().data();
  std::byte* to = to_.data_for_write();
  const size_t piece = std::max<size_t>(from_.bytes() / 64, 4096);
  executor.parallel_ranges(from_.bytes(), piece, [&](size_t begin, size_t end) { std::memcpy(to + begin, from + begin, end - begin); });
}

double multiply_and_add(Executor& executor) {
  const size_t pieces = 16 * static_cast<size_t>(executor.threads());
  volatile float sink = 0;
  executor.parallel_ranges(pieces, 1, [&](size_t begin, size_t) { sink = chains(1 + 1e-3f * static_cast<float>(begin)); });
  (void)sink;
  return 2.0 * kWidth * kChains * kRounds * static_cast<double>(pieces);
}

}  // namespace knead::bench
