# Sourced by examples/run.sh and tests/run.sh: the packages that are missing, and a build. Not run by itself.
#   knead_root       the source tree
#   knead_packages   installs what cmake/packages.txt names and is not there
#   knead_configure PRESET           configures build/PRESET
#   knead_build PRESET [TARGET...]   configures build/PRESET and builds it

knead_root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

knead_say() { printf '\n== %s\n' "$*"; }

knead_packages() {
  local wanted missing=() package
  wanted=$(sed -e 's/#.*//' "$knead_root/cmake/packages.txt")
  if ! command -v dpkg-query >/dev/null; then
    knead_say "This is no Debian system. Knead needs what these packages hold: $(echo $wanted)"
    return 0
  fi
  for package in $wanted; do
    dpkg-query -W -f='${db:Status-Abbrev}' "$package" 2>/dev/null | grep -q '^.i' || missing+=("$package")
  done
  if [ ${#missing[@]} -eq 0 ]; then
    knead_say "All packages are there"
    return 0
  fi
  local as_root=()
  if [ "$(id -u)" -ne 0 ]; then
    command -v sudo >/dev/null || { echo "These packages are missing, and there is no sudo to install them: ${missing[*]}" >&2; return 1; }
    as_root=(sudo)
  fi
  knead_say "Installing: ${missing[*]}"
  "${as_root[@]}" apt-get update -qq
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}"
}

knead_configure() {
  local preset=$1 log="$knead_root/build/$1/configure.log"
  knead_say "Configuring build/$preset"
  mkdir -p "$(dirname "$log")"
  (cd "$knead_root" && cmake --preset "$preset") >"$log" 2>&1 || { cat "$log"; return 1; }
}

knead_build() {
  local preset=$1 targets=()
  shift
  [ $# -eq 0 ] || targets=(--target "$@")
  knead_configure "$preset"
  knead_say "Building build/$preset (minutes at first, seconds later)"
  cmake --build "$knead_root/build/$preset" "${targets[@]}"
}
