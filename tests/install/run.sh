#!/usr/bin/env bash
# run.sh BUILD SOURCE: installs BUILD into an empty prefix, then a project outside both trees (SOURCE/examples/embed) finds, links and runs it.
set -euo pipefail
build=$1 source=$2
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

cmake --install "$build" --prefix "$work/prefix" >"$work/install.log"
cp -r "$source/examples/embed" "$work/embed"
# Nothing but the prefix may tell the stranger where Knead is.
cmake -S "$work/embed" -B "$work/build" -DCMAKE_BUILD_TYPE=Release -DCMAKE_PREFIX_PATH="$work/prefix" -DCMAKE_CXX_FLAGS="${KNEAD_STRANGER_FLAGS:-}"
grep -q "knead_DIR:PATH=$work/prefix" "$work/build/CMakeCache.txt"
cmake --build "$work/build"
mkdir "$work/elsewhere"
cd "$work/elsewhere"
"$work/build/embed"

if [ -x "$work/prefix/bin/knead" ]; then
  "$work/prefix/bin/knead" info | grep -q '^knead '
  mv "$work/prefix" "$work/moved"   # an installed copy may be moved
  "$work/moved/bin/knead" nodes >/dev/null
fi
