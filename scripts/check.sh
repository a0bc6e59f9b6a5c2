#!/bin/bash
# One stage of the checks: scripts/check.sh STAGE...
#   fast         what `make test` runs, against the release build as it is
#   flakes       the same FLAKE_ROUNDS times (default 10) under changing load; names each test that was not green in each round
#   gcc, clang   compile everything without a warning
#   dev          unit and golden tests under ASan and UBSan
#   tsan         tests of threaded code under ThreadSanitizer
#   arm64        compile all but the tests for arm64 without a warning
#   rays         tests that trace, with each of Embree's instruction sets (LW_TRACE_ISA) that this processor has and `make
#                test` did not take; rays-all: all fast tests
#   isa          tests of our own kernels that pick their instructions at run time (LW_WIDE), on processors with SSE2 alone
#                and with AVX2, which qemu-user emulates: it has no AVX-512, and Embree follows the emulated processor
#   long         tests labelled `long`, against the release build
#   fuzz         each fuzzer from its corpus, for FUZZ_SECONDS (default 30)
set -euo pipefail
cd "$(dirname "$0")/.."
jobs=${LW_JOBS:-$(nproc)}

# run_tests PRESET CTEST-ARGUMENTS...: ctest's output and status, and the slowest tests; a report for each test in
# build/PRESET/tests.xml
run_tests() {
    local preset=$1 status=0
    shift
    ctest --test-dir "build/$preset" --no-tests=error --output-on-failure --output-junit tests.xml -j "$jobs" "$@" || status=$?
    echo "The slowest, in seconds of wall time:"
    sed -n 's/^.*<testcase name="\([^"]*\)".* time="\([^"]*\)".*$/\2 \1/p' "build/$preset/tests.xml" | sort -rn |
        awk 'NR <= 10 { printf "%8.1f  %s\n", $1, $2 }'
    return "$status"
}

busy=()
stop_busy() {
    if [ ${#busy[@]} -gt 0 ]; then kill "${busy[@]}" 2>/dev/null || true; fi
    busy=()
}
trap stop_busy EXIT

# start_busy COUNT: loops that compute; they end with this script even if it is killed
start_busy() {
    local i
    for ((i = 0; i < $1; i++)); do
        while kill -0 $$ 2>/dev/null; do :; done &
        busy+=($!)
        disown
    done
}

# The fast tests beside other work that comes and goes: a test that was red once is a defect.
find_flakes() {
    local rounds=${FLAKE_ROUNDS:-10} logs=build/flakes round load at_once
    local -a loads=(0 12 2 6) widths=(3 1 6 2 4)
    rm -rf "$logs"
    mkdir -p "$logs"
    for ((round = 1; round <= rounds; round++)); do
        load=${loads[(round - 1) % 4]} at_once=${widths[(round - 1) % 5]}
        echo "flakes: round $round of $rounds: $at_once at a time beside $load busy loops"
        start_busy "$load"
        run_tests release -L "$fast" -j "$at_once" >"$logs/$round.log" 2>&1 || true
        stop_busy
        cp build/release/tests.xml "$logs/$round.xml"
        # a test that ctest could not start is red, too; one that skips itself is not
        sed -n "/(Skipped)\$/!s/^\t *[0-9]* - \([^ ]*\) (.*)\$/$round \1/p" "$logs/$round.log" | tee -a "$logs/red" |
            sed 's/^[0-9]* /flakes: red: /'
    done
    if [ ! -s "$logs/red" ]; then
        echo "flakes: all green in $rounds rounds; logs in $logs"
        return 0
    fi
    awk -v rounds="$rounds" '{ count[$2]++; in_rounds[$2] = in_rounds[$2] " " $1 }
        END { for (name in count) printf "flakes: %s: red in %d of %d rounds:%s\n", name, count[name], rounds, in_rounds[name] }' \
        "$logs/red" | sort >&2
    echo "flakes: logs in $logs/ROUND.log" >&2
    return 1
}

fast='^(unit|golden|reference|integration)$'
short_rays='^test_(trace|transport|direct|bounces|packets|invalid_texels|probes|hybrid|compose|gbuffer|svgf|camera|path_trace|view)$'

# with_each_isa CTEST-ARGUMENTS...: the release build's tests with every instruction set but the default one
with_each_isa() {
    local default set
    default=$(env -u LW_TRACE_ISA build/release/bin/trace_isa_name)
    for set in sse4.2 avx2 avx512; do
        if [ "$set" = "$default" ]; then
            echo "check: rays with $set: as in make test"
        elif LW_TRACE_ISA=$set build/release/bin/trace_isa_name >build/trace-isa.log 2>&1; then
            echo "check: rays with $set"
            LW_TRACE_ISA=$set run_tests release "$@"
        else
            echo "check: rays with $set: skipped: $(cat build/trace-isa.log)"
        fi
    done
}

# compile_objects FOLDER PATTERN: all object files of C whose path matches, and nothing is linked: warnings are all there by then
compile_objects() {
    ninja -C "build/$1" -t targets all | sed -nE "s/^($2[^:]*\.o): C_COMPILER.*/\1/p" | xargs ninja -C "build/$1" -j "$jobs"
}

# compile_with COMPILER FLAGS
compile_with() {
    local compiler=$1
    cmake --preset release -B "build/$compiler" -DCMAKE_C_COMPILER="$compiler" -DCMAKE_C_FLAGS_RELEASE="$2" \
        -DLW_WERROR=ON -DLW_COMPILE_ONLY=ON --log-level=WARNING
    compile_objects "$compiler" ''
}

for stage in "$@"; do
    echo "check: $stage"
    case $stage in
    # four at a time for two cores: many wait more than they compute
    fast) run_tests release -L "$fast" -j 4 ;;
    flakes)
        scripts/build.sh release
        find_flakes
        ;;
    gcc) compile_with gcc '-O3 -g1' ;; # it tells some of its warnings by what it optimises
    clang) compile_with clang -O0 ;;
    dev)
        scripts/build.sh dev programs unit_tests golden_tests
        run_tests dev -L '^(unit|golden)$'
        ;;
    tsan)
        scripts/build.sh tsan programs threaded_tests
        run_tests tsan -L '^threaded$'
        ;;
    arm64)
        cmake --preset release -B build/arm64 -DCMAKE_TOOLCHAIN_FILE=cmake/arm64.cmake -DCMAKE_PREFIX_PATH=/usr \
            -DLW_WERROR=ON --log-level=WARNING
        compile_objects arm64 '(common|proto|server|client)' # there are no libraries to link with
        ;;
    rays | rays-all)
        scripts/build.sh release
        if [ "$stage" = rays ]; then with_each_isa -R "$short_rays"; else with_each_isa -L "$fast"; fi
        ;;
    isa)
        scripts/build.sh release
        for processor in Opteron_G1 Haswell; do
            for name in test_tile_rans test_tile_dct test_tile_codec test_trace test_packets test_svgf test_lights; do
                echo "check: $name on $processor"
                OMP_NUM_THREADS=2 qemu-x86_64 -cpu "$processor" "build/release/bin/$name"
            done
        done
        ;;
    long)
        scripts/build.sh release
        run_tests release -L '^long$'
        ;;
    fuzz)
        scripts/build.sh fuzz
        for corpus in tests/fuzz/corpus/*/; do
            name=$(basename "$corpus")
            mkdir -p "build/fuzz/corpus/$name"
            echo "check: $name"
            # finds go to the first folder; what crashed is kept as build/fuzz/NAME-crash-...
            "build/fuzz/bin/$name" -max_total_time="${FUZZ_SECONDS:-30}" -timeout=10 -rss_limit_mb=2048 \
                -print_final_stats=1 -artifact_prefix="build/fuzz/$name-" "build/fuzz/corpus/$name" "$corpus"
        done
        ;;
    *)
        echo "check: no stage \"$stage\"; there are fast, flakes, gcc, clang, dev, tsan, arm64, rays, rays-all, isa, long, fuzz" >&2
        exit 64
        ;;
    esac
done
