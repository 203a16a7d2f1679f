// What the loop's launchers share: storage of per-vertex rows.
#pragma once
#include <cstring>

#include "graph/executor.h"
#include "kernels/array_ops_body.h"
#include "kernels/check_size.h"
#include "kernels/parallel.h"
#include "kernels/vec.h"

namespace knead {

// Relative errors of volume and length up to this are rounding: H's rest coordinates are multiples of half a cell, so volumes and lengths at rest are
// reproduced to a few units in the last place. Ignoring them makes the rest shape an exact fixed point of the loop.
inline constexpr float kRestRounding = 1e-6f;

// The same values in storage that may be over-read. Only wrapped storage is copied, and on devices nothing is over-read.
inline Buffer<Vec3f> padded(Executor& executor, const Buffer<Vec3f>& values) {
  if (values.empty() || values.is_padded() || executor.device() != Device{}) return values;
  Buffer<Vec3f> copy(values.size(), executor.memory());
  std::memcpy(copy.data_for_write(), values.host().data(), values.bytes());
  return copy;
}

// Storage for a kernel's result. When not every vertex has a lane, those without keep their value.
inline Buffer<Vec3f> start_from(Executor& executor, const Buffer<Vec3f>& values, size_t lanes) {
  Buffer<Vec3f> result(values.size(), executor.memory());
  if (lanes == values.size()) return result;
  const CopyPoints copy{values.view(executor.device()).data(), result.data_for_write()};
  if (executor.device() != Device{})
    executor.launch(copy, values.size());
  else
    executor.parallel_ranges(values.size(), 8 * kGrain,
                             [&](size_t begin, size_t end) { std::memcpy(copy.to + begin, copy.from + begin, (end - begin) * sizeof(Vec3f)); });
  return result;
}

}  // namespace knead
