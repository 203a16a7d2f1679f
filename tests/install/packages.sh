#!/usr/bin/env bash
# packages.sh BUILD SOURCE: makes Debian packages of BUILD and installs the one with the program on a root that holds nothing but what its Depends ask for,
# taken from the packages of this machine; there `knead` runs a graph with a distance field and a picture. 77 where that cannot be tried.
set -euo pipefail
build=$1 source=$2
for tool in cpack dpkg-shlibdeps dpkg-query chroot; do
  command -v "$tool" >/dev/null || PATH=$PATH:/usr/sbin command -v "$tool" >/dev/null || { echo "$tool is not there"; exit 77; }
done
[ "$(id -u)" -eq 0 ] || { unshare -r true 2>/dev/null && exec unshare -r "$0" "$@"; echo "No root, and no user namespaces"; exit 77; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

cd "$work"
cpack -G DEB --config "$build/CPackConfig.cmake" -B "$work" >cpack.log 2>&1 || { cat cpack.log; exit 1; }
program=$(ls "$work"/knead_*.deb) headers=$(ls "$work"/libknead-dev_*.deb)
dpkg-deb --field "$program" Package Version Depends Installed-Size
dpkg-deb --contents "$headers" | grep '/usr/include/knead/knead.h' >/dev/null
! dpkg-deb --contents "$program" | grep -E '\.h$|/tmp/|/home/' || { echo "The program's package holds what belongs elsewhere" >&2; exit 1; }

# Who has which name here: packages that are installed, and what they provide.
declare -A installed wanted
while read -r name provided; do
  for alias in $name $(tr ',' ' ' <<<"$provided" | sed 's/([^)]*)//g'); do [ -n "${installed[$alias]:-}" ] && [ "$alias" != "$name" ] || installed[$alias]=$name; done
done < <(dpkg-query -W -f='${db:Status-Abbrev} ${Package} ${Provides}\n' | sed -n 's/^ii  *//p')

# names DEPENDS: the packages that it asks for; of alternatives the first that is installed
names() {
  local group name
  tr ',' '\n' <<<"$1" | sed 's/([^)]*)//g; s/:any//g' | while read -r group; do
    for name in ${group//|/ }; do
      [ -z "${installed[$name]:-}" ] || { echo "${installed[$name]}"; break; }
    done
  done
}
queue=($(names "$(dpkg-deb --field "$program" Depends)"))
[ ${#queue[@]} -gt 3 ] || { echo "Depends name too little" >&2; exit 1; }
while [ ${#queue[@]} -gt 0 ]; do
  name=${queue[0]} queue=("${queue[@]:1}")
  [ -z "${wanted[$name]:-}" ] || continue
  wanted[$name]=1
  queue+=($(names "$(dpkg-query -W -f='${Depends}, ${Pre-Depends}' "$name")"))
done

root=$work/root
mkdir -p "$root"/{var/lib/dpkg/{info,updates},tmp,proc,dev,usr/{lib,bin,lib64}}
for link in lib lib64 bin; do ln -s "usr/$link" "$root/$link"; done   # as Debian 12 has them
for name in "${!wanted[@]}"; do
  dpkg-query -L "$name" | while read -r file; do
    [ -f "$file" ] && [ ! -d "$file" ] || continue
    case $file in /usr/share/*|/etc/*) continue ;; esac
    mkdir -p "$root$(dirname "$file")"
    cp -a "$file" "$root$file"
  done
  dpkg-query -s "$name"; echo
done >"$root/var/lib/dpkg/status"
echo "${#wanted[@]} packages of this machine, $(du -sm "$root" | cut -f1) MB"

dpkg --root="$root" --force-not-root --force-script-chrootless --install "$program" >install.log 2>&1 || { cat install.log; exit 1; }
mkdir "$root/work"
cp "$source/tests/install/press.yaml" "$root/work/"
mkdir -p "$root/etc" && ldconfig -r "$root"
PATH=$PATH:/usr/sbin chroot "$root" /usr/bin/knead info
PATH=$PATH:/usr/sbin chroot "$root" /usr/bin/knead run /work/press.yaml --out /work/out
[ -s "$root/work/out/pressed.obj" ] && [ -s "$root/work/out/pressed.png" ]
