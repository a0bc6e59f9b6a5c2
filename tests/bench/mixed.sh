#!/bin/bash
# mixed.sh [--seconds S] [--alone S] [--prepare S] [--spp N] [--reference DIR] [SCENE...]: how near pictures are
# to the path tracer's, with the direct light of suns and lamps drawn at pixels and with all light in tiles.
# Prints one table in Markdown.
# Each scene's default view at 640 x 360, default settings, held still: S seconds (60) after the client has joined, then
# 5 s after another has joined the lit server. With --alone only that: 5 s after the first client has joined a
# server that nobody looked at for S seconds; --prepare is lightwelld's. The reference: N paths a pixel (200),
# kept in DIR if one is given.
# relMSE, FLIP and blocks as bench_compare has them. Default scenes: builtin:cornell builtin:atrium-matt.
set -euo pipefail
. "$(dirname "$0")/served.bash"
seconds=60 alone=0 prepare=120 spp=200 references=
while [ $# -gt 1 ]; do
    case $1 in
    --seconds) seconds=$2 ;;
    --alone) alone=$2 ;;
    --prepare) prepare=$2 ;;
    --spp) spp=$2 ;;
    --reference) references=$2 ;;
    *) break ;;
    esac
    shift 2
done
work=$(mktemp -d)
trap 'stop_serving; rm -rf "$work"' EXIT
[ $# -gt 0 ] || set -- builtin:cornell builtin:atrium-matt
references=${references:-$work}
mkdir -p "$references"

# look WHO SECONDS: a picture of a client that has just joined, and its row
look() {
    run "$work/log" "$bin/lightwell-view" --headless "$address" --direct "$1" --wait "seconds:$2" --timeout 600 \
        --size 640x360 --samples-per-pixel 8 --out "$work/view.exr"
    as_row "$name | $1 | $2 s" "$work/view.exr" "$reference"
}

echo "| scene | direct light | after | ratio of means | relMSE | FLIP | blocks within 5 % | blocks |"
echo "|---|---|---|---|---|---|---|---|"
for scene in "$@"; do
    name=$(basename "$scene")
    reference=$references/$name.exr
    path_traced "$reference" "$scene" "$spp" 640x360
    serve "$work" "$scene" --freeze 0 --prepare "$prepare" >/dev/null
    if [ "$alone" = 0 ]; then
        look auto "$seconds"
        look tiles "$seconds"
    else
        sleep "$alone"
    fi
    look auto 5
    stop_serving
done
