#!/bin/bash
# Configures and builds one preset: scripts/build.sh PRESET [TARGET...]
# LW_JOBS sets how many compilers run at once (default: one per core). LW_WERROR=ON: warnings are errors.
# LW_INVARIANTS says which checks of our own state are built in (common/base/invariant.h); unless set, AUTO: what
# users run has the cheap ones.
set -euo pipefail
cd "$(dirname "$0")/.."
preset=$1
shift
echo "build: $preset, in build/$preset" >&2
cmake --preset "$preset" ${LW_WERROR:+-DLW_WERROR="$LW_WERROR"} \
    -DLW_INVARIANTS="${LW_INVARIANTS:-AUTO}" --log-level=WARNING >&2
targets=()
if [ $# -gt 0 ]; then targets=(--target "$@"); fi
cmake --build "build/$preset" --parallel "${LW_JOBS:-$(nproc)}" "${targets[@]}" >&2
