// Instantiates the loop's bodies for lanes of type KNEAD_LANES under the name KNEAD_LOOP_LANES; see loop_simd.h.
#include "kernels/loop/loop_simd.h"

namespace knead {
namespace {

template <class Body>
void run(const Body& body, uint32_t begin, uint32_t end) {
  for (uint32_t t = begin; t < end; t += Lane<KNEAD_LANES>::kWidth) body.template lane<KNEAD_LANES>(t);
}

void rigid_sums(const RigidSums& body, uint32_t begin, uint32_t end, double* sums) {
  KNEAD_LANES lanes[RigidSums::kSums] = {};
  for (uint32_t t = begin; t < end; t += Lane<KNEAD_LANES>::kWidth) body.lane(t, lanes);
  for (int k = 0; k < RigidSums::kSums; ++k) sums[k] = Lane<KNEAD_LANES>::sum(lanes[k]);
}

constexpr LoopSimd kLanes{run<RestoreVolume>, run<EnforceStiffness>, run<MapToTets>, run<MapToSurface>, run<Hold>, rigid_sums};

}  // namespace

const LoopSimd* KNEAD_LOOP_LANES() {
  return &kLanes;
}

}  // namespace knead
