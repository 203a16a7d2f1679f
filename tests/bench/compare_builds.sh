#!/usr/bin/env bash
# compare_builds.sh OLD NEW [GRAPH...]: two programs `knead` on the same graphs, by turns. Says for each graph whether the meshes are the same bytes, and how long
# the runs took (median of the pairs' ratios, new over old). Without graphs: the examples, which the new program's tree holds.
# KNEAD_PAIRS: how many pairs, 3 if unset.
set -euo pipefail
old=$(realpath "$1") new=$(realpath "$2")
shift 2
examples=$(cd "$(dirname "${BASH_SOURCE[0]}")/../../examples" && pwd)
[ $# -gt 0 ] || set -- "$examples"/head/head.yaml "$examples"/crush/crush.yaml "$examples"/crush/cascade.yaml "$examples"/sdf_pipeline/sdf_pipeline.yaml
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# seconds PROGRAM GRAPH OUT
seconds() {
  local start=$EPOCHREALTIME
  "$1" run "$2" -q --out "$3" >/dev/null 2>&1 || { echo "$1 fails on $2" >&2; return 1; }
  awk "BEGIN { print $EPOCHREALTIME - $start }"
}

status=0
for graph; do
  ratios=()
  for ((pair = 0; pair < ${KNEAD_PAIRS:-3}; ++pair)); do
    before=$(seconds "$old" "$graph" "$work/old") after=$(seconds "$new" "$graph" "$work/new")
    ratios+=("$(awk "BEGIN { print $after / $before }")")
  done
  different=0 meshes=0
  while read -r mesh; do
    meshes=$((meshes + 1))
    cmp -s "$work/old/$mesh" "$work/new/$mesh" || different=$((different + 1))
  done < <(cd "$work/old" && find . -name '*.obj' -o -name '*.ply' -o -name '*.stl' -o -name '*.vdb' | sort)
  median=$(printf '%s\n' "${ratios[@]}" | sort -g | sed -n "$(((${#ratios[@]} + 1) / 2))p")
  printf '%-20s %d meshes, %d different; time %.2f of before (%s)\n' "$(basename "$graph")" "$meshes" "$different" "$median" "${ratios[*]}"
  [ "$meshes" -gt 0 ] && [ "$different" -eq 0 ] || status=1
  rm -rf "$work/old" "$work/new"
done
exit $status
