#!/usr/bin/env bash
# Sets up, checks the text (tests/text.sh), builds and runs every test, then the quick ones again under AddressSanitizer and UndefinedBehaviorSanitizer. The last line sums up.
# Where nvcc is found, the CUDA code is built too, for every architecture; tests that need a device are skipped without one, or fail if KNEAD_REQUIRE_CUDA=1.
# Tests that are not quick carry the label `slow`. Options are passed on to ctest (-R NAME, --verbose); with options the text is not checked.
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/../examples/setup.sh"
source "$knead_root/tests/text.sh"

passed=0 failed=0 skipped=0

# count FILE: adds what a JUnit report says
count() {
  local head total bad disabled skips
  head=$(tr '\n\t' '  ' <"$1" | grep -o '<testsuite [^>]*>' | head -1)
  attribute() { sed -n "s/.* $1=\"\([0-9]*\)\".*/\1/p" <<<"$head"; }
  total=$(attribute tests) bad=$(attribute failures) disabled=$(attribute disabled) skips=$(attribute skipped)
  skips=$((skips + disabled))
  passed=$((passed + total - bad - skips)) failed=$((failed + bad)) skipped=$((skipped + skips))
}

# run_tests PRESET [ctest options]
run_tests() {
  local preset=$1 report="$knead_root/build/$1/tests.xml"
  shift
  knead_say "Testing build/$preset"
  rm -f "$report"
  local status=0 failed_before=$failed
  ctest --test-dir "$knead_root/build/$preset" --output-on-failure --no-tests=error -j "$(nproc)" --output-junit "$report" "$@" || status=$?
  [ -s "$report" ] || { echo "ctest made no report for build/$preset" >&2; exit 1; }
  count "$report"
  # A test program that was not built or that broke off counts as failed too.
  [ "$status" -eq 0 ] || [ "$failed" -gt "$failed_before" ] || failed=$((failed + 1))
}

# check WHAT COMMAND...: a check of the text counts as a test
check() {
  local status=0
  knead_say "Checking $1"
  shift
  "$@" || status=$?
  case $status in
    0) passed=$((passed + 1)) ;;
    2) skipped=$((skipped + 1)) ;;
    *) failed=$((failed + 1)) ;;
  esac
}

knead_packages
if [ $# -eq 0 ]; then
  check "the format" text_format
  check "lengths" text_lengths
  check "that folders say what they hold" text_readmes
  knead_configure release
  check "names in what has changed lately" text_names "$knead_root/build/release"
fi
knead_build release
run_tests release "$@"
knead_build asan-ubsan
# Leaks count too, but for those of tests/leaks.supp. (LeakSanitizer cannot work under ptrace: set ASAN_OPTIONS=detect_leaks=0 in a debugger or under strace.)
export LSAN_OPTIONS=${LSAN_OPTIONS:-suppressions=$knead_root/tests/leaks.supp:print_suppressions=0}
ASAN_OPTIONS=${ASAN_OPTIONS:-detect_leaks=1:detect_stack_use_after_return=1} UBSAN_OPTIONS=${UBSAN_OPTIONS:-print_stacktrace=1} run_tests asan-ubsan -LE slow "$@"

echo
echo "$passed passed, $failed failed, $skipped skipped"
[ "$failed" -eq 0 ] && [ "$passed" -gt 0 ]
