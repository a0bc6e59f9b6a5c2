#!/bin/bash
# hybrid_bias.sh [SCENE...]: what finite tracing ranges cost in accuracy and save in time, as tables in Markdown
# for docs/lab/hybrid_bias.md. Needs the release build.
# Default scenes: builtin:cornell builtin:atrium-matt, and Sponza where LW_TEST_SCENES (default ../shared/scenes) has
# it. LW_FRAMES (16), LW_DENSITY (texels a metre: 36 in Cornell's box, else 2).
set -euo pipefail
root="$(cd "$(dirname "$0")/../.." && pwd)"
bin=${LW_BIN:-$root/build/release/bin}
scenes=${LW_TEST_SCENES:-$root/../shared/scenes}
if [ $# -eq 0 ]; then
    set -- builtin:cornell builtin:atrium-matt
    if [ -e "$scenes/sponza/Sponza_lit.gltf" ]; then set -- "$@" "$scenes/sponza/Sponza_lit.gltf"; fi
fi
for scene in "$@"; do
    case $scene in # some 30,000 texels each: a table is 60 solves
    builtin:cornell) density=36 ;;
    *) density=2 ;;
    esac
    "$bin/bench_hybrid" --frames "${LW_FRAMES:-16}" --texels-per-metre "${LW_DENSITY:-$density}" "$scene"
done
