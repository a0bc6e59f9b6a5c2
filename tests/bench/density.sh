#!/bin/bash
# density.sh [--frames N] [--densities "D..."] [--size WxH] [--spp N] [--reference DIR] [--also OPTIONS] [SCENE...]: what texels per metre bring, with
# the direct light of suns and lamps drawn at pixels. Prints one table in Markdown.
# Each scene's default view (640x360), held still, all of it solved for N frames (32): counted, so that the load of the
# machine does not matter. The reference: N paths a pixel (200), box-filtered, kept in DIR (those of mixed.sh --reference will do).
# relMSE, FLIP and blocks as bench_compare has them; MB: what a client receives that has the package until its view is whole;
# CPU s: of the solve, all frames. D 0: the default density; D:MAX: with --max-texels MAX. OPTIONS: more of lightwelld's.
set -euo pipefail
bin=${LW_BIN:-$(cd "$(dirname "$0")/../.." && pwd)/build/release/bin}
frames=32 densities="0 2 4 8" size=640x360 spp=200 references= also=()
while [ $# -gt 1 ]; do
    case $1 in
    --frames) frames=$2 ;;
    --densities) densities=$2 ;;
    --size) size=$2 ;;
    --spp) spp=$2 ;;
    --reference) references=$2 ;;
    --also) read -ra also <<<"$2" ;;
    *) break ;;
    esac
    shift 2
done
work=$(mktemp -d)
daemon=
trap '[ -z "$daemon" ] || kill "$daemon" 2>/dev/null || true; rm -rf "$work"' EXIT
[ $# -gt 0 ] || set -- builtin:cornell builtin:atrium
references=${references:-$work}
mkdir -p "$references"

fail() { cat "$1" >&2; exit 1; }

# until CONDITION...: waits for it, ten minutes at most and no longer than the daemon
until_true() {
    for _ in $(seq 12000); do
        ! "$@" || return 0
        kill -0 "$daemon" 2>/dev/null || fail "$work/served"
        sleep 0.05
    done
    fail "$work/served"
}
is_serving() { [ -s "$work/port" ]; }
has_frames() { [ "$(wc -l <"$work/frames")" -ge "$1" ]; }
has_session() { grep -q "session 1" "$work/served"; }

view() {
    "$bin/lightwell-view" --headless "127.0.0.1:$(cat "$work/port")" --wait complete --timeout 300 --size "$size" \
        --samples-per-pixel 8 --cache "$work/cache" --json --out "$work/view.exr" >"$work/seen" 2>"$work/log"
}

# numbers FIELD FILE: of lines of JSON
numbers() { grep -oE "\"$1\": ?[0-9.e+-]*" "$2" | sed 's/.*: *//'; }

echo "| scene | texels per metre | texels | solve, CPU s | MB | ratio of means | relMSE | FLIP | blocks within 5 % | blocks |"
echo "|---|---|---|---|---|---|---|---|---|---|"
for scene in "$@"; do
    name=$(basename "$scene")
    reference=$references/$name.exr
    [ -e "$reference" ] || "$bin/lightwell-view" --path-trace "$scene" --spp "$spp" --size "$size" --out "$reference" \
        >"$work/log" 2>&1 || fail "$work/log"
    for density in $densities; do
        rm -f "$work"/{port,lines,frames,served}
        mkfifo "$work/lines"
        asked=()
        [ "$density" = 0 ] || asked=(--texels-per-metre "${density%:*}")
        [ "$density" = "${density%:*}" ] || asked+=(--max-texels "${density#*:}")
        "$bin/lightwelld" "$scene" --freeze 0 --light whole --clock manual --json --listen 127.0.0.1:0 \
            --port-file "$work/port" "${asked[@]}" "${also[@]}" <"$work/lines" >"$work/frames" 2>"$work/served" &
        daemon=$!
        exec 3>"$work/lines"
        until_true is_serving
        # the first client brings the form that it takes into the frame after it
        view &
        looker=$!
        until_true has_session
        for _ in $(seq "$frames"); do echo >&3; done
        until_true has_frames "$frames"
        wait "$looker" || fail "$work/log"
        view || fail "$work/log"
        texels=$(numbers texels_solved "$work/frames" | head -n 1)
        cpu=$(numbers solve_cpu_ms "$work/frames" | awk '{ s += $1 } END { printf "%.1f", s / 1000 }')
        bytes=$(numbers bytes "$work/seen" | awk '{ printf "%.2f", $1 / 1e6 }')
        "$bin/bench_compare" "$work/view.exr" "$reference" | head -n 1 | sed -E \
            "s/ratio of means ([^,]*), relMSE ([^,]*), FLIP ([^,]*), ([0-9]+) of ([0-9]+) blocks.*from ([^ ]*) to (.*)/| $name | $density | $texels | $cpu | $bytes | \1 | \2 | \3 | \4 of \5 | \6 to \7 |/"
        [ -z "${LW_KEEP_VIEWS:-}" ] || cp "$work/view.exr" "$LW_KEEP_VIEWS/$name-$density.exr"
        exec 3>&-
        wait "$daemon" || true
        daemon=
    done
done
