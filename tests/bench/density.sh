#!/bin/bash
# density.sh [--frames N] [--densities "D..."] [--size WxH] [--spp N] [--reference DIR] [--also OPTIONS] [SCENE...]: what texels per metre bring, with
# the direct light of suns and lamps drawn at pixels. Prints one table in Markdown.
# Each scene's default view (640x360), held still, all of it solved for N frames (32): counted, so that the load of the
# machine does not matter. The reference: N paths a pixel (200), box-filtered, kept in DIR (those of mixed.sh --reference will do).
# relMSE, FLIP and blocks as bench_compare has them; MB: what a client receives that has the package until its view is whole;
# CPU s: of the solve, all frames. D 0: the default density; D:MAX: with --max-texels MAX. OPTIONS: more of lightwelld's.
set -euo pipefail
. "$(dirname "$0")/served.bash"
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
trap 'stop_serving; rm -rf "$work"' EXIT
[ $# -gt 0 ] || set -- builtin:cornell builtin:atrium-matt
references=${references:-$work}
mkdir -p "$references"

has_frames() { [ "$(wc -l <"$work/frames")" -ge "$1" ]; }
has_session() { grep -q "session 1" "$work/served"; }

view() {
    "$bin/lightwell-view" --headless "$address" --wait complete --timeout 300 --size "$size" \
        --samples-per-pixel 8 --cache "$work/cache" --json --out "$work/view.exr" >"$work/seen" 2>"$work/log"
}

# numbers FIELD FILE: of lines of JSON
numbers() { grep -oE "\"$1\": ?[0-9.e+-]*" "$2" | sed 's/.*: *//'; }

echo "| scene | texels per metre | texels | solve, CPU s | MB | ratio of means | relMSE | FLIP | blocks within 5 % | blocks |"
echo "|---|---|---|---|---|---|---|---|---|---|"
for scene in "$@"; do
    name=$(basename "$scene")
    reference=$references/$name.exr
    path_traced "$reference" "$scene" "$spp" "$size"
    for density in $densities; do
        rm -f "$work/lines"
        mkfifo "$work/lines"
        asked=()
        [ "$density" = 0 ] || asked=(--texels-per-metre "${density%:*}")
        [ "$density" = "${density%:*}" ] || asked+=(--max-texels "${density#*:}")
        exec 3<>"$work/lines"
        serve "$work" "$scene" --freeze 0 --light whole --clock manual --json "${asked[@]}" "${also[@]}" \
            <"$work/lines" >"$work/frames" 3>&-
        # the first client brings the form that it takes into the frame after it
        view &
        looker=$!
        until_true "$work/served" has_session
        for _ in $(seq "$frames"); do echo >&3; done
        until_true "$work/served" has_frames "$frames"
        wait "$looker" || { cat "$work/log" >&2; exit 1; }
        view || { cat "$work/log" >&2; exit 1; }
        texels=$(numbers texels_solved "$work/frames" | head -n 1)
        cpu=$(numbers solve_cpu_ms "$work/frames" | awk '{ s += $1 } END { printf "%.1f", s / 1000 }')
        bytes=$(numbers bytes "$work/seen" | awk '{ printf "%.2f", $1 / 1e6 }')
        as_row "$name | $density | $texels | $cpu | $bytes" "$work/view.exr" "$reference"
        [ -z "${LW_KEEP_VIEWS:-}" ] || cp "$work/view.exr" "$LW_KEEP_VIEWS/$name-$density.exr"
        exec 3>&-
        wait "$daemon" || true
        daemon=
    done
done
