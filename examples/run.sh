#!/usr/bin/env bash
# Sets up, builds and runs the main job on the shipped inputs: examples/head, a head pressed by a fist over 48 frames, once soft and once stiff.
# Options are passed on to `knead run` (--frames 20-30).
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/setup.sh"

knead_packages
knead_build release knead_program

results=$knead_root/out/head
knead_say "Running examples/head/head.yaml"
"$knead_root/build/release/app/knead" run "$knead_root/examples/head/head.yaml" --out "$results" --sheet "$@"

# list WHAT PATTERN: the first and the last file, and how many there are
list() {
  local files
  mapfile -t files < <(find "$results" -name "$2" | sort)
  [ ${#files[@]} -gt 0 ] || return 0
  printf '  %-15s %s' "$1" "${files[0]}"
  [ ${#files[@]} -eq 1 ] || printf ' to %s (%d files)' "$(basename "${files[-1]}")" "${#files[@]}"
  printf '\n'
}

knead_say "Done"
list "soft meshes" 'soft.[0-9]*.obj'
list "stiff meshes" 'stiff.[0-9]*.obj'
list "pictures, soft" 'soft.[0-9]*.png'
list "pictures, stiff" 'stiff.[0-9]*.png'
list "all in one" '*_sheet.png'
list "figures" 'stats.jsonl'
echo "  What else there is: $knead_root/build/release/app/knead nodes"
