// The solver's bodies over the other structures, compiled for the processor that builds the benchmarks.
#pragma once
#include "graph/executor.h"
#include "kernels/loop/enforce_stiffness_body.h"
#include "kernels/loop/restore_volume_body.h"
#include "tests/bench/tables.h"

namespace knead::bench {

// `like`: everything but the table. Runs over all lanes; `scalar`: one at a time.
void run_volume(Executor& executor, const RestoreVolume& like, const TableData& table, bool scalar);
void run_stiffness(Executor& executor, const EnforceStiffness& like, const TableData& table, bool scalar);

}  // namespace knead::bench
