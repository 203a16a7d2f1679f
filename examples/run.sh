#!/usr/bin/env bash
# Sets up, builds and runs the main job on the shipped inputs: examples/head, a head pressed by a fist over 48 frames, once soft and once stiff.
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/setup.sh"

knead_packages
knead_build release knead_program

results=$knead_root/out/head
for graph in "$knead_root"/examples/head/*.yaml; do
  knead_say "Running ${graph#"$knead_root"/}"
  "$knead_root/build/release/app/knead" run "$graph" --out "$results/$(basename "$graph" .yaml)" --sheet
done

knead_say "Done. In $results, a folder for each graph:"
cd "$results"
for folder in */; do
  printf '  %s\n' "$folder"
  for kind in "meshes:*.obj *.ply *.stl" "pictures:*.png" "figures:*.jsonl"; do
    files=()
    for pattern in ${kind#*:}; do
      while IFS= read -r file; do files+=("$file"); done < <(find "$folder" -name "$pattern" | sort)
    done
    [ ${#files[@]} -eq 0 ] || printf '    %-9s %s%s\n' "${kind%%:*}" "$results/${files[0]}" "$([ ${#files[@]} -eq 1 ] || echo " to $(basename "${files[-1]}"), ${#files[@]} files")"
  done
done
