#!/bin/bash
# hybrid_bias.sh [SCENE...]: what finite tracing ranges cost in accuracy and save in time, as tables in Markdown. Writes
# docs/results/hybrid_bias.md (LW_OUT names another file) again, but for what is written there by hand, from the line
# "## Reading it" on: that is kept, and wants to be read again.
# Needs the release build. Default scenes: builtin:cornell builtin:atrium, and Sponza where LW_TEST_SCENES (default
# ../shared/scenes) has it.
set -euo pipefail
root="$(cd "$(dirname "$0")/../.." && pwd)"
bin=${LW_BIN:-$root/build/release/bin}
scenes=${LW_TEST_SCENES:-$root/../shared/scenes}
if [ $# -eq 0 ]; then
    set -- builtin:cornell builtin:atrium
    if [ -e "$scenes/sponza/Sponza_lit.gltf" ]; then set -- "$@" "$scenes/sponza/Sponza_lit.gltf"; fi
fi

page=${LW_OUT:-$root/docs/results/hybrid_bias.md}
new=$(mktemp "$page.XXXXXX")
trap 'rm -f "$new"' EXIT
{
    cat <<'TEXT'
# Tracing range: bias and cost

Made by `tests/bench/hybrid_bias.sh`, the last section by hand. A bounce ray that is longer than the tracing range asks a
probe. Compared with the same solver at range `inf`, over the indirect light of all covered texels; range and spacing are shares of the scene's
longest side. **mean ratio**: of all light. **relMSE**: mean((x−t)²/(t²+ε)), ε = 1 % of the mean of t², from two
independent solves each, so that noise drops out and bias stays (it may come out slightly negative). **99 %**: the error that
one block of 8 × 8 texels in a hundred exceeds, noise in it: compare with the row `inf`, which is the noise alone. **frame
ms**: median processor time of a frame with one worker; **/ inf**: as a ratio. **Mrays**: bounce and probe rays of the
last frame. Default spacing: some 1,000 probes. Densities are low, so that probes weigh more against texels than they do
with 400,000 texels, and half of the frames are among the first eight of a probe, in which each of them
gathers; later one in four does.
TEXT
    for scene in "$@"; do
        case $scene in # some 30,000 texels each: a table is 52 solves
        builtin:cornell) density=36 ;;
        *) density=2 ;;
        esac
        "$bin/bench_hybrid" --frames "${LW_FRAMES:-16}" --texels-per-metre "${LW_DENSITY:-$density}" "$scene"
    done
    if [ -e "$page" ]; then
        echo
        sed -n '/^## Reading it/,$p' "$page"
    fi
} >"$new"
chmod 644 "$new"
mv "$new" "$page"
