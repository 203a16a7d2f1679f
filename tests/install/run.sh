#!/usr/bin/env bash
# run.sh WHAT BUILD SOURCE: installs BUILD into an empty prefix, then tests what a stranger gets there. Nothing but the prefix tells where Knead is.
#   stranger   SOURCE/examples/embed, copied out of the tree, finds the library, links, adds its own node types and runs; the prefix may be moved
#   pkgconfig  the same through knead.pc instead of CMake; 77 without pkg-config
#   headers    every installed header compiles by itself, and includes only what is installed
#   snippets   the C++ in README.md, CONTRIBUTING.md and docs/ compiles as it stands
#   symbols    libknead exports names of its own only, and no more than are meant
set -euo pipefail
what=$1 build=$2 source=$3
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cmake --install "$build" --prefix "$work/prefix" >"$work/install.log"
compiler=(${CXX:-c++} -std=c++20 ${KNEAD_STRANGER_FLAGS:-})

stranger() {
  cp -r "$source/examples/embed" "$work/embed"
  cmake -S "$work/embed" -B "$work/build" -DCMAKE_BUILD_TYPE=Release -DCMAKE_PREFIX_PATH="$work/prefix" -DCMAKE_CXX_FLAGS="${KNEAD_STRANGER_FLAGS:-}"
  grep -q "knead_DIR:PATH=$work/prefix" "$work/build/CMakeCache.txt"
  cmake --build "$work/build" -j "$(nproc)"
  mkdir "$work/elsewhere"
  cd "$work/elsewhere"
  "$work/build/embed"
  if [ -x "$work/prefix/bin/knead" ]; then
    "$work/prefix/bin/knead" info | grep -q '^knead '
    mv "$work/prefix" "$work/moved"
    "$work/moved/bin/knead" nodes >/dev/null
  fi
}

pkgconfig() {
  command -v pkg-config >/dev/null || exit 77
  local pc flags library
  pc=$(find "$work/prefix" -name knead.pc)
  mv "$work/prefix" "$work/moved"
  export PKG_CONFIG_PATH=${pc/prefix/moved}
  PKG_CONFIG_PATH=${PKG_CONFIG_PATH%/*}
  flags=$(pkg-config --cflags --libs knead)
  library=$(pkg-config --variable=pcfiledir knead)/..
  printf '#include <knead/knead.h>\nint main() { return knead::Registry::builtin().find("deform") ? 0 : 1; }\n' >"$work/one.cpp"
  "${compiler[@]}" "$work/one.cpp" -o "$work/one" $flags
  LD_LIBRARY_PATH=$library "$work/one"
}

headers() {
  cd "$work/prefix/include"
  find knead -name '*.h' | sort >"$work/headers"
  ! grep -rn '#include "' knead || { echo "Installed headers include each other as <knead/...>." >&2; exit 1; }
  xargs -P "$(nproc)" -I HEADER "${compiler[@]}" -fsyntax-only -I "$work/prefix/include" -include HEADER -x c++ /dev/null <"$work/headers"
  echo "$(wc -l <"$work/headers") headers"
}

snippets() {
  local page count=0 file
  cd "$source"
  for page in README.md CONTRIBUTING.md docs/*.md; do
    awk -v out="$work/$(basename "$page" .md)" '/^```cpp/ { inside = 1; file = out "_" ++n ".cpp"; printf "" >file; next } /^```/ { inside = 0 } inside { print >file }' "$page"
  done
  for file in "$work"/*_*.cpp; do
    count=$((count + 1))
    # What has no #include is a part of a function, for the reader to put where it belongs.
    grep -q '#include' "$file" || { sed -e '1i #include <knead/knead.h>\nint main() {' -e '$a }' -i "$file"; }
    # What includes the tree's own headers is for the tree.
    "${compiler[@]}" -Wno-unused-variable -Wno-unused-but-set-variable -fsyntax-only -I "$work/prefix/include" $(grep -q '#include "\(graph\|kernels\|io\)/' "$file" && echo "-I$source") "$file"
  done
  echo "$count snippets"
  [ "$count" -ge 2 ]
}

symbols() {
  local library names foreign
  library=$(find "$work/prefix" -name 'libknead.so')
  [ -n "$library" ] || exit 77  # a static library shows all
  names=$(nm -D --defined-only -C "$library" | sed 's/^[0-9a-f]* *[A-Za-z] //')
  foreign=$(grep -vE '^(typeinfo for |typeinfo name for |vtable for |non-virtual thunk to )?knead::' <<<"$names" || true)
  [ -z "$foreign" ] || { printf 'libknead exports what is not its own:\n%s\n' "$foreign" >&2; exit 1; }
  echo "$(wc -l <<<"$names") symbols"
  [ "$(wc -l <<<"$names")" -le 300 ] || { echo "More than are meant: mark only what is public (graph/api.h)." >&2; exit 1; }
}

"$what"
