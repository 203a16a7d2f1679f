#include "tests/bench/table_simd.h"

namespace knead::bench {
namespace {

#if defined(__AVX512F__)
using Lanes = Pack<16>;
#elif defined(__AVX2__)
using Lanes = Pack<8>;
#elif defined(__SSE2__)
using Lanes = Pack<4>;
#else
using Lanes = float;
#endif

template <class Body>
void run(Executor& executor, const Body& body, uint32_t lanes, bool scalar) {
  if (executor.device() != Device{}) return executor.launch(body, lanes);
  executor.parallel_ranges(lanes, 512, [&](size_t begin, size_t end) {
    if (scalar)
      for (size_t t = begin; t < end; ++t) body.template lane<float>(static_cast<uint32_t>(t));
    else
      for (size_t t = begin; t < end; t += Lane<Lanes>::kWidth) body.template lane<Lanes>(static_cast<uint32_t>(t));
  });
}

template <template <class> class Body, class Table>
Body<Table> over(const Body<LaneTable>& like, const Table& table) {
  if constexpr (requires { like.strips; })
    return {like.from, like.to, table, like.regularisation, like.relaxation, like.ignored, like.max_step, like.relative};
  else
    return {like.from, like.to, table, like.weights, like.stiffness, like.ignored, like.max_step, like.stretched_only};
}

template <template <class> class Body>
void run_on(Executor& executor, const Body<LaneTable>& like, const TableData& data, bool scalar) {
  const Device device = executor.device();
  switch (data.structure) {
    case Structure::kJagged: return run(executor, over<Body>(like, data.on<JaggedTable>(device)), data.lanes, scalar);
    case Structure::kEll: return run(executor, over<Body>(like, data.on<EllTable>(device)), data.lanes, scalar);
    case Structure::kSliced: return run(executor, over<Body>(like, data.on<SlicedTable>(device)), data.lanes, scalar);
    case Structure::kCsr: break;
  }
  run(executor, over<Body>(like, data.on<CsrTable>(device)), data.lanes, true);
}

}  // namespace

void run_volume(Executor& executor, const RestoreVolume& like, const TableData& table, bool scalar) {
  run_on<RestoreVolumeOn>(executor, like, table, scalar);
}
void run_stiffness(Executor& executor, const EnforceStiffness& like, const TableData& table, bool scalar) {
  run_on<EnforceStiffnessOn>(executor, like, table, scalar);
}

}  // namespace knead::bench
