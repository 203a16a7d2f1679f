#include "kernels/port_types.h"

#include <algorithm>
#include <limits>

#include "kernels/largest_move_body.h"
#include "kernels/parallel.h"

namespace knead {

Similarity Similarity::inverse() const {
  Similarity inverse;
  inverse.scale = 1 / scale;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) inverse.rotation[static_cast<size_t>(3 * r + c)] = rotation[static_cast<size_t>(3 * c + r)];
  inverse.translation = -(inverse.scale * inverse.rotate(translation));
  return inverse;
}

Similarity operator*(const Similarity& outer, const Similarity& inner) {
  Similarity product;
  product.scale = outer.scale * inner.scale;
  for (size_t r = 0; r < 3; ++r)
    for (size_t c = 0; c < 3; ++c) {
      double sum = 0;
      for (size_t k = 0; k < 3; ++k) sum += outer.rotation[3 * r + k] * inner.rotation[3 * k + c];
      product.rotation[3 * r + c] = sum;
    }
  product.translation = outer.apply(inner.translation);
  return product;
}

bool operator==(const Similarity& a, const Similarity& b) {
  return a.scale == b.scale && a.rotation == b.rotation && a.translation.x == b.translation.x && a.translation.y == b.translation.y &&
         a.translation.z == b.translation.z;
}

Buffer<double> PortTraits<Surface>::unrest(const Surface& before, const Surface& after, Executor& executor) {
  const auto a = before.points.view(executor.device()), b = after.points.view(executor.device());
  if (a.size() != b.size())
    throw Error(ErrorCode::kInput, "a surface of " + std::to_string(a.size()) + " vertices became one of " + std::to_string(b.size()) + " in a loop");
  Buffer<double> unrest(1, executor.memory());
  reduce(executor, a.size(),
         LargestMove{a.data(), b.data(), unrest.data_for_write(), std::max(after.diagonal(), std::numeric_limits<double>::min())});
  return unrest;
}

}  // namespace knead
