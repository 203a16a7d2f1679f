#!/usr/bin/env bash
# Builds the benchmarks, runs them and prints a table. Takes minutes; nothing else should run. Options go to loop_bench: --sizes=5k,50k,500k,5M (the last one
# takes 5 GB), --device=NAME, --benchmark_filter=REGEX. The figures stay in build/release/benchmarks.json.
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/../../examples/setup.sh"

command -v python3 >/dev/null || { echo "The table is made by python3, which is not there." >&2; exit 1; }
knead_packages
knead_build release loop_bench

out=$knead_root/build/release/benchmarks.json
commit=$(git -C "$knead_root" describe --always --dirty 2>/dev/null || echo unknown)
# Interleaved repetitions: what disturbs the machine for a while disturbs all of them, and the table takes the best of each.
KNEAD_BENCH_COMMAND="tests/bench/run.sh $*" "$knead_root/build/release/tests/bench/loop_bench" --benchmark_repetitions=7 --benchmark_min_time=0.05 --benchmark_enable_random_interleaving=true \
  --benchmark_out="$out" --benchmark_out_format=json --benchmark_context=commit="$commit" "$@" >/dev/null
python3 "$knead_root/tests/bench/table.py" "$out"
