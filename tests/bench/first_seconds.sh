#!/bin/bash
# first_seconds.sh [--size WxH] [--pictures FOLDER] SCENE...: what clients see in the seconds after a server's
# first light. Prints one table in Markdown.
# Each scene frozen at time 0, default options. Start: from the command to the first light that a client has,
# s. Then three clients join, whose default views (640x360) are taken when whole (and how soon that is, s),
# after 3 s and after 10 s.
# FLIP against the view of another after 75 s. --pictures: keeps them there.
set -euo pipefail
. "$(dirname "$0")/served.bash"
size=640x360 pictures=
while [ $# -gt 1 ]; do
    case $1 in
    --size) size=$2 ;;
    --pictures) pictures=$2 ;;
    *) break ;;
    esac
    shift 2
done
work=$(mktemp -d)
trap 'stop_serving; rm -rf "$work"' EXIT
pictures=${pictures:-$work}
mkdir -p "$pictures"

# view PICTURE WAIT
view() {
    run "$work/${1##*/}.log" "$bin/lightwell-view" --headless "$address" --wait "$2" --timeout 600 --size "$size" \
        --cache "$work/cache" --out "$1"
}
flip() { "$bin/bench_compare" "$1" "$2" | sed -nE '1s/.*FLIP ([^,]*),.*/\1/p'; }
since() { echo "$1 $(date +%s.%N)" | awk '{ printf "%.1f", $2 - $1 }'; }

echo "| scene | start, s | whole after, s | FLIP | after 3 s | after 10 s |"
echo "|---|---|---|---|---|---|"
for scene in "$@"; do
    name=$(basename "${scene#builtin:}")
    began=$(date +%s.%N)
    serve "$work" "$scene" --freeze 0
    view "$work/first.exr" first
    start=$(since "$began") lit=$(date +%s.%N)
    (view "$pictures/$name-3.exr" seconds:3) &
    three=$!
    (view "$pictures/$name-10.exr" seconds:10) &
    ten=$!
    view "$pictures/$name-whole.exr" complete
    whole=$(since "$lit")
    wait "$three" "$ten"
    view "$pictures/$name-75.exr" seconds:65
    stop_serving
    row="| $name | $start | $whole |"
    for moment in whole 3 10; do
        row+=" $(flip "$pictures/$name-$moment.exr" "$pictures/$name-75.exr") |"
    done
    echo "$row"
done
