#!/bin/bash
# first_pictures.sh [--size WxH] FOLDER SCENE...: what clients show in the seconds after a server's first light:
# FOLDER/first_seconds_NAME.png of each scene. From the left: when the view is whole, after 3 s, 10 s, 60 s.
# Each scene frozen at time 0, default options, as first_seconds.sh has it, which gives the figures. A scene that
# is not there is left out, and a line says so.
set -euo pipefail
. "$(dirname "$0")/served.bash"
size=288x162
if [ "${1:-}" = --size ]; then size=$2; shift 2; fi
[ $# -ge 2 ] || { sed -n '2,5s/^# //p' "$0" >&2; exit 64; }
folder=$1 made=0
mkdir -p "$folder"
shift
work=$(mktemp -d)
trap 'stop_serving; rm -rf "$work"' EXIT

# view PICTURE WAIT
view() {
    run "$work/${1##*/}.log" "$bin/lightwell-view" --headless "$address" --wait "$2" --timeout 600 --size "$size" \
        --cache "$work/cache" --out "$1"
}

for scene in "$@"; do
    name=$(basename "${scene#builtin:}")
    name=${name%.*} name=${name,,}
    if [[ $scene != builtin:* && ! -e $scene ]]; then
        echo "$scene: left out, there is no such file" >&2
        continue
    fi
    serve "$work" "$scene" --freeze 0
    view "$work/first.png" first
    waiting=()
    for seconds in 3 10; do
        view "$work/$name-$seconds.png" "seconds:$seconds" &
        waiting+=($!)
    done
    view "$work/$name-whole.png" complete
    for pid in "${waiting[@]}"; do wait "$pid"; done
    view "$work/$name-60.png" seconds:50
    stop_serving
    sheet=$folder/first_seconds_$name.png
    python3 "$(dirname "$0")/contact_sheet.py" "$sheet" 4 "$work/$name-"{whole,3,10,60}.png
    echo "$sheet: $(wc -c <"$sheet") bytes"
    made=$((made + 1))
done
[ $made -gt 0 ] || { echo "first_pictures.sh: there is no scene" >&2; exit 66; }
