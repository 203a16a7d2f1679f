# Sourced by tests/run.sh: what can be said about the text before anything is compiled. Each check is a function that prints what is wrong and how to mend it.
#   text_format      every source as clang-format 14 (Debian 12's) writes it
#   text_lengths     sources of at most 400 lines, functions of at most 60
#   text_readmes     every folder of sources says what lives there
#   text_names DIR   clang-tidy over what has changed lately, with the compile commands of the build folder DIR; the newest first, for at most KNEAD_TIDY_SECONDS
# 0: fine, 1: not fine, 2: cannot be told here.

text_files() { git -C "$knead_root" ls-files --cached --others --exclude-standard -- "$@" | sort -u | while read -r file; do [ -f "$knead_root/$file" ] && echo "$file"; done; }
text_sources() { text_files '*.cpp' '*.h' '*.inl' '*.cu' '*.cuh'; }

# text_tool NAME: the command of clang's tools 14
text_tool() {
  local tool
  for tool in "$1-14" "$1"; do
    command -v "$tool" >/dev/null && "$tool" --version | grep -q 'version 14\.' && { echo "$tool"; return 0; }
  done
  echo "$1 14 is not there" >&2
  return 2
}

text_is_repository() { git -C "$knead_root" rev-parse --git-dir >/dev/null 2>&1 || { echo "This is no git repository, so that nobody knows which files belong to Knead." >&2; return 2; }; }

text_format() {
  local tool wrong
  tool=$(text_tool clang-format) && text_is_repository || return 2
  wrong=$(cd "$knead_root" && text_sources | xargs -P "$(nproc)" -n 32 "$tool" --dry-run 2>&1 | sed -n 's/^\([^: ]*\):[0-9].*clang-format-violations.*/\1/p' | sort -u)
  [ -z "$wrong" ] || { printf 'Not formatted: %s\nMend with: %s -i %s\n' "$(echo $wrong)" "$tool" "$(echo $wrong)"; return 1; }
}

# Functions are told by indentation, which clang-format makes reliable: from a line that ends in `) ... {` to the brace below its first letter.
text_lengths() {
  text_is_repository || return 2
  local long
  long=$(cd "$knead_root" && text_sources | xargs awk '
    function close_file() { if (lines > 400) printf "%s: %d lines\n", file, lines }
    FNR == 1 { if (file) close_file(); file = FILENAME; start = open = 0 }
    { lines = FNR }
    start { if (index($0, indent "}") == 1) { if (FNR - start > 60) printf "%s:%d: a function of %d lines\n", file, start, FNR - start + 1; start = open = 0 } next }
    /^ *($|#|\/\/)/ { next }
    !open { head = $0; head_line = FNR; match($0, /^ */); depth = RLENGTH }
    { open = $0 !~ /[;{}:]( *\/\/.*)?$/ }
    /\{$/ && head ~ /\(/ && depth <= 2 && head !~ /^ *(namespace|extern|class|struct|enum|union) / { indent = substr(head, 1, depth); start = head_line }
    END { close_file() }')
  [ -z "$long" ] || { printf '%s\nSplit these: sources have 400 lines at most, functions 60.\n' "$long"; return 1; }
}

text_readmes() {
  text_is_repository || return 2
  local folder missing=()
  for folder in $(text_sources | grep -v ^tests/ | xargs -n1 dirname | sort -u) tests; do
    [ -f "$knead_root/$folder/README.md" ] || missing+=("$folder/README.md")
  done
  [ ${#missing[@]} -eq 0 ] || { echo "Missing: ${missing[*]}. Five lines each: what lives there, what it may see, where to add."; return 1; }
}

# Changed since the last tag or 50 commits ago, newest first.
text_changed() {
  local base
  base=$(git -C "$knead_root" describe --tags --abbrev=0 2>/dev/null || git -C "$knead_root" rev-parse -q --verify HEAD~50 || git -C "$knead_root" rev-list --max-parents=0 HEAD | tail -1)
  { git -C "$knead_root" diff --name-only HEAD; git -C "$knead_root" log --format= --name-only "$base..HEAD"; } | awk '!seen[$0]++'
}

# text_tidy TOOL BUILD HEADERS DEADLINE FILE: one file. What was found fine is remembered by the contents of the file and of all headers.
text_tidy() {
  local tool=$1 build=$2 stamp found
  stamp=$build/tidy/$({ echo "$3"; cat "$5"; } | sha256sum | cut -c1-32)
  [ ! -e "$stamp" ] || return 0
  [ "$(date +%s)" -lt "$4" ] || { touch "$build/tidy/unread"; return 0; }
  # g++ is the compiler: what only clang 14 cannot read (lambdas that capture structured bindings) is no matter here.
  found=$("$tool" -p "$build" --quiet --extra-arg=-Wno-unknown-warning-option "$5" 2>/dev/null)
  grep -q 'warnings-as-errors\]' <<<"$found" || { touch "$stamp"; return 0; }
  printf '%s\nMend with: %s -p %s --fix %s\n' "$found" "$tool" "$build" "$5"
  return 1
}
export -f text_tidy

text_names() {
  local tool build=$1 headers seconds=${KNEAD_TIDY_SECONDS:-60}
  tool=$(text_tool clang-tidy) && text_is_repository || return 2
  (
    cd "$knead_root"
    mkdir -p "$build/tidy"
    rm -f "$build/tidy/unread"
    headers=$(text_files '*.h' '*.inl' .clang-tidy | xargs cat | sha256sum)
    { text_changed | grep "\.cpp$" | grep -Fx -f <(sed -n "s|^ *\"file\": \"$knead_root/\(.*\)\".*|\1|p" "$build/compile_commands.json") || true; } |
      xargs -r -P "$(nproc)" -n 1 bash -c 'text_tidy "$@"' - "$tool" "$build" "$headers" "$(($(date +%s) + seconds))" || exit 1
    [ ! -e "$build/tidy/unread" ] || echo "After $seconds seconds the older changes were left unread: KNEAD_TIDY_SECONDS gives more time; what was fine is remembered."
  )
}
