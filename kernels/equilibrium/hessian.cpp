// The second derivative of the equilibrium's energy without contacts, at rest and as it follows a frame's shape.
#include "kernels/array_ops_body.h"
#include "kernels/equilibrium/rest_tables.h"
#include "kernels/parallel.h"

namespace knead {

TetGradients EquilibriumRest::gradients_at(const Row4* u, float* to, uint8_t* changed, float tolerance) const {
  return {u, on.corners, on.shape, on.mu, on.lambda, on.guard, stride, to, changed, term, tolerance};
}

HessianRow EquilibriumRest::rows_of(const float* gradients, float* entries, float* diagonal, const uint8_t* changed_tets, uint8_t* changed) const {
  return {gradients,
          stride,
          on.incident_offsets,
          on.incident_corners,
          on.incident_entries,
          on.hold,
          on.free,
          on.ghost_offsets,
          on.ghost_values,
          on.ghost_entries,
          grids->levels().front().a.offsets,
          entries,
          diagonal,
          changed_tets,
          changed};
}

void EquilibriumRest::make_rest_hessian(Executor& executor) {
  Buffer<float> gradients(TetGradients::kFloats * stride, executor.memory()), entries(kBlock * grids->levels().front().entries, executor.memory()),
      diagonal(kBlock * size_t{vertices}, executor.memory());
  float* of_tets = gradients.data_for_write();
  parallel_for(executor, stride, gradients_at(nullptr, of_tets, nullptr, 0));
  parallel_for(executor, vertices, rows_of(of_tets, entries.data_for_write(), diagonal.data_for_write(), nullptr, nullptr));
  hessian = make_hessian(executor, *grids, std::move(entries), std::move(diagonal));
}

void EquilibriumRest::follow(Executor& executor, const Row4* u, float tolerance, ShapeHessian& shape) const {
  if (shape.gradients.empty()) {
    const auto copy = [&](const Buffer<float>& from) {
      Buffer<float> to(from.size(), executor.memory());
      parallel_for(executor, from.size(), AddFloats{from.view(executor.device()).data(), nullptr, to.data_for_write()}, size_t{1} << 14);
      return to;
    };
    shape.now = {copy(hessian.entries), copy(hessian.diagonal), copy(hessian.coarse_entries), copy(hessian.coarse_diagonal)};
    shape.gradients = Buffer<float>(TetGradients::kFloats * stride, executor.memory());
    shape.changed_tets = Buffer<uint8_t>(stride, executor.memory());
    shape.changed = Buffer<uint8_t>(vertices, executor.memory());
    parallel_for(executor, stride, gradients_at(nullptr, shape.gradients.data_for_write(), nullptr, 0));
  }
  float* gradients = shape.gradients.data_for_write();
  uint8_t *changed_tets = shape.changed_tets.data_for_write(), *changed = shape.changed.data_for_write();
  parallel_for(executor, stride, gradients_at(u, gradients, changed_tets, tolerance));
  parallel_for(executor, vertices,
               rows_of(gradients, shape.now.entries.data_for_write(), shape.now.diagonal.data_for_write(), changed_tets, changed));
  renew_coarse(executor, *grids, shape.now, changed);
}

}  // namespace knead
