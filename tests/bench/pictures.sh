#!/bin/bash
# pictures.sh [--size WxH] [--seconds S] [--spp N] OUT.png COLUMN... -- SCENE CAMERA [SCENE CAMERA...]: a row a
# place, a picture a column. A COLUMN is options of lightwelld, and after " / " those of lightwell-view, such as
# "--directional off / --mirrors off": what a client shows S seconds (60) after the start. Or it is "paths", with
# options or without: N paths a pixel (256). Scenes stand still at time 0. Scenes that are not there are left out.
set -euo pipefail
. "$(dirname "$0")/served.bash"
usage() { sed -n '2,5s/^# //p' "$0" >&2 && exit 64; }
size=288x216 seconds=60 spp=256
while [[ ${1:-} = --size || ${1:-} = --seconds || ${1:-} = --spp ]]; do
    declare "${1#--}=$2"
    shift 2
done
[ $# -ge 2 ] || usage
out=$1
shift
columns=()
while [ $# -gt 0 ] && [ "$1" != -- ]; do
    columns+=("$1")
    shift
done
[ ${#columns[@]} -gt 0 ] && [ $# -ge 3 ] && [ $(($# % 2)) = 1 ] || usage
shift
work=$(mktemp -d)
trap 'stop_serving; rm -rf "$work"' EXIT
made=()

# picture SCENE CAMERA COLUMN
picture() {
    local served view=
    made+=("$work/${#made[@]}.png")
    if [[ $3 = paths* ]]; then
        # shellcheck disable=SC2086 # options, apart by spaces
        run "$work/paths.log" "$bin/lightwell-view" --path-trace "$1" --camera="$2" --size "$size" --spp "$spp" \
            --bounces 2 ${3#paths} --out "${made[-1]}"
        return
    fi
    served=${3%%/*}
    [[ $3 != */* ]] || view=${3#*/}
    # shellcheck disable=SC2086
    serve "$work" "$1" --freeze 0 --cache "$work/kept" $served
    # shellcheck disable=SC2086
    run "$work/view.log" "$bin/lightwell-view" --headless "$address" --camera="$2" --size "$size" \
        --samples-per-pixel 4 --wait "seconds:$seconds" --timeout 600 --cache "$work/cache" $view --out "${made[-1]}"
    stop_serving
}

while [ $# -gt 0 ]; do
    if [[ $1 = builtin:* || -e $1 ]]; then
        for column in "${columns[@]}"; do picture "$1" "$2" "$column"; done
    else
        echo "$1: left out, there is no such file" >&2
    fi
    shift 2
done
[ ${#made[@]} -gt 0 ] || { echo "pictures.sh: there is no scene" >&2; exit 66; }
python3 "$(dirname "$0")/contact_sheet.py" "$out" "${#columns[@]}" "${made[@]}"
echo "$out: $(wc -c <"$out") bytes"
