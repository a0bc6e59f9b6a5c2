#!/bin/bash
# first_light.sh [SCENE...]: what a frame of a scene costs, and how soon a client sees it. Prints one table in Markdown.
# Frames: medians of frames 5..30 of a frozen scene under the step clock. Client: connect to a daemon that has its light,
# to the first (every object's coarsest level) and the complete picture (1280x720, loopback).
# Needs the release build. Default scenes: builtin:cornell builtin:atrium-matt.
set -euo pipefail
. "$(dirname "$0")/served.bash"
work=$(mktemp -d)
trap 'stop_serving; rm -rf "$work"' EXIT
[ $# -gt 0 ] || set -- builtin:cornell builtin:atrium-matt

# median FIELD: of the JSON lines in $work/frames
median() {
    sed -n '5,$p' "$work/frames" | grep -o "\"$1\":[0-9.]*" | cut -d: -f2 | sort -g |
        awk '{ v[NR] = $1 } END { print v[int((NR + 1) / 2)] }'
}
# view_field FIELD: of the viewer's report
view_field() { grep -o "\"$1\": *[0-9.]*" "$work/view" | head -n 1 | grep -o '[0-9.]*$'; }

echo "| scene | texels | frame ms | direct | scatter | levels | encode | Mrays/s | kB/frame | daemon MB | package ms | first ms | complete ms | compose ms |"
echo "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|"
for scene in "$@"; do
    "$bin/lightwelld" "$scene" --freeze 0 --light whole --clock step --frames 30 --listen 127.0.0.1:0 --json >"$work/frames" 2>"$work/log" ||
        { cat "$work/log" >&2; exit 1; }
    serve "$work" "$scene" --freeze 0 >/dev/null
    until_true "$work/served" grep -q "first light" "$work/served"
    "$bin/lightwell-view" "$address" --headless --size 1280x720 --wait complete --samples-per-pixel 1 --json \
        --out "$work/view.png" >"$work/view" 2>"$work/view.log" || { cat "$work/view.log" >&2; exit 1; }
    peak_mb=$(awk '/VmHWM/ { printf "%.0f", $2 / 1024 }' "/proc/$daemon/status")
    stop_serving
    rays=$(($(median rays_shadow) + $(median rays_bounce)))
    echo "| $(basename "$scene") | $(median texels_solved) | $(median frame_ms) | $(median direct_ms) | $(median scatter_ms) |" \
        "$(median levels_ms) | $(median encode_ms) |" \
        "$(awk -v r="$rays" -v d="$(median direct_ms)" -v s="$(median scatter_ms)" 'BEGIN { printf "%.1f", r / (d + s) / 1000 }') |" \
        "$(awk -v b="$(median bytes_encoded)" 'BEGIN { printf "%.0f", b / 1000 }') | $peak_mb |" \
        "$(view_field package_ms) | $(view_field first_ms) | $(view_field complete_ms) | $(view_field compose_ms) |"
done
