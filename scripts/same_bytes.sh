#!/bin/bash
# Compares the light of two builds, byte for byte:
#
#   scripts/same_bytes.sh BEFORE AFTER [SCENE...]
#
# BEFORE, AFTER  folders of programs, such as build/release/bin
# SCENE          default: builtin:cornell builtin:atrium-matt builtin:city:2, and the file that $LW_SPONZA names
#
# Each build solves LW_SAME_FRAMES frames (8) of each scene with one seed, a frame at a time (--clock manual), in both
# ways that light is chosen, and what comes of it is compared:
#   tiles   the light that the daemon keeps (--keep): every tile of the last snapshot as it goes on the wire
#   sums    what the next frame depends on (of scenes in which nothing moves)
#   rays    rays and texels of each frame, from --json
#   view    a view by rays, linear EXR (lightwell-view --headless)
#   maps    what lightwell-bake writes (not of scenes named in LW_SAME_UNBAKED)
# Then each build runs the scripts of tests/reference/test_solve_scripts.c: frames with a budget of units, interest
# that jumps, onsets, sweeps, groups, forms, objects hidden and shown, a checkpoint, probes, finer levels, a scene that
# is lit in part. One digest a frame is compared; of a script that differs the first frame is named.
# LW_SAME_SCRIPTS=only runs nothing else.
# Ends with 0 if all are the same.
set -euo pipefail
[ $# -ge 2 ] || { sed -n '2,/^set/{/^set/d;s/^# \{0,1\}//;p}' "$0"; exit 64; }
before=$(realpath "$1") after=$(realpath "$2")
shift 2
scenes=("$@")
[ $# -gt 0 ] || scenes=(builtin:cornell builtin:atrium-matt builtin:city:2 ${LW_SPONZA:+"$LW_SPONZA"})
frames=${LW_SAME_FRAMES:-8}
folder=$(mktemp -d)
daemon=
finish() {
    if [ -n "$daemon" ]; then kill "$daemon" 2>/dev/null || true; fi
    rm -rf "$folder"
}
trap finish EXIT

# wait_for SECONDS COMMAND...: until the command succeeds
wait_for() {
    local until=$((SECONDS + $1))
    shift
    until "$@"; do
        [ "$SECONDS" -lt $until ] || { echo "same_bytes: waited in vain: $*" >&2; return 1; }
        kill -0 "$daemon" || { echo "same_bytes: lightwelld has ended" >&2; return 1; }
        sleep 0.2
    done
}
has_frames() { [ "$(wc -l <"$out/json")" -ge "$frames" ]; }

# solve BIN SCENE OUT: light of $frames frames and a view of it, in folder OUT
solve() {
    local bin=$1 scene=$2
    out=$3
    mkdir -p "$out/kept"
    mkfifo "$out/steps"
    "$bin/lightwelld" "$scene" --clock manual --seed 7 --light whole --keep "$out/kept" --json --listen 127.0.0.1:0 \
        --port-file "$out/port" --http none --control-socket none <"$out/steps" >"$out/json" 2>"$out/log" &
    daemon=$!
    exec {steps}>"$out/steps"
    wait_for 300 test -s "$out/port"
    for ((i = 0; i < frames; i++)); do echo >&$steps; done
    wait_for 600 has_frames
    "$bin/lightwell-view" --headless --direct tiles --renderer cpu --wait complete --size 480x270 --samples-per-pixel 1 \
        --exposure 0 --out "$out/view.exr" 127.0.0.1:"$(<"$out/port")" >"$out/view.log" 2>&1 ||
        { cat "$out/view.log" >&2; return 1; }
    exec {steps}>&-
    wait "$daemon" || { cat "$out/log" >&2; return 1; }
    daemon=
    grep -oP '"(frame|rays_\w+|texels_solved|tiles_\w+)": *[0-9]+' "$out/json" | grep -v tiles_sent >"$out/rays"
    case " ${LW_SAME_UNBAKED:-builtin:city:2 ${LW_SPONZA:-}} " in
    *" $scene "*) ;;
    *) "$bin/lightwell-bake" "$scene" -o "$out/maps" --samples 4 --seed 7 --max-texels 200000 >"$out/bake.log" 2>&1 ||
        { cat "$out/bake.log" >&2; return 1; } ;;
    esac
    rm -f "$out/maps/index.json"
}

# only_tiles FILE: of what the daemon keeps (server/publish/saved_light.h), the TILE messages: behind a header of 48
# bytes and the FRAME message, which tells times; before a checksum of 8
only_tiles() {
    [ -e "$1" ] || return 0
    local frame
    frame=$(od -An -tu4 -j48 -N4 "$1")
    tail -c +$((48 + 8 + frame + 1)) "$1" | head -c -8
}

# digest FILE...: of their bytes; "-": there are none
digest() { [ -e "$1" ] && cat "$@" | sha256sum | cut -c1-16 || echo -; }

# compare_scripts: the digests of both builds, script by script
compare_scripts() {
    local side script line
    for side in before after; do "${!side}/test_solve_scripts" digests >"$folder/scripts-$side" 2>/dev/null; done
    cut -d' ' -f1 "$folder/scripts-before" "$folder/scripts-after" | sort -u >"$folder/names"
    while read -r script; do
        for side in before after; do grep "^$script " "$folder/scripts-$side" >"$folder/of-$side" || true; done
        line=$(cmp "$folder/of-before" "$folder/of-after" 2>&1 | grep -oP '(line |EOF on ).*' || true)
        [ -z "$line" ] || failed=1
        printf '%-31s %-17s %-17s %s\n' "$script" "$(digest "$folder/of-before")" "$(digest "$folder/of-after")" \
            "${line:+DIFFERENT from frame ${line#line }}"
    done <"$folder/names"
}

failed=0
if [ "${LW_SAME_SCRIPTS:-}" = only ]; then
    compare_scripts
    exit $failed
fi
printf '%-24s %-6s %-17s %-17s\n' scene what before after
for scene in "${scenes[@]}"; do
    name=$(basename "$scene")
    for side in before after; do solve "${!side}" "$scene" "$folder/$name-$side"; done
    for what in tiles sums rays view maps; do
        declare -A found=()
        for side in before after; do
            out=$folder/$name-$side
            case $what in
            tiles) only_tiles "$out/kept/shown" >"$out/tiles" && found[$side]=$(digest "$out/tiles") ;;
            sums) found[$side]=$(digest "$out"/kept/sums*) ;;
            rays) found[$side]=$(digest "$out/rays") ;;
            view) found[$side]=$(digest "$out/view.exr") ;;
            maps) found[$side]=$(digest "$out"/maps/*.exr) ;;
            esac
        done
        verdict=
        if [ "${found[before]}" != "${found[after]}" ]; then verdict=DIFFERENT failed=1; fi
        printf '%-24s %-6s %-17s %-17s %s\n' "$name" $what "${found[before]}" "${found[after]}" $verdict
    done
done
compare_scripts
exit $failed
