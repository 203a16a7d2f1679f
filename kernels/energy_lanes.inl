// Instantiates the equilibrium solver's bodies for lanes of type KNEAD_LANES under the name KNEAD_ENERGY_LANES; see energy_lanes.h.
#include <cstring>

#include "kernels/energy_lanes.h"

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

double dot(const float* a, const float* b, size_t n) {
  constexpr size_t kBlock = 512;  // floats summed in float before they go into the double
  double sum = 0;
  for (size_t begin = 0; begin < n; begin += kBlock) {
    const size_t end = begin + kBlock < n ? begin + kBlock : n;
    constexpr uint32_t kParts = 16 / L::kWidth;
    F part[kParts] = {};
    for (size_t i = begin; i < end; i += 16)
      for (uint32_t k = 0; k < kParts; ++k) part[k] = part[k] + L::load(a + i + k * L::kWidth) * L::load(b + i + k * L::kWidth);
    for (uint32_t k = 0; k < kParts; ++k) sum += total(part[k]);
  }
  return sum;
}

void add_scaled(float* to, const float* from, float by, size_t n) {
  for (size_t i = 0; i < n; i += L::kWidth) put(to + i, L::load(to + i) + L::load(from + i) * by);
}

void combine(float* to, const float* a, const float* b, float by, size_t n) {
  for (size_t i = 0; i < n; i += L::kWidth) put(to + i, L::load(a + i) + L::load(b + i) * by);
}

constexpr EnergyLanes kLanes{
    elastic, each_row<Smooth>, each_row<Residual>, dot, add_scaled, combine};

}  // namespace

const EnergyLanes* KNEAD_ENERGY_LANES() {
  return &kLanes;
}

}  // namespace knead
