#!/bin/bash
# One stage of the checks beyond `make test`: scripts/check.sh STAGE...
#   gcc, clang   build everything without a warning
#   dev          unit and golden tests under ASan and UBSan
#   tsan         tests of threaded code under ThreadSanitizer
#   long         tests labelled `long`, against the release build
#   fuzz         each fuzzer from its corpus, for FUZZ_SECONDS (default 30)
set -euo pipefail
cd "$(dirname "$0")/.."
jobs=${LW_JOBS:-$(nproc)}

# run_tests PRESET CTEST-ARGUMENTS...
run_tests() {
    local preset=$1
    shift
    ctest --test-dir "build/$preset" --no-tests=error --output-on-failure --timeout 120 -j "$jobs" "$@"
}

# Tests with a label, in a preset's build
has_tests() { ctest --test-dir "build/$1" -N -L "$2" 2>/dev/null | grep -q '^Total Tests: [1-9]'; }

compile_with() {
    local compiler=$1
    cmake --preset release -B "build/$compiler" -DCMAKE_C_COMPILER="$compiler" -DLW_WERROR=ON --log-level=WARNING
    cmake --build "build/$compiler" --parallel "$jobs"
}

for stage in "$@"; do
    echo "check: $stage"
    case $stage in
    gcc | clang) compile_with "$stage" ;;
    dev)
        scripts/build.sh dev
        run_tests dev -L '^(unit|golden)$'
        ;;
    tsan)
        scripts/build.sh tsan
        run_tests tsan -L '^threaded$'
        ;;
    long)
        scripts/build.sh release
        if has_tests release '^long$'; then run_tests release -L '^long$'; else echo "check: no long tests yet"; fi
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
        echo "check: no stage \"$stage\"; there are gcc, clang, dev, tsan, long, fuzz" >&2
        exit 64
        ;;
    esac
done
