// Instantiates the equilibrium solver's bodies for lanes of type KNEAD_LANES under the name KNEAD_ENERGY_LANES; see energy_simd.h.
#include <cstring>

#include "kernels/equilibrium/energy_simd.h"

namespace knead {
namespace {

using F = KNEAD_LANES;
using L = Lane<F>;

template <class T>
void put(float* to, const T& v) {
  std::memcpy(to, &v, sizeof v);
}

float total(const F& v) {
  float lanes[L::kWidth], sum = 0;
  put(lanes, v);
  for (const float l : lanes) sum += l;
  return sum;
}

ElasticSum elastic(const ElasticTets& body, uint32_t begin, uint32_t end) {
  ElasticSum sum;
  F least = L::all(sum.least_volume);
  for (uint32_t t = begin; t < end; t += L::kWidth) {
    const ElasticTets::Result<F> result = body.lane<F>(t);
    sum.energy += total(result.energy);
    least = result.volume < least ? result.volume : least;
  }
  float lanes[L::kWidth];
  put(lanes, least);
  for (const float l : lanes) sum.least_volume = l < sum.least_volume ? l : sum.least_volume;
  return sum;
}

template <class Body>
void each_row(const Body& shared, size_t begin, size_t end) {
  const Body body = shared;  // a copy that no row's result can alias
  for (size_t p = begin; p < end; ++p) body(static_cast<uint32_t>(p));
}

constexpr EnergySimd kLanes{elastic, each_row<Smooth>, each_row<Residual>};

}  // namespace

const EnergySimd* KNEAD_ENERGY_LANES() {
  return &kLanes;
}

}  // namespace knead
