#!/bin/bash
# detail_walk.sh [--size WxH] [--seconds S] FOLDER SCENE CAMERA...: somebody goes from camera to camera, and stays
# S seconds (10) at each. FOLDER/walk.png has a picture from each at the end of its stay: above without finer levels
# (--detail 0), below with them. FOLDER/walk.csv has memory, tiles of finer levels, and tiles that were asked for,
# twice a second; walk.svg shows it. LW_WALK_DAEMON: further options of lightwelld.
set -euo pipefail
. "$(dirname "$0")/served.bash"
size=288x216 seconds=10
while [[ ${1:-} = --* ]]; do
    case $1 in
    --size) size=$2 ;;
    --seconds) seconds=$2 ;;
    *) sed -n '2,5s/^# //p' "$0" >&2 && exit 64 ;;
    esac
    shift 2
done
[ $# -ge 3 ] || { sed -n '2,5s/^# //p' "$0" >&2; exit 64; }
folder=$1 scene=$2
shift 2
mkdir -p "$folder"
work=$(mktemp -d)
sampler=
trap '[ -z "$sampler" ] || kill $sampler; stop_serving; rm -rf "$work"' EXIT
rows=()
read -r -a more <<<"${LW_WALK_DAEMON:-}"
echo 'detail,s,MB,tiles,wanted' >"$folder/walk.csv"

figure() { sed -n "s/.*\"$1\": *\([0-9]*\).*/\1/p" "$work/stats"; }

# sample DETAIL: a line twice a second
sample() {
    local began=$EPOCHREALTIME
    while sleep 0.5; do
        "$bin/lightwellctl" "unix:$work/control" stats --json >"$work/stats" 2>/dev/null || continue
        awk -v detail="$1" -v at="$(echo "$EPOCHREALTIME - $began" | bc)" -v tiles="$(figure lightwell_fine_tiles)" \
            -v wanted="$(figure lightwell_wanted_fine_tiles)" '/^VmRSS/ {
                printf "%s,%.1f,%.0f,%s,%s\n", detail, at, $2 / 1000, tiles, wanted }' "/proc/$daemon/status"
    done
}

for detail in 0 4; do
    serve "$work" "$scene" --freeze 0 --cache "$work/kept" --detail $detail --control-socket "$work/control" \
        "${more[@]}"
    sample $detail >>"$folder/walk.csv" &
    sampler=$!
    at=0
    for camera in "$@"; do
        at=$((at + 1))
        rows+=("$work/$detail-$at.png")
        run "$work/view.log" "$bin/lightwell-view" --headless "$address" --camera="$camera" --size "$size" \
            --samples-per-pixel 4 --wait "seconds:$seconds" --timeout 600 --cache "$work/cache" \
            --out "${rows[-1]}"
    done
    kill $sampler && wait $sampler || true
    sampler=
    stop_serving
done
python3 "$(dirname "$0")/contact_sheet.py" "$folder/walk.png" $# "${rows[@]}"
! command -v gnuplot >/dev/null || gnuplot -e "csv='$folder/walk.csv'; svg='$folder/walk.svg'" \
    "$(dirname "$0")/detail_walk.gnuplot"
echo "$folder/walk.png: $(wc -c <"$folder/walk.png") bytes"
